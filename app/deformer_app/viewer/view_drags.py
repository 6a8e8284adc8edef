"""Drags of the camera."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from deformer_app.viewer.drag import Drag, MousePath
from deformer_app.viewer.events import Keys, Pixel
from deformer_app.viewer.stage import Stage

_TURN = 0.4  # degrees of orbit a pixel


class Orbit(Drag):
    """Turns the camera about its focal point; a click does something else.

    Args:
        stage: whose camera turns.
        pixel: of the press.
        on_click: called at the release of a press that has not moved.
        held: a point (3,) about which the camera turns instead, and which stays under the mouse.
    """

    turns_view = True

    def __init__(
        self,
        stage: Stage,
        pixel: Pixel,
        on_click: Callable[[], None] = lambda: None,
        held: NDArray[np.float64] | None = None,
    ) -> None:
        """Begin at `pixel`."""
        self._stage, self._path, self._on_click = stage, MousePath(pixel), on_click
        self._first, self._held = stage.camera, held
        self._began = False

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Turn the camera by the way of the mouse."""
        self._began = self._began or not self._path.is_click_at(pixel)
        if not self._began:
            return
        before, stage = self._path.now, self._stage
        self._path.move(pixel, False)
        right, down = _TURN * (self._path.now - before)
        camera = stage.camera.orbited(right, down, stage.sky)
        if self._held is not None:
            depth = float(stage.camera.depths([self._held])[0])
            camera = camera.holding(self._held, pixel, depth, stage.size)
        stage.set_camera(camera)

    def skip(self, pixel: Pixel) -> None:
        """Go on from `pixel`."""
        self._path.skip(pixel)

    def release(self, keys: Keys) -> None:
        """End; a press that has not moved is a click."""
        if not self._began:
            self._on_click()

    def cancel(self) -> None:
        """Restore the camera."""
        self._stage.set_camera(self._first)


class Pan(Drag):
    """Moves the camera in its own plane.

    Args:
        stage: whose camera moves.
        pixel: of the press.
        held: a point (3,) that stays under the mouse.
    """

    turns_view = True

    def __init__(self, stage: Stage, pixel: Pixel, held: NDArray[np.float64] | None = None) -> None:
        """Begin at `pixel`."""
        self._stage, self._path, self._first, self._held = (
            stage, MousePath(pixel), stage.camera, held,
        )  # fmt: skip

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Move the camera by the way of the mouse."""
        before, stage = self._path.now, self._stage
        self._path.move(pixel, False)
        if self._held is None:
            right, down = self._path.now - before
            stage.set_camera(stage.camera.panned(right, down, stage.size))
        else:
            depth = float(stage.camera.depths([self._held])[0])
            stage.set_camera(stage.camera.holding(self._held, pixel, depth, stage.size))

    def skip(self, pixel: Pixel) -> None:
        """Go on from `pixel`."""
        self._path.skip(pixel)

    def release(self, keys: Keys) -> None:
        """Leave the camera where it is."""

    def cancel(self) -> None:
        """Restore the camera."""
        self._stage.set_camera(self._first)
