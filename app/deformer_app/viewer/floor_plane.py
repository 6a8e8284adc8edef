"""The floor to stand on: switched on and off, its height, and its grid in the picture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deformer import Floor
from deformer_app.viewer.changes import Change, ModelOpened
from deformer_app.viewer.edit import Handle, points
from deformer_app.viewer.floor_grid import FloorGrid
from deformer_app.viewer.worker import in_background

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor


class FloorPlane:
    """Commands for the floor of an editor's state, and its grid.

    Args:
        editor: has the state and the picture.
    """

    def __init__(self, editor: Editor) -> None:
        """Start without a floor; the height of each model's own is found at its first use."""
        self._editor = editor
        self._own: float | None = None
        self._grid = FloorGrid(editor.state.view.plotter)
        editor.state.drawings.append(self._draw)
        editor.state.acting = self._acting
        editor.on_change.append(self._hear)

    @property
    def height(self) -> float | None:
        """Height of the floor along the model's up axis, in the data's units; None without one."""
        return self._editor.edit.floor if self._editor.is_open else None

    def switch(self) -> None:
        """Switch the floor on, where the model's examples stand, or off."""
        if self.height is not None:
            self._set(None)
        elif self._own is not None:
            self._set(self._own)
        else:
            self._editor.run(self._find())

    def slide(self, height: float) -> None:
        """Show the floor at a height along the model's up axis until `commit` of the editor."""
        self._own = height
        self._editor.show_edit(replace(self._editor.edit, floor=height))

    def _find(self) -> Iterator[None]:
        """Measure the examples on a thread: decoding them takes a second on a large mesh."""
        editor, model = self._editor, self._editor.model
        found = yield from in_background(lambda: Floor.under(model))
        if editor.is_open and editor.model is model:
            self._own = found.height
            self._set(found.height)

    def _set(self, height: float | None) -> None:
        label = "Floor" if height is not None else "No floor"
        self._editor.change(label, replace(self._editor.edit, floor=height))

    def _hear(self, change: Change) -> None:
        if isinstance(change, ModelOpened):
            self._own = self._editor.edit.floor

    def _acting(self, handles: Sequence[Handle]) -> Sequence[Handle]:
        """Return handles with their targets where they act: those under the floor, on it."""
        if self.height is None:
            return handles
        floor = Floor.at(self._editor.model, self.height)
        return [replace(h, targets=points(floor.above(h.targets))) for h in handles]

    def lifted(self, handles: Sequence[Handle]) -> list[Handle]:
        """Return handles, each as a whole lifted until no target is under the floor.

        A handle that is moved under the floor acts as if it were on it; a region of which each
        target did so would lose its shape for good, and a way back would begin with a dead part.
        """
        if self.height is None:
            return list(handles)
        floor = Floor.at(self._editor.model, self.height)
        return [_lifted(handle, floor) for handle in handles]

    def _draw(self, vertices: NDArray[np.float64], handles: Sequence[Handle]) -> None:
        """Draw the grid around the place where the reference stands."""
        state, reference = self._editor.state, self._editor.model.reference
        if self.height is None:
            self._grid.hide()
            return
        middle = reference.vertices.mean(axis=0)
        up = state.viewpoint.sky
        origin = middle + (self.height - middle @ up) * up
        self._grid.show(origin, up, reference.bounding_diagonal, state.view.theme.muted)


def _lifted(handle: Handle, floor: Floor) -> Handle:
    rises = floor.above(handle.targets) - np.array(handle.targets)
    highest = rises[np.argmax((rises**2).sum(axis=1))]
    return handle.moved(lambda p: np.asarray(p) + highest) if highest.any() else handle
