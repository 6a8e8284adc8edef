"""Drags that select, place and move handles; one class for each kind."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer_app.viewer.drag import Drag, MousePath
from deformer_app.viewer.events import Keys, Pixel
from deformer_app.viewer.gizmo import translation
from deformer_app.viewer.stage import Stage


class BoxSelection(Drag):
    """Draws a rectangle and selects the handles inside it."""

    def __init__(self, stage: Stage, pixel: Pixel) -> None:
        """Begin at `pixel`."""
        self._stage, self._start, self._now = stage, pixel, pixel

    def _corners(self) -> tuple[Pixel, Pixel]:
        (a, b), (c, d) = self._start, self._now
        return (min(a, c), min(b, d)), (max(a, c), max(b, d))

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Draw the rectangle as far as `pixel`."""
        self._now = pixel
        self._stage.show_box(self._corners())

    def skip(self, pixel: Pixel) -> None:
        """Draw the rectangle as far as `pixel`."""
        self.move(pixel, Keys())

    def release(self, keys: Keys) -> None:
        """Select the handles inside; with Shift, add them to the selection."""
        self._stage.show_box(None)
        self._stage.select(self._stage.handles_in(*self._corners()), add=keys.shift)

    def cancel(self) -> None:
        """Remove the rectangle."""
        self._stage.show_box(None)


class PlaneMotion:
    """Moves the selected handles in the camera's plane through a point (3,) of theirs.

    The camera may change: every step of the mouse is one in the plane of the present camera.
    """

    def __init__(self, stage: Stage, point: ArrayLike, path: MousePath) -> None:
        """Begin where `path` does."""
        self._stage, self.path = stage, path
        self._point = np.array(point, dtype=np.float64)
        self._shift = np.zeros(3)

    def _depth(self) -> float:
        return float(self._stage.camera.depths([self._point + self._shift])[0])

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Follow the mouse to `pixel`."""
        before = self.path.counted
        self.path.move(pixel, keys.shift)
        camera, size, depth = self._stage.camera, self._stage.size, self._depth()
        here = camera.unproject(self.path.counted, depth, size)
        self._shift = self._shift + here - camera.unproject(before, depth, size)
        self._stage.move_selected(translation(self._shift))

    def grasp(self, pixel: Pixel) -> NDArray[np.float64]:
        """Return the point (3,) under `pixel` in the plane."""
        return self._stage.camera.unproject(pixel, self._depth(), self._stage.size)


class HandleDrag(Drag):
    """A press on a handle: a click selects it, a drag moves it with all that is selected."""

    def __init__(self, stage: Stage, handle: int, pixel: Pixel, keys: Keys) -> None:
        """Begin at `pixel`; a handle that is not selected becomes so at once."""
        self._stage, self._handle = stage, handle
        self._was_selected = handle in stage.selected
        self._add = keys.shift or keys.control
        if not self._was_selected:
            stage.select([handle], add=self._add)
        self._motion = PlaneMotion(stage, stage.position_of(handle), MousePath(pixel))
        self._began = False

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Move the handles, once the mouse has gone further than a click."""
        self._began = self._began or not self._motion.path.is_click_at(pixel)
        if self._began:
            self._motion.move(pixel, keys)

    def skip(self, pixel: Pixel) -> None:
        """Go on from `pixel`."""
        self._motion.path.skip(pixel)

    def grasp(self, pixel: Pixel) -> NDArray[np.float64] | None:
        """Return the point (3,) under `pixel` in the plane of the drag."""
        return self._motion.grasp(pixel)

    def release(self, keys: Keys) -> None:
        """Make the drag a step of the history, or select by a click."""
        if self._began:
            self._stage.commit("Drag")
        elif self._was_selected:
            self._stage.select([self._handle], toggle=self._add)

    def cancel(self) -> None:
        """Restore the handles."""
        self._stage.revert()


class Placement(Drag):
    """A press on the surface: a click places a handle, a drag places it and moves it."""

    def __init__(self, stage: Stage, vertex: int, pixel: Pixel, keys: Keys) -> None:
        """Begin at `pixel`, where `vertex` is seen."""
        self._stage, self._vertex, self._add = stage, vertex, keys.shift
        self._path = MousePath(pixel)
        self._motion: PlaneMotion | None = None

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Place the handle once the mouse has gone further than a click, then move it."""
        if self._motion is None:
            if self._path.is_click_at(pixel):
                return
            handle = self._stage.place(self._vertex, self._add)
            self._motion = PlaneMotion(self._stage, self._stage.position_of(handle), self._path)
        self._motion.move(pixel, keys)

    def skip(self, pixel: Pixel) -> None:
        """Go on from `pixel`."""
        self._path.skip(pixel)

    def grasp(self, pixel: Pixel) -> NDArray[np.float64] | None:
        """Return the point (3,) under `pixel` in the plane of the drag, once it moves."""
        return None if self._motion is None else self._motion.grasp(pixel)

    def release(self, keys: Keys) -> None:
        """Make the drag a step of the history."""
        if self._motion is None:
            self._stage.place(self._vertex, self._add)
            self._stage.commit("Place handle")
        else:
            self._stage.commit("Place and drag")

    def cancel(self) -> None:
        """Remove the handle again."""
        self._stage.revert()


class RegionStroke(Drag):
    """Paints vertices; all of them together become one handle."""

    def __init__(self, stage: Stage, vertex: int) -> None:
        """Begin at `vertex`."""
        self._stage = stage
        stage.paint_region(vertex)

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Paint what is seen at `pixel`."""
        vertex = self._stage.vertex_at(pixel)
        if vertex is not None:
            self._stage.paint_region(vertex)

    def skip(self, pixel: Pixel) -> None:
        """Go on from `pixel`."""

    def release(self, keys: Keys) -> None:
        """Make the painted region a handle."""
        self._stage.finish_region(add=keys.shift)

    def cancel(self) -> None:
        """Paint nothing."""
        self._stage.revert()
