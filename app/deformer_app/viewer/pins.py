"""Pins: patches of the surface that keep their place and orientation, whatever is dragged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from deformer_app.viewer.edit import Edit, Handle
from deformer_app.viewer.handle_changes import gaps_of, pulling, with_disc, with_kind
from deformer_app.viewer.stage import Hover

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor

_SMALLEST, _LARGEST = 0.01, 0.3  # radii, in bounding diagonals
_STEP = 1.2  # factor on the radius of a step of size


class Pins:
    """Makes pins and changes their size.

    Args:
        editor: has the handles.

    Attributes:
        radius: of the next pin, geodesic, in bounding diagonals: that of the last one.
    """

    def __init__(self, editor: Editor) -> None:
        """Start with pins of a middling size."""
        self.radius = 0.05
        self._editor = editor
        self._resized: tuple[list[int], Edit] | None = None

    def pinned(self, handles: Sequence[Handle]) -> list[Handle]:
        """Return handles as pins where the surface is now; single vertices get a patch."""
        editor = self._editor
        found = with_kind(handles, "pin", editor.vertices)
        return [
            h if h.is_region and not h.radius else self._with_disc(h, h.radius or self.radius)
            for h in found
        ]

    def _with_disc(self, pin: Handle, radius: float) -> Handle:
        """Return a pin with another disc that pulls the prior as strongly as before."""
        editor = self._editor
        pull = gaps_of(pin) - gaps_of(editor.handles.on_surface(pin))
        return pulling(editor.handles.on_surface(with_disc(pin, radius, editor.model)), pull)

    def pin_here(self) -> None:
        """Pin what is under the mouse, a handle or the surface; elsewhere, what is selected."""
        editor, found = self._editor, self._editor.state.hovered
        if found.vertex is not None and found.handle is None:
            self.pin_at(found.vertex)
            return
        if found.handle is not None and found.handle not in editor.handles.selected:
            editor.handles.select([found.handle])
        others = [h for h in editor.state.selection(editor.edit.handles) if h.kind != "pin"]
        editor.handles.set_kind("pin")
        if others and editor.controller.inside and found == Hover(side=found.side):
            self._tell_of_selected(len(editor.handles.selected))

    def _tell_of_selected(self, count: int) -> None:
        """Say that what is selected has become pins, not what the mouse has just missed."""
        what = "selected handle" if count == 1 else f"{count} selected handles"
        self._editor.note(f"Pinned the {what}: the mouse is on no part of the body")

    def pin_at(self, vertex: int) -> None:
        """Pin the surface at a vertex, or the handle that is there, as a step of the history."""
        self._editor.handles.place(vertex)
        self._editor.handles.set_kind("pin")

    def resize(self, steps: float, handles: Sequence[Handle] | None = None) -> bool:
        """Make pins larger or smaller, as a step of the history for several in a row.

        Args:
            steps: number of steps; negative for smaller.
            handles: None is the selected ones.

        Returns:
            False if none of them is a pin with a size.
        """
        editor = self._editor
        chosen = editor.state.selection(editor.edit.handles) if handles is None else handles
        pins = [handle for handle in chosen if handle.radius]
        if not pins:
            return False
        self.radius = min(max(pins[0].radius * _STEP**steps, _SMALLEST), _LARGEST)
        others = [handle for handle in pins if handle.radius != self.radius]
        if not others:
            editor.note(f"The pin is as {'large' if steps > 0 else 'small'} as pins can be")
            return True
        changed = [self._with_disc(h, self.radius) for h in others]
        ids = [handle.id for handle in pins]
        if self._resized == (ids, editor.edit) and editor.session.can_undo:
            editor.session.undo()
        editor.change("Resize pin", editor.edit.with_handles(changed))
        self._resized = ids, editor.edit
        return True

    def resize_selected(self, steps: float) -> None:
        """Change the size of the selected pins, or tell how to get one."""
        if not self.resize(steps):
            self._editor.note("Select a pin first: P pins the surface under the mouse")

    def tell(self) -> None:
        """Tell the user why a pin does not move, and how to free it."""
        self._editor.note("Pinned: it stays, whatever is dragged. S makes it a handle to drag")

    def holding(self, vertex: int) -> Handle | None:
        """Return the pin whose patch has a vertex, a painted region's, too; None without one."""
        found = [h for h in self._editor.edit.handles if h.kind == "pin" and vertex in h.patch]
        return next(iter(found), None)

    def at(self, vertex: int | None, handle: int | None) -> list[Handle]:
        """Return the pin with a size of a handle's id, or those whose disc has a vertex."""
        return [
            h
            for h in self._editor.edit.handles
            if h.radius and (h.id == handle or vertex in h.patch)
        ]
