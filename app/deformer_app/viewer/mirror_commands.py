"""Commands of an editor that mirror handles and poses, once or while they are changed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from deformer import DeformationModel, Symmetry, io
from deformer_app.viewer import handle_changes
from deformer_app.viewer.changes import WaitBegun, WaitEnded
from deformer_app.viewer.edit import Edit, Handle, Solution
from deformer_app.viewer.live_mirror import LiveMirror
from deformer_app.viewer.mirror_plane import AXES, MirrorPlane
from deformer_app.viewer.model_files import of_open_model
from deformer_app.viewer.worker import in_background

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor

_NOTHING = "Nothing to mirror: place a handle beside the plane of symmetry first"
# Share of the body's size by which a pose is off its mirror image from which it is not symmetric.
_ASYMMETRIC = 0.01


@dataclass(frozen=True, eq=False)
class _Mirrored:
    """The last pose that was mirrored.

    Args:
        symmetry: the plane.
        edit: the state before.
        solution: its pose, if it was at rest.
        image: the state after.
    """

    symmetry: Symmetry
    edit: Edit
    solution: Solution | None
    image: Edit


class MirrorCommands:
    """Mirrors the handles of an editor's state about the mirror plane of its model.

    Args:
        editor: has the state and its history.
    """

    def __init__(self, editor: Editor) -> None:
        """Start without a model."""
        self._editor = editor
        self._live: LiveMirror | None = None
        self._waiting: list[Callable[[], Any]] = []  # for the plane
        self._mirrored: _Mirrored | None = None

    def begin(self, model: DeformationModel | None) -> None:
        """Begin with another model, or without one; the live mirror is off until `restore`."""
        self._live = None if model is None else LiveMirror(MirrorPlane(model))
        self._waiting, self._mirrored = [], None

    def as_json(self) -> dict[str, Any]:
        """Return the entry in a session: whether both sides are posed at once, and the plane."""
        on = self.is_live or self._switch_live in self._waiting
        return {"both_sides": on, "across": self.plane.across}

    def restore(self, entry: io.JsonValue) -> None:
        """Pose as a session's entry says; the plane between the sides is found in the background.

        Raises:
            InputError: the entry is damaged.
        """
        on = entry["both_sides"].flag()
        if entry["across"].value is not None:
            self.plane.set_across(entry["across"].choice(AXES))
        if on:
            self.with_plane(self._switch_live)

    @property
    def plane(self) -> MirrorPlane:
        """The plane across which handles are mirrored."""
        return self.live.plane

    @property
    def live(self) -> LiveMirror:
        """Completes changes by those of the other side, while it is on."""
        return of_open_model(self._live)

    @property
    def is_live(self) -> bool:
        """True while both sides are posed at once."""
        return self._live is not None and self._live.on

    def with_plane(self, run: Callable[[], Any]) -> None:
        """Run a function that needs the plane: at once, or when a background job has found it."""
        if self.plane.is_known:
            run()
        elif run not in self._waiting:
            self._waiting.append(run)
            if len(self._waiting) == 1:
                self._editor.run(self._search(self.plane, self._waiting))

    def _search(self, plane: MirrorPlane, waiting: list[Callable[[], Any]]) -> Iterator[None]:
        editor = self._editor
        editor.announce(WaitBegun("Looking for the plane between the body's two sides …"))
        try:
            yield from in_background(lambda: plane.symmetry)
        finally:
            commands, waiting[:] = list(waiting), []
            editor.announce(WaitEnded())
        if self._live is not None and self.plane is plane:
            for run in commands:
                run()

    def switch_live(self) -> None:
        """Switch the live mirror on or off; say why, if it cannot be on."""
        if self.is_live:
            self._switch_live()
        else:
            self.with_plane(self._switch_live)

    def _switch_live(self) -> None:
        editor = self._editor
        note = self.live.switch()
        if note is None and not self.is_live:
            note = "Each side is posed alone"
        elif note is None:
            note = "Both sides are posed at once; Shift+M ends it"
            if self.plane.asymmetry(editor.vertices) > _ASYMMETRIC:
                note += ". The pose is not symmetric: moves are mirrored relative to it"
        editor.note(note)
        editor.state.invalidate()

    def completed(self, edit: Edit, before: Edit | None = None, lead: Handle | None = None) -> Edit:
        """Return a changed state, on both sides while the live mirror is on.

        Args:
            edit: the changed state.
            before: the state before; None is the present one.
            lead: see `LiveMirror.completed`.
        """
        editor = self._editor
        return self.live.completed(before or editor.edit, edit, editor.handles.on_surface, lead)

    def mirror_handles(self) -> None:
        """Copy the selected handles, or all, to the other side; handles there move."""
        if self._editor.edit.handles:
            self.with_plane(self._mirror_handles)
        else:
            self._editor.note(_NOTHING)

    def _mirror_handles(self) -> None:
        editor = self._editor
        sources = editor.state.selection(editor.edit.handles) or editor.edit.handles
        number = editor.session.next_id()
        changed = handle_changes.mirrored(editor.edit, sources, self.plane.symmetry, number)
        if changed:
            editor.change("Mirror", editor.edit.with_handles(changed), both_sides=False)
            editor.handles.select([h.id for h in changed], add=True)
        else:
            editor.note(_NOTHING)

    def mirror_pose(self) -> None:
        """Mirror the whole pose: all handles, and the code to start from, change their sides."""
        self.with_plane(self._mirror_pose)

    def _mirror_pose(self) -> None:
        """Show the mirror image; that of an image is what it was made of.

        Computed anew, the pose would be up to a hundredth of the body's size off: hardly a body has
        two equal halves, and no code has exactly the image of another one's shape.
        """
        editor, symmetry, last = self._editor, self.plane.symmetry, self._mirrored
        edit, solution = editor.edit, editor.resting_solution
        if last is not None and last.symmetry is symmetry and last.image == edit:
            image, known = last.edit, last.solution
        else:
            image, known = handle_changes.mirrored_edit(edit, self.plane), None
        self._mirrored = _Mirrored(symmetry, edit, solution, image)
        editor.change("Mirror the pose", image, both_sides=False, solution=known)
