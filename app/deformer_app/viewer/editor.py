"""The editor: commands on a model, its handles, components, history and picture.

A shell (a plain window, the Qt window, a test) feeds events to `controller`, calls `tick` when
there is time, and listens to `on_change`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import deformer
from deformer import Activations, DeformationModel
from deformer_app.viewer import handle_changes
from deformer_app.viewer.changes import (
    Change,
    HandlesChanged,
    HandlesDragged,
    HistoryChanged,
    MistakeMade,
    ModelOpened,
    NoticeGiven,
)
from deformer_app.viewer.colouring import component_paint
from deformer_app.viewer.controller import Controller
from deformer_app.viewer.edit import Body, Edit, Handle, Kind, point
from deformer_app.viewer.gizmo import Motion
from deformer_app.viewer.mirror_plane import MirrorPlane
from deformer_app.viewer.model_files import start_codes, stored_name
from deformer_app.viewer.mouse_stage import MouseStage
from deformer_app.viewer.pose_display import PoseDisplay
from deformer_app.viewer.pose_worker import Answer
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.session import Entry, ModelName, Session
from deformer_app.viewer.target import Target, load_alike
from deformer_app.viewer.view_state import ViewState
from deformer_app.viewer.worker import Jobs, in_background

_CLOSING = 5.0  # seconds that closing waits for the last pose
_SELECT = "Select a handle first: click it, or a row of the list"


class Editor:
    """Commands for one model, its session and the picture of it.

    Args:
        view: the picture.
        wake: called, also on other threads, when `tick` has something to do.

    Attributes:
        state: state of the picture apart from the pose.
        stage: queries and commands for the mouse.
        controller: handler of the events of the mouse.
        on_change: called with every change.
    """

    def __init__(self, view: MeshView, wake: Callable[[], None] = lambda: None) -> None:
        """Start without a model."""
        self.on_change: list[Callable[[Change], Any]] = []
        self.state = ViewState(view, self._announce, wake)
        self.stage = MouseStage(self)
        self.controller = Controller(self.stage)
        self._wake = wake
        self._jobs = Jobs()
        self._model: DeformationModel | None = None
        self._session: Session | None = None
        self._display: PoseDisplay | None = None
        self._plane: MirrorPlane | None = None
        self._before_drag: Edit | None = None
        self._code_before_slide = np.zeros(0)

    # The model and its session.

    @property
    def is_open(self) -> bool:
        """True once there is a model."""
        return self._model is not None

    @property
    def model(self) -> DeformationModel:
        """The model that is edited."""
        assert self._model is not None, "no model is open"
        return self._model

    @property
    def session(self) -> Session:
        """The session, with its history."""
        assert self._session is not None, "no model is open"
        return self._session

    @property
    def edit(self) -> Edit:
        """The current handles and prior."""
        return self.session.edit

    def open_model(self, path: str | Path, session: Session | None = None) -> None:
        """Open a model, with a session of it or a new one.

        Raises:
            InputError: no such model, or the session belongs to another.
        """
        model = deformer.load_model(path)
        if session is not None:
            session.check_fits(model, path)
        if self._display is not None:
            self._display.close(0.0)
        name = ModelName(stored_name(path), model.fingerprint)
        self._model, self._plane = model, MirrorPlane(model.reference)
        self._session = session or Session.begin(name, start_codes(model)["Reference"])
        self._before_drag = None
        self.stage.clear_region()
        self._display = PoseDisplay(
            model, self._session, self.state, self._jobs, self._announce, self._wake
        )
        self.state.show_model(model)
        self.state.frame(self.vertices)
        for text in self.state.restore(self._session.view):
            self._announce(MistakeMade(text))
        self._ask(self._session.entry.solution)
        self._announce(ModelOpened(), HistoryChanged(), HandlesChanged())

    def open_session(self, path: str | Path, model: str | Path | None = None) -> None:
        """Open a saved session and the model that it belongs to.

        Raises:
            InputError: the session is damaged, or its model is not where it was.
        """
        session = Session.load(path)
        self.open_model(model or session.model.path, session)
        self._note_units()

    def save_session(self, path: str | Path) -> None:
        """Write the session to a file, with the pose of its present state."""
        self.wait_for_pose()
        self.session.view = self.state.as_json()
        self.session.save(path)
        self._announce(HistoryChanged())

    def write_copy(self, path: str | Path) -> None:
        """Write the session, as `save_session` does, to a file; it still counts as unsaved."""
        self.wait_for_pose()
        self.session.view = self.state.as_json()
        self.session.write_copy(path)

    def close(self) -> None:
        """End the solver's thread, with the pose of the present state."""
        self.wait_for_pose(_CLOSING)
        if self._display is not None:
            self._display.close()

    # The pose.

    @property
    def answer(self) -> Answer | None:
        """The newest pose and what belongs to it; None until the solver is prepared."""
        return None if self._display is None else self._display.poses.answer

    @property
    def preparing(self) -> bool:
        """True while the solver of a model is being prepared."""
        return self.is_open and self.answer is None

    @property
    def vertices(self) -> NDArray[np.float64]:
        """The surface (V, 3) of the newest pose."""
        return self.model.reference.vertices if self.answer is None else self.answer.pose.vertices

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
    def activations(self) -> Activations | None:
        """Strengths and limits of the components, once they have been measured."""
        return None if self._display is None else self._display.activations

    @property
    def latencies(self) -> deque[float]:
        """Seconds from a move of the mouse to the frame with its pose, the latest last."""
        return deque() if self._display is None else self._display.poses.latencies

    def _ask(self, solution: Any = None, moving: bool = False) -> None:
        if self._display is not None:
            self._display.ask(solution, moving)

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
        self._display.tick(self.dragging)
        for error in self._jobs.step():
            self._announce(MistakeMade.of(error))

    def note(self, text: str) -> None:
        """Show the user a message that is no error."""
        self._announce(NoticeGiven(text))

    def _announce(self, *changes: Change) -> None:
        for change in changes:
            for listener in tuple(self.on_change):
                listener(change)

    # What a drag does.

    @property
    def selected(self) -> frozenset[int]:
        """Ids of the selected handles."""
        return self.state.selected

    def select(self, handles: Iterable[int], add: bool = False, toggle: bool = False) -> None:
        """Select handles: these alone, in addition, or toggled."""
        self.state.select(handles, add, toggle)

    def place(self, vertex: int, add: bool = False) -> int:
        """Place a handle at a vertex's position, or select the one there; return its id."""
        for handle in self.edit.handles:
            if handle.vertices == (vertex,):
                self.select([handle.id], add=add)
                return handle.id
        at = point(self.vertices[vertex])
        handle = Handle(self.session.next_id(), (vertex,), (at,))
        self._before_drag = None
        self.session.change(self.edit.with_handles([handle]))
        self.select([handle.id], add=add)
        self._ask(moving=True)
        return handle.id

    def move_selected(self, motion: Motion) -> None:
        """Move the selected handles relative to the start of this drag; pins stay."""
        if self._before_drag is None:
            self._before_drag = self.edit
        moved = self.state.movable(self._before_drag.handles)
        if motion.turns:
            if len(moved) == 1 and not self._orient(moved[0]):
                return
            moved = handle_changes.turned(self.state.movable(self._before_drag.handles), motion)
        moved = [handle.moved(motion) for handle in moved]
        self.session.change(self._before_drag.with_handles(moved))
        self._ask(moving=True)
        self._announce(HandlesDragged())

    def _orient(self, handle: Handle) -> bool:
        """Give a handle the orientation that its surface has before this drag, if it has none.

        Returns:
            False if it cannot have any: then the user is told why.
        """
        assert self._before_drag is not None
        if handle.is_region or handle.orientation is not None:
            return True
        try:
            (R,) = deformer.local_rotations(self.model, handle.vertices, self.vertices)
        except deformer.InputError as error:
            self.note(str(error))
            return False
        self._before_drag = self._before_drag.with_handles([handle.oriented(R)])
        return True

    def turn_freely(self) -> None:
        """Remove the orientations of the selected handles."""
        handles = [h for h in self.state.selection(self.edit.handles) if h.orientation is not None]
        if handles:
            free = [replace(handle, orientation=None) for handle in handles]
            self.change("Turn freely", self.edit.with_handles(free))
        else:
            self.note("Select a handle that has been turned first")

    def commit(self, label: str) -> None:
        """Make the current change one step of the history."""
        self._before_drag = None
        answer = self.answer
        solution = answer.solution if answer and answer.request.edit == self.edit else None
        if self.session.commit(label, solution):
            self._announce(HistoryChanged(), HandlesChanged())
            self._note_units()
        self._ask()

    def _note_units(self) -> None:
        """Tell the user if the targets are most likely in other units than the model."""
        rows = self.edit.arrays()
        warning = deformer.unit_warning(self.model, rows["vertices"], rows["targets"])
        if warning is not None:
            self.note(warning)

    def revert(self) -> None:
        """Discard the current change."""
        self._before_drag = None
        if self.session.under_way:
            self.session.revert()
            self.state.forget_missing(self.edit.handles)
            self._ask(self.session.entry.solution)
        self.state.invalidate()

    def add_region(self, vertices: Sequence[int], add: bool = False) -> None:
        """Make one handle of a region of vertices and select it, as a step of the history."""
        number = self.session.next_id()
        handle = handle_changes.region_handle(number, vertices, self.model.reference, self.vertices)
        self.session.change(self.edit.with_handles([handle]))
        self.select([number], add=add)
        self.commit("Paint region")

    # History.

    def change(self, label: str, edit: Edit) -> None:
        """Make a state the next step of the history and solve for it."""
        self.session.change(edit)
        self.state.forget_missing(edit.handles)
        self.commit(label)

    def undo(self) -> None:
        """Undo one step."""
        if self.session.can_undo:
            self._show_entry(self.session.undo())

    def redo(self) -> None:
        """Redo one step."""
        if self.session.can_redo:
            self._show_entry(self.session.redo())

    def _show_entry(self, entry: Entry) -> None:
        self.state.forget_missing(entry.edit.handles)
        self._ask(entry.solution)
        self._announce(HistoryChanged(), HandlesChanged())

    # The prior.

    def start_from(self, name: str, code: ArrayLike) -> None:
        """Make a latent code (K,) the prior's mean, with no handles."""
        base = tuple(float(value) for value in np.asarray(code))
        self.change(f"Start from {name}", replace(self.edit, base=base, handles=()))

    def start_from_mesh(self, path: str | Path) -> None:
        """Start from the code whose shape is closest to a mesh; a background job finds it.

        Raises:
            InputError: the mesh has another number of vertices.
        """
        mesh, model = load_alike(path, self.model.reference), self.model

        def fit() -> Iterator[None]:
            self.note(f"Looking for the code of {path} …")
            code = yield from in_background(lambda: model.fit(mesh.vertices))
            if self._model is model:
                self.start_from(Path(path).name, code)

        self.run(fit())

    def reset(self) -> None:
        """Go back to the reference, with no handles."""
        self.start_from("reference", start_codes(self.model)["Reference"])

    def use_as_base(self) -> None:
        """Make the shown pose the prior's mean; handles are unchanged."""
        if self.answer is not None:
            self.change("Start from this pose", replace(self.edit, base=self.answer.solution.z))

    def slide(self, component: int, value: float) -> None:
        """Set a component of the prior's mean until `commit`; not during a drag."""
        if self.dragging:
            return
        if self._before_drag is None:
            self._before_drag = self.edit
            self._code_before_slide = self.code
        base = list(self._before_drag.base)
        base[component] += value - float(self._code_before_slide[component])
        self.session.change(replace(self._before_drag, base=tuple(base)))
        self._ask(moving=True)

    def set_noise(self, noise: float) -> None:
        """Set the expected distance of handles from their targets until `commit`."""
        self.session.change(replace(self.edit, noise=noise))
        self._ask(moving=True)

    def set_body(self, body: Body) -> None:
        """Set whether the body may turn and travel as a whole."""
        self.change("Body " + body, replace(self.edit, body=body))

    # Handles.

    def set_kind(self, kind: Kind) -> None:
        """Make the selected handles soft, exact or pins."""
        handles = self.state.selection(self.edit.handles)
        if handles:
            changed = handle_changes.with_kind(handles, kind, self.vertices)
            self.change(f"Make {kind}", self.edit.with_handles(changed))
        else:
            self.note(_SELECT)

    def set_weight(self, weight: float) -> None:
        """Set the weight of the selected handles until `commit`."""
        handles = self.state.selection(self.edit.handles)
        self.session.change(self.edit.with_handles(replace(h, weight=weight) for h in handles))
        self._ask(moving=True)

    def set_centre(self, centre: ArrayLike) -> None:
        """Move the selected handles so that their common centre is at a point (3,)."""
        handles = self.state.movable(self.edit.handles)
        if handles:
            self.change("Move", self.edit.with_handles(handle_changes.centred_at(handles, centre)))

    def select_all(self) -> None:
        """Select every handle."""
        self.select([handle.id for handle in self.edit.handles])

    def delete(self) -> None:
        """Remove the selected handles."""
        if self.selected:
            self.change("Delete", self.edit.without(self.selected))
        else:
            self.note(_SELECT)

    def clear(self) -> None:
        """Remove all handles."""
        if self.edit.handles:
            self.change("Clear handles", replace(self.edit, handles=()))

    @property
    def plane(self) -> MirrorPlane:
        """The plane across which handles are mirrored."""
        assert self._plane is not None, "no model is open"
        return self._plane

    def mirror(self) -> None:
        """Copy the selected handles, or all, to the other side; handles there move."""
        sources = self.state.selection(self.edit.handles) or self.edit.handles
        number = self.session.next_id()
        changed = handle_changes.mirrored(self.edit, sources, self.plane.symmetry, number)
        if changed:
            self.change("Mirror", self.edit.with_handles(changed))
            self.select([h.id for h in changed], add=True)
        else:
            self.note("Nothing to mirror: place a handle beside the plane of symmetry first")

    def suggest(self) -> None:
        """Show where another handle reduces the uncertainty most; a second call places it."""
        if self.state.look.colour != "uncertainty":
            self.change_look(colour="uncertainty")
            self.note("Red is where one more handle would tell most; N again places it")
        elif self.answer is not None and self.answer.suggestion is not None:
            self.place(self.answer.suggestion)
            self.commit("Suggested handle")

    # Looks.

    def frame(self, azimuth: float = 25.0, elevation: float = 8.0) -> None:
        """Aim the camera at the whole shape from a direction in degrees; see `aim`."""
        self.state.frame(self.vertices, azimuth, elevation)

    def change_look(self, **changes: Any) -> None:
        """Change how the picture is drawn; see `Look`."""
        before = self.state.look.colour
        self.state.change_look(**changes)
        if self.state.look.colour != before and self._display is not None:
            self._display.ask_for_colours()

    def load_target(self, path: str | Path) -> None:
        """Compare with a mesh of the same connectivity.

        Raises:
            InputError: the mesh has another number of vertices.
        """
        self.state.target = Target.load(path, self.model.reference)
        self.change_look(ghost="target", colour="error")

    def preview(self, component: int | None) -> None:
        """Colour the surface by the support of a component, or as before."""
        if self.activations is None:
            return
        if component is None:
            self.state.preview_paint(None)
        else:
            self.state.preview_paint(component_paint(self.model, self.activations, component))
