"""Commands on an editor's handles: select, place, move, turn, change and remove them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

import deformer
from deformer import vertex_errors
from deformer_app.viewer import handle_changes
from deformer_app.viewer.changes import HandlesDragged
from deformer_app.viewer.edit import Edit, Handle, Kind, point
from deformer_app.viewer.gizmo import Motion
from deformer_app.viewer.handle_names import HandleNames

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor

# In bounding diagonals: a surface as close to a target as this is on it, for the eye.
_ON_TARGET = 1e-3
_SELECT = "Select a handle first: click it, or a row of the list"


class HandleCommands:
    """Changes the handles of an editor's state.

    Args:
        editor: has the state and its history.

    Attributes:
        names: of the handles.
    """

    def __init__(self, editor: Editor) -> None:
        """Store the editor."""
        self._editor = editor
        self.names = HandleNames(editor)

    # Selection.

    @property
    def selected(self) -> frozenset[int]:
        """Ids of the selected handles."""
        return self._editor.state.selected

    def select(self, handles: Iterable[int], add: bool = False, toggle: bool = False) -> None:
        """Select handles: these alone, in addition, or toggled."""
        self._editor.state.select(handles, add, toggle)

    def select_all(self) -> None:
        """Select every handle."""
        self.select([handle.id for handle in self._editor.edit.handles])

    def _chosen(self) -> list[Handle]:
        """The selected handles."""
        return self._editor.state.selection(self._editor.edit.handles)

    # New handles.

    def place(self, vertex: int, add: bool = False) -> int:
        """Place a handle at a vertex's position, or select what is there; return its id."""
        editor = self._editor
        there = [handle for handle in editor.edit.handles if handle.vertices == (vertex,)]
        found = next(iter(there), None) or editor.pins.holding(vertex)
        if found is not None:
            self.select([found.id], add=add)
            return found.id
        at = point(editor.vertices[vertex])
        handle = self.on_surface(Handle(editor.session.next_id(), (vertex,), (at,)))
        editor.before_drag = None
        editor.show_edit(editor.mirror.completed(editor.edit.with_handles([handle])))
        self.select([handle.id], add=add)
        return handle.id

    def add_region(self, vertices: Sequence[int], add: bool = False) -> None:
        """Make one handle of a region of vertices and select it, as a step of the history."""
        editor = self._editor
        number = editor.session.next_id()
        handle = handle_changes.region_handle(number, vertices, editor.model.reference)
        edit = editor.edit.with_handles([self.on_surface(handle)])
        editor.session.change(editor.mirror.completed(edit))
        self.select([number], add=add)
        editor.commit("Paint region")

    def suggest(self) -> None:
        """Show where another handle reduces the uncertainty most; a second call places it."""
        editor = self._editor
        if editor.state.look.colour != "uncertainty":
            editor.picture.change_look(colour="uncertainty")
            editor.note("Red is where one more handle would tell most; N again places it")
        elif editor.answer is not None and editor.answer.suggestion is not None:
            self.place(editor.answer.suggestion)
            editor.commit("Suggested handle")

    def on_surface(self, handle: Handle) -> Handle:
        """Return a handle with its targets on the shown surface, where it changes nothing."""
        editor, index = self._editor, list(handle.vertices)
        answer = editor.answer
        gaps = deformer.surface_gaps(editor.model, answer.pose, index) if answer else ()
        return handle.at(editor.vertices[index], gaps)

    # Moves and turns.

    def move_selected(self, motion: Motion) -> None:
        """Move the selected handles relative to the start of this drag; pins stay."""
        editor = self._editor
        begins, start = editor.before_drag is None, editor.begin_drag()
        moved = editor.state.movable(start.handles)
        if not moved:
            if begins and self.selected:
                editor.pins.tell()
            return
        if motion.turns:
            if len(moved) == 1:
                oriented = self._oriented(moved[0], start)
                if oriented is None:
                    return
                editor.before_drag = start = oriented
            moved = handle_changes.turned(editor.state.movable(start.handles), motion)
        moved = editor.floor.lifted([handle.moved(motion) for handle in moved])
        edit = start.with_handles(moved)
        editor.show_edit(editor.mirror.completed(edit, start, self._lead(moved)))
        editor.announce(HandlesDragged())

    def _lead(self, moved: Sequence[Handle]) -> Handle | None:
        """The handle that is dragged: the one under the mouse, or else the first."""
        under = [handle for handle in moved if handle.id == self._editor.state.hovered.handle]
        return next(iter(under or moved), None)

    def _oriented(self, handle: Handle, start: Edit) -> Edit | None:
        """Give a handle the orientation that its surface has before a drag, if it has none.

        Returns:
            The state before the drag with the orientation; None if the handle cannot have any:
            then the user is told why.
        """
        if handle.is_region or handle.orientation is not None:
            return start
        editor = self._editor
        try:
            free = editor.mirror.live.with_partner(handle, start.handles)
            free = [h for h in free if h.orientation is None]
            vertices = [h.vertices[0] for h in free]
            turns = deformer.local_rotations(editor.model, vertices, editor.vertices)
        except deformer.InputError as error:
            editor.note(str(error))
            return None
        return start.with_handles([h.oriented(R) for h, R in zip(free, turns, strict=True)])

    def turn_freely(self) -> None:
        """Remove the orientations of the selected handles."""
        handles = [handle for handle in self._chosen() if handle.orientation is not None]
        if handles:
            free = [replace(handle, orientation=None) for handle in handles]
            self._editor.change("Turn freely", self._editor.edit.with_handles(free))
        else:
            self._editor.note("Select a handle that has been turned first")

    def slide_centre(self, centre: ArrayLike) -> None:
        """Move the selected handles so that their common centre is at a point (3,).

        They are a step of the history once the editor commits; nothing moves during a drag.
        """
        editor = self._editor
        handles = editor.state.movable(editor.edit.handles)
        if handles and not editor.dragging:
            moved = editor.floor.lifted(handle_changes.centred_at(handles, centre))
            editor.show_edit(editor.mirror.completed(editor.edit.with_handles(moved)))

    # Kinds and weights.

    def set_kind(self, kind: Kind) -> None:
        """Make the selected handles soft, exact or pins; those that are so already stay."""
        editor, handles = self._editor, self._chosen()
        if handles:
            others = [h for h in handles if h.kind != kind or (kind == "pin" and not h.is_region)]
            changed = (
                editor.pins.pinned(others)
                if kind == "pin"
                else handle_changes.with_kind(others, kind, editor.vertices)
            )
            editor.change(
                f"Make {kind}",
                editor.edit.with_handles(changed),
                # A pin is where the surface is: another minimum would be a jump for nothing.
                solution=editor.resting_solution if kind == "pin" else None,
            )
            editor.ease()
            if kind == "exact":
                self._tell_of_move(handles)
            if kind == "soft" and any(handle.kind != "soft" for handle in handles):
                editor.note("Soft: the surface may leave the target, as far as the prior asks")
        else:
            editor.note(_SELECT)

    def _tell_of_move(self, handles: Sequence[Handle]) -> None:
        """Say how far the surface was off the targets of handles that are exact from now on."""
        before = self._off(handles)
        if before > _ON_TARGET:
            self._editor.run(self._tell_at_rest(self._editor.edit, handles, before))

    def _tell_at_rest(self, edit: Edit, handles: Sequence[Handle], before: float) -> Iterator[None]:
        """Say how far the surface was and is off once it rests, while the state is `edit`."""
        editor = self._editor
        while editor.is_open and editor.edit == edit and not editor.at_rest:
            yield
        if editor.is_open and editor.edit == edit and editor.resting_solution is not None:
            editor.note(
                f"Exact: the surface was {before:.1%} of the body's size off its target, and is "
                f"{self._off(handles):.1%} off now"
            )

    def _off(self, handles: Sequence[Handle]) -> float:
        """How far the surface is off the targets of handles at most, in bounding diagonals."""
        editor = self._editor
        off = [
            vertex_errors(h.targets, editor.vertices[list(h.vertices)]).max()
            for h in editor.state.acting(handles)
        ]
        return float(max(off)) / editor.model.reference.bounding_diagonal

    def set_weight(self, weight: float) -> None:
        """Set the weight of the selected handles until `commit`."""
        editor = self._editor
        edit = editor.edit.with_handles(replace(h, weight=weight) for h in self._chosen())
        editor.show_edit(editor.mirror.completed(edit))

    # Removal.

    def delete(self) -> None:
        """Remove the selected handles."""
        editor = self._editor
        if self.selected:
            editor.change("Delete", editor.edit.without(self.selected))
            if editor.edit.handles:
                editor.note("Released: the pose is now that of the handles that are left")
        else:
            editor.note(_SELECT)

    def clear(self) -> None:
        """Remove all handles."""
        editor = self._editor
        if editor.edit.handles:
            editor.change("Clear handles", replace(editor.edit, handles=()))
