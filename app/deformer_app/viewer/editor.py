"""The editor: a model, its session with the history, and the picture of its pose.

Commands on handles, prior, mirror and picture are classes of their own, which get the editor.
A shell (a plain window, the Qt window, a test) feeds events to `controller`, calls `tick` when
there is time, and listens to `on_change`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import Activations, ComponentRegion, DeformationModel, io
from deformer_app.viewer.changes import (
    Change,
    ComponentsNamed,
    HandlesChanged,
    HistoryChanged,
    LookChanged,
    MistakeMade,
    ModelClosed,
    ModelOpened,
    NoticeGiven,
    StepShown,
)
from deformer_app.viewer.component_names import with_session_names
from deformer_app.viewer.controller import Controller
from deformer_app.viewer.edit import Edit, Solution
from deformer_app.viewer.filming import Filming
from deformer_app.viewer.floor_plane import FloorPlane
from deformer_app.viewer.handle_commands import HandleCommands
from deformer_app.viewer.mirror_commands import MirrorCommands
from deformer_app.viewer.mirror_marks import MirrorMarks
from deformer_app.viewer.model_files import of_open_model, start_codes
from deformer_app.viewer.mouse_stage import MouseStage
from deformer_app.viewer.picture_commands import PictureCommands
from deformer_app.viewer.pins import Pins
from deformer_app.viewer.pose_display import PoseDisplay
from deformer_app.viewer.pose_worker import Answer
from deformer_app.viewer.prior_commands import PriorCommands
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.session import Entry, ModelName, Session
from deformer_app.viewer.timeline.timeline import Timeline
from deformer_app.viewer.view_state import ViewState
from deformer_app.viewer.view_storage import restore_view, view_as_json
from deformer_app.viewer.worker import Jobs

_CLOSING = 5.0  # seconds that closing waits for the last pose


class Editor:
    """One model with its session, its pose and the picture of it.

    Args:
        view: the picture.
        wake: called, also on other threads, when `tick` has something to do.

    Attributes:
        state: state of the picture apart from the pose.
        stage: queries and commands for the mouse.
        controller: handler of the events of the mouse.
        handles: selects, places, moves and changes handles.
        pins: makes pins and changes their size.
        prior: sets the code to start from, its components, the noise and the body's freedom.
        mirror: mirrors handles and poses.
        floor: switches the floor and moves it.
        picture: frames the shape and changes how it looks.
        before_drag: state at the beginning of a drag, or of a slide; None until it has begun.
        on_change: called with every change.
        timeline: keys, playhead and playback of the clip.
        filming: draws and writes animations.
    """

    def __init__(self, view: MeshView, wake: Callable[[], None] = lambda: None) -> None:
        """Start without a model."""
        self.on_change: list[Callable[[Change], Any]] = []
        self.state = ViewState(view, self.announce, wake, self.run)
        self.stage = MouseStage(self)
        self.controller = Controller(self.stage)
        self._wake = wake
        self._jobs = Jobs()
        self._model: DeformationModel | None = None
        self._session: Session | None = None
        self._display: PoseDisplay | None = None
        self.handles = HandleCommands(self)
        self.pins = Pins(self)
        self.prior = PriorCommands(self)
        self.mirror = MirrorCommands(self)
        MirrorMarks(self)
        self.floor = FloorPlane(self)
        self.picture = PictureCommands(self)
        self.before_drag: Edit | None = None
        self.timeline = Timeline(self)
        self.filming = Filming(self)

    # The model and its session.

    @property
    def is_open(self) -> bool:
        """True once there is a model."""
        return self._model is not None

    @property
    def model(self) -> DeformationModel:
        """The model that is edited."""
        return of_open_model(self._model)

    @property
    def session(self) -> Session:
        """The session, with its history."""
        return of_open_model(self._session)

    @property
    def edit(self) -> Edit:
        """The current handles and prior."""
        return self.session.edit

    def open_model(
        self,
        path: str | Path,
        session: Session | None = None,
        loaded: DeformationModel | None = None,
    ) -> None:
        """Open a model, with a session of it or a new one.

        Args:
            path: directory or name of the model.
            session: None begins one.
            loaded: the model, if it has been read already.

        Raises:
            InputError: no such model, or the session belongs to another.
        """
        model = deformer.load_model(path) if loaded is None else loaded
        if session is not None:
            session.check_fits(model, path, "session")
        if self._display is not None:
            self._display.close(0.0)
        name = ModelName.of(path, model)
        if session is not None and session.component_names:
            try:
                model = with_session_names(model, session.component_names)
            except deformer.InputError as error:
                self.announce(MistakeMade(f"Names of components in the session are lost: {error}"))
                session.component_names.clear()
        self._model = model
        self.mirror.begin(model)
        self._session = session or Session.begin(name, start_codes(model)["Reference"])
        self._session.model = name  # where it is now
        self.before_drag = None
        self.stage.begin(model)
        self._display = PoseDisplay(
            model, self._session, self.state, self._jobs, self.announce, self._wake
        )
        self.state.show_model(model)
        solution = self._session.entry.solution
        if solution is not None:
            self._display.show_stored(solution)
        self.state.viewpoint.frame(self.vertices)
        for text in restore_view(self.state, self._session.view):
            self.announce(MistakeMade(text))
        view = io.JsonValue(self._session.view, "session", "view")
        self.timeline.begin(view)
        if "mirror" in view:  # sessions of earlier versions have none
            self.mirror.restore(view["mirror"])
        self.ask(solution)
        self.announce(ModelOpened(), HistoryChanged(), HandlesChanged())

    def close_model(self) -> None:
        """Close the model and its session, also unsaved."""
        self.close()
        self._model, self._session, self._display = None, None, None
        self.mirror.begin(None)
        self.stage.clear_region()
        self.announce(ModelClosed())

    def open_session(self, path: str | Path, model: str | Path | None = None) -> None:
        """Open a saved session and the model that it belongs to.

        Raises:
            InputError: the session is damaged, or its model is not where it was, or has changed.
        """
        session = Session.load(path)
        name = model or session.model.path
        loaded = deformer.load_model(name)
        session.check_fits(loaded, name, path)
        self.open_model(name, session, loaded)
        self.note_units()

    def save_session(self, path: str | Path) -> None:
        """Write the session to a file, with the pose of its present state."""
        self.wait_for_pose()
        self.session.view = self._view_as_json()
        self.session.save(path)
        self.announce(HistoryChanged())

    def _view_as_json(self) -> dict[str, Any]:
        """Return what the session stores beside its history."""
        loaded = self.timeline.loaded
        return {
            **view_as_json(self.state),
            "mirror": self.mirror.as_json(),
            "sequence": None if loaded is None else loaded.as_json(),
        }

    def write_copy(self, path: str | Path, saved_as: Path | None = None, wait: bool = True) -> None:
        """Write the session, as `save_session` does, to a file; it still counts as unsaved.

        Args:
            path: the file.
            saved_as: where the user has saved the session, for a later start to find; or None.
            wait: False to write it at once, without a pose that is still being solved.
        """
        if wait:
            self.wait_for_pose()
        self.session.view = self._view_as_json()
        self.session.saved_as = "" if saved_as is None else str(saved_as.resolve())
        self.session.write_copy(path)

    def close(self) -> None:
        """End the solver's thread, with the pose of the present state."""
        self.timeline.close()
        self.wait_for_pose(_CLOSING)
        if self._display is not None:
            self._display.close()

    # The pose.

    @property
    def answer(self) -> Answer | None:
        """The newest pose and what belongs to it; None until the solver is prepared."""
        return None if self._display is None else self._display.poses.answer

    @property
    def resting_solution(self) -> Solution | None:
        """The solution of the present state, if its pose is at rest."""
        answer = self.answer
        rests = answer is not None and answer.final and answer.request.edit == self.edit
        return answer.solution if answer is not None and rests else None

    @property
    def preparing(self) -> bool:
        """True while the solver of a model is being prepared."""
        return self.is_open and self.answer is None

    @property
    def vertices(self) -> NDArray[np.float64]:
        """The surface (V, 3) of the newest pose."""
        return self.model.reference.vertices if self._display is None else self._display.vertices

    def wait_for_pose(self, seconds: float = math.inf) -> None:
        """Wait at most so long until `vertices` is the pose of the present state.

        Does not wait for the solver to be prepared.
        """
        if self._display is not None and not self.preparing:
            self._display.wait_for_pose(seconds)

    @property
    def code(self) -> NDArray[np.float64]:
        """The latent code (K,) of the newest pose."""
        return np.array(self.edit.base) if self.answer is None else self.answer.pose.z

    @property
    def shown_solution(self) -> Solution | None:
        """The solution of the present state, also before it is at rest; None without one."""
        known = self.session.entry.solution
        return known if known is not None or self.answer is None else self.answer.solution

    @property
    def activations(self) -> Activations | None:
        """Strengths and limits of the components, once they have been measured."""
        return None if self._display is None else self._display.activations

    @property
    def regions(self) -> list[ComponentRegion]:
        """Groups of the components by where they act, once they have been measured."""
        return [] if self._display is None else self._display.regions

    def name_components(self, names: Mapping[int, str]) -> None:
        """Name components in this session; an empty name removes the component's.

        Raises:
            InputError: no such component, no name, or another component has it.
        """
        self._model = self.model.with_component_names(names)
        self.session.component_names.update(names)
        if self._display is not None:
            self._display.rename_components(self._model)
        self.announce(ComponentsNamed())

    @property
    def latencies(self) -> deque[float]:
        """Seconds from a move of the mouse to the frame with its pose, the latest last."""
        return deque() if self._display is None else self._display.poses.latencies

    def ask(self, solution: Solution | None = None, moving: bool = False) -> None:
        """Have the present state solved; see `PoseDisplay.ask`."""
        if self._display is not None:
            self._display.ask(solution, moving)

    def ease(self) -> None:
        """Have the surface go smoothly to the pose of the present state."""
        if self._display is not None:
            self._display.ease()

    def ask_for_colours(self) -> None:
        """Have the pose coloured as the look says."""
        if self._display is not None:
            self._display.ask_for_colours()

    # Time.

    @property
    def dragging(self) -> bool:
        """True while a button of the mouse is down."""
        return self.controller.dragging

    @property
    def busy(self) -> bool:
        """True while a pose, a frame or a job is pending."""
        return bool(self._jobs) or (self._display is not None and self._display.busy)

    @property
    def at_rest(self) -> bool:
        """True while nothing moves and no pose is pending; jobs may go on."""
        solved = self._display is not None and not self._display.busy
        return solved and not (self.dragging or self.session.under_way)

    @property
    def idle(self) -> bool:
        """True while `tick` has nothing to do until something changes."""
        return not (self.busy or self.dragging) and self.state.view.is_sharp

    def run(self, job: Iterator[None]) -> None:
        """Run one step of `job` in every tick, so that the window stays responsive."""
        self._jobs.add(job)
        self._wake()

    def tick(self) -> None:
        """Fetch the newest pose, draw changes and continue jobs, without waiting."""
        if self._display is None:
            return
        moved = not self.state.view.is_sharp
        self._display.tick(self.dragging)
        if moved and self.state.view.is_sharp:  # camera or pose have come to rest
            self.controller.look_again()
        for error in self._jobs.step():
            self.announce(MistakeMade.of(error))

    def touch(self) -> None:
        """Count the session as changed, by something that its history does not have."""
        self.session.mark_unsaved()
        self.announce(HistoryChanged())

    def note(self, text: str) -> None:
        """Show the user a message that is no error."""
        self.announce(NoticeGiven(text))

    def announce(self, *changes: Change) -> None:
        """Tell the listeners of `on_change` what has changed."""
        for change in changes:
            if isinstance(change, HandlesChanged | LookChanged):
                self.controller.look_again()
            for listener in tuple(self.on_change):
                listener(change)

    # History.

    def begin_drag(self) -> Edit:
        """Return the state at the beginning of this drag: the present one at its first move."""
        if self.before_drag is None:
            self.before_drag = self.edit
        return self.before_drag

    def show_edit(self, edit: Edit) -> None:
        """Show a state until `commit` or `revert`."""
        self.session.change(edit)
        self.ask(moving=True)

    def commit(self, label: str, known: Solution | None = None, whole: bool = False) -> None:
        """Make the current change one step of the history.

        Args:
            label: what was done, in words for the user.
            known: its pose at rest, if there is one.
            whole: True for a pose as a whole: auto-key keys all of it, not only what has changed.
        """
        self.before_drag = None
        answer, solution = self.answer, known
        if known is None and answer and answer.request.edit == self.edit:
            solution = answer.solution
        clip = self.timeline.keyed(self.session.entry.edit, self.edit, whole)
        if self.session.commit(label, solution, clip):
            self.announce(HistoryChanged(), HandlesChanged())
        elif known is not None:  # the same state, but perhaps not the same of its minima
            self.session.show_solution(known)
        else:  # nothing is different: the pose is the one that was there
            known = self.session.entry.solution
        self.ask(known)

    def note_units(self) -> None:
        """Tell the user if targets that come from a file are most likely in other units."""
        rows = self.edit.arrays()
        warning = deformer.unit_warning(self.model, rows["vertices"], rows["targets"])
        if warning is not None:
            self.note(warning)

    def revert(self) -> None:
        """Discard the current change."""
        self.before_drag = None
        if self.session.under_way:
            self.session.revert()
            self.state.forget_missing(self.edit.handles)
            self.ask(self.session.entry.solution)
        self.state.invalidate()

    def give_up(self) -> bool:
        """Discard the current change, as that of a slider; return False if there is none."""
        if not (self.is_open and self.session.under_way):
            return False
        self.revert()
        return True

    def change(
        self,
        label: str,
        edit: Edit,
        both_sides: bool = True,
        solution: Solution | None = None,
        whole: bool = False,
    ) -> None:
        """Make a state the next step of the history and solve for it.

        Args:
            label: what was done, in words for the user.
            edit: the state.
            both_sides: False if the live mirror has nothing to add.
            solution: its pose at rest, if that is known.
            whole: as in `commit`.
        """
        self.session.change(self.mirror.completed(edit) if both_sides else edit)
        self.state.forget_missing(edit.handles)
        self.commit(label, solution, whole)

    def restore(self, label: str, edit: Edit, solution: Solution | None) -> None:
        """Make a state the next step of the history and solve for it from a solution."""
        self.session.change(edit)
        self.state.forget_missing(edit.handles)
        if self.session.commit(label, solution):
            self.announce(HistoryChanged(), HandlesChanged())
        self.ask(solution)

    def undo(self) -> None:
        """Undo one step."""
        if self.session.can_undo:
            self._show_entry(self.session.undo())

    def redo(self) -> None:
        """Redo one step."""
        if self.session.can_redo:
            self._show_entry(self.session.redo())

    def go_to(self, number: int) -> None:
        """Show `session.entries[number]`, as that many undos or redos do."""
        before = self.session.cursor
        entry = self.session.go_to(number)
        if self.session.cursor != before:
            self._show_entry(entry)

    def _show_entry(self, entry: Entry) -> None:
        self.state.forget_missing(entry.edit.handles)
        self.ask(entry.solution)
        self.announce(StepShown(), HistoryChanged(), HandlesChanged())

    def show_state(self, edit: Edit, shape: NDArray[np.float64] | None = None) -> None:
        """Show another state in the place of the present one: no step of the history.

        Args:
            edit: the state.
            shape: (V, 3) its surface; None solves for it.
        """
        self.session.show(edit)
        if shape is None or self._display is None:
            self.ask(moving=True)
        else:
            self._display.show(shape)
