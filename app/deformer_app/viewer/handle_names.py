"""Names of handles: those that the user has given, and else by their places on the body."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from deformer import InputError, Mesh
from deformer_app.viewer.edit import Handle
from deformer_app.viewer.region_names import region_names

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor

_LONGEST = 60  # characters of a name
_SIDES = {"left": "right", "right": "left"}
_SIDE = re.compile(r"\b(left|right)\b", re.IGNORECASE)


class HandleNames:
    """Names the handles of an editor's state, alike wherever they are shown.

    Args:
        editor: has the state and its history.
    """

    def __init__(self, editor: Editor) -> None:
        """Know no places yet."""
        self._editor = editor
        self._of: tuple[Mesh, str] | None = None
        self._places: dict[int, str] = {}  # of vertices of that reference, with that up axis

    def of(self, handle: Handle) -> str:
        """Return the name of a handle: its own, or else such as "Bottom left 1234"."""
        if handle.name:
            return handle.name
        painted = "region " if handle.is_region and not handle.radius else ""
        return f"{self._place(handle.vertices[0])} {painted}{handle.vertices[0]}"

    def rename(self, number: int, name: str) -> None:
        """Give the handle of an id another name, as a step; an empty one names it by its place.

        Raises:
            InputError: it has several lines or is too long, or another handle has it.
        """
        editor = self._editor
        handle, name = editor.edit.handle(number), name.strip()
        if name == self.of(handle):
            return
        if len(name) > _LONGEST or not name.isprintable():
            raise InputError(
                f"name of a handle: got {name[:_LONGEST]!r}, expected text of one line and up to "
                f"{_LONGEST} characters; choose another"
            )
        if name and any(self.of(h) == name for h in editor.edit.handles if h.id != number):
            raise InputError(f"handle {name!r}: another handle has this name; choose another")
        editor.change(
            "Rename handle",
            editor.edit.with_handles([replace(handle, name=name)]),
            both_sides=False,
            solution=editor.resting_solution,  # the pose is the same
        )

    def _place(self, vertex: int) -> str:
        reference, up = self._editor.model.reference, self._editor.state.viewpoint.up
        if self._of != (reference, up):
            self._of, self._places = (reference, up), {}
        if vertex not in self._places:
            vertices = reference.vertices
            (self._places[vertex],) = region_names(vertices[[vertex]], vertices, up)
        return self._places[vertex]


def opposite_name(name: str) -> str:
    """Return a name with "left" in place of "right", and the reverse; empty if it has neither."""

    def other(found: re.Match[str]) -> str:
        word = _SIDES[found[0].lower()]
        return word.capitalize() if found[0][0].isupper() else word

    swapped = _SIDE.sub(other, name)
    return "" if swapped == name else swapped
