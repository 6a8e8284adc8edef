"""Drags, from the press of a button to its release; one class for each kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from deformer_app.viewer.events import Keys, Pixel
from deformer_app.viewer.gizmo import translation
from deformer_app.viewer.stage import Stage

CLICK = 4.0  # pixels within which a press and release is a click
FINE = 0.1  # share of the mouse's path that counts while Shift is down
_TURN = 0.4  # degrees of orbit a pixel


class Drag(Protocol):
    """A drag in progress."""

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Follow the mouse to `pixel`."""
        ...

    def release(self, keys: Keys) -> None:
        """Finish the drag and keep its result."""
        ...

    def cancel(self) -> None:
        """Abort the drag and restore the state before it."""
        ...


class MousePath:
    """The path of the mouse since the press.

    Attributes:
        start: pixel (2,) of the press.
        now: pixel (2,) of the mouse.
        counted: pixel (2,) that the drag follows: with Shift down, the mouse counts a tenth.
    """

    def __init__(self, pixel: Pixel) -> None:
        """Begin at the pixel of the press."""
        self.start = self.now = self.counted = np.array(pixel, dtype=np.float64)

    def move(self, pixel: Pixel, fine: bool) -> None:
        """Continue to `pixel`."""
        step = np.subtract(pixel, self.now)
        self.now = self.now + step
        self.counted = self.counted + (FINE if fine else 1.0) * step

    def is_click_at(self, pixel: ArrayLike) -> bool:
        """True while `pixel` is so close to the press that its release would be a click."""
        return float(np.abs(np.subtract(pixel, self.start)).max()) <= CLICK


class Orbit:
    """Turns the camera about its focal point; a click does something else."""

    def __init__(
        self, stage: Stage, pixel: Pixel, on_click: Callable[[], None] = lambda: None
    ) -> None:
        """Begin at `pixel`."""
        self._stage, self._path, self._on_click = stage, MousePath(pixel), on_click
        self._first = stage.camera
        self._began = False

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Turn the camera by the whole path since the press."""
        self._path.move(pixel, False)
        self._began = self._began or not self._path.is_click_at(pixel)
        if self._began:
            right, down = _TURN * (self._path.now - self._path.start)
            self._stage.set_camera(self._first.orbited(right, down, self._stage.sky))

    def release(self, keys: Keys) -> None:
        """End; a press that has not moved is a click."""
        if not self._began:
            self._on_click()

    def cancel(self) -> None:
        """Restore the camera."""
        self._stage.set_camera(self._first)


class Pan:
    """Moves the camera in its own plane."""

    def __init__(self, stage: Stage, pixel: Pixel) -> None:
        """Begin at `pixel`."""
        self._stage, self._start, self._first = stage, pixel, stage.camera

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Move the camera by the whole path since the press."""
        right, down = np.subtract(pixel, self._start)
        self._stage.set_camera(self._first.panned(right, down, self._stage.size))

    def release(self, keys: Keys) -> None:
        """Leave the camera where it is."""

    def cancel(self) -> None:
        """Restore the camera."""
        self._stage.set_camera(self._first)


class BoxSelection:
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

    def release(self, keys: Keys) -> None:
        """Select the handles inside; with Shift, add them to the selection."""
        self._stage.show_box(None)
        self._stage.select(self._stage.handles_in(*self._corners()), add=keys.shift)

    def cancel(self) -> None:
        """Remove the rectangle."""
        self._stage.show_box(None)


class PlaneMotion:
    """Moves the selected handles in the camera's plane through a point (3,) of theirs."""

    def __init__(self, stage: Stage, point: ArrayLike, path: MousePath) -> None:
        """Begin where `path` does."""
        self._stage, self.path = stage, path
        self._depth = float(stage.camera.depths(np.reshape(point, (1, 3)))[0])

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Follow the mouse to `pixel`."""
        self.path.move(pixel, keys.shift)
        camera, size = self._stage.camera, self._stage.size
        here = camera.unproject(self.path.counted, self._depth, size)
        there = camera.unproject(self.path.start, self._depth, size)
        self._stage.move_selected(translation(here - there))


class HandleDrag:
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

    def release(self, keys: Keys) -> None:
        """Make the drag a step of the history, or select by a click."""
        if self._began:
            self._stage.commit("Drag")
        elif self._was_selected:
            self._stage.select([self._handle], toggle=self._add)

    def cancel(self) -> None:
        """Restore the handles."""
        self._stage.revert()


class Placement:
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


class GizmoDrag:
    """A drag of a part of the manipulator: moves, turns or scales exactly."""

    def __init__(self, stage: Stage, part: str, pixel: Pixel) -> None:
        """Begin at `pixel`, where `part` is seen."""
        gizmo = stage.gizmo
        assert gizmo is not None
        self._stage, self._part, self._gizmo = stage, part, gizmo
        self._path = MousePath(pixel)

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Follow the mouse to `pixel`, where the view can tell how far."""
        self._path.move(pixel, keys.shift)
        camera, size = self._stage.camera, self._stage.size
        motion = self._gizmo.motion(self._part, self._path.start, self._path.counted, camera, size)
        if motion is not None:
            self._stage.move_selected(motion)

    def release(self, keys: Keys) -> None:
        """Make the drag a step of the history."""
        self._stage.commit({"r": "Rotate", "s": "Scale"}.get(self._part[0], "Move"))

    def cancel(self) -> None:
        """Restore the handles."""
        self._stage.revert()


class RegionStroke:
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

    def release(self, keys: Keys) -> None:
        """Make the painted region a handle."""
        self._stage.finish_region(add=keys.shift)

    def cancel(self) -> None:
        """Paint nothing."""
        self._stage.revert()
