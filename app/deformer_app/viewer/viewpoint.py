"""Where the picture is seen from: the camera, its framing, the limits of the zoom."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer import DeformationModel
from deformer_app.rendering.camera import Camera, aim, framed, upright_axes
from deformer_app.viewer.changes import CameraMoved, Change, LookChanged
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.zoom import zoom_limits

_MARGIN = 0.17  # of the picture, on each side of what is framed


class Viewpoint:
    """The camera of a picture.

    Args:
        view: the picture.
        announce: called with every change.
        invalidate: called when the picture must be drawn again.
    """

    def __init__(
        self,
        view: MeshView,
        announce: Callable[[Change], Any],
        invalidate: Callable[[], Any],
    ) -> None:
        """Begin without a model."""
        self._view, self._announce, self._invalidate = view, announce, invalidate
        self._camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0))
        self._up = "y"
        self._spans = (0.0, math.inf)

    def begin(self, model: DeformationModel) -> None:
        """Begin with a model's up axis and size; the camera stays."""
        self._up = str(model.summary.get("up", "y"))
        self._view.frame = upright_axes(self._up)
        self._spans = zoom_limits(model.reference)

    @property
    def up(self) -> str:
        """The model's up axis, as for `upright_axes`."""
        return self._up

    @property
    def camera(self) -> Camera:
        """The camera of the picture."""
        return self._camera

    def set_camera(self, camera: Camera) -> None:
        """Set the camera."""
        self._camera = camera
        self._view.look(camera)
        self._invalidate()
        self._announce(CameraMoved())

    def toggle_orthographic(self) -> None:
        """Change between perspective and parallel lines of sight; the focal point looks alike."""
        camera = self._camera
        flat = camera.is_orthographic
        self.set_camera(camera.perspective() if flat else camera.orthographic())
        self._announce(LookChanged())

    @property
    def sky(self) -> NDArray[np.float64]:
        """The model's up direction (3,)."""
        return upright_axes(self._up)[1]

    @property
    def spans(self) -> tuple[float, float]:
        """The smallest and largest length that the picture's height may show, in model units."""
        return self._spans

    def frame_on(self, points: ArrayLike) -> None:
        """Show points (n, 3) as large as the picture allows, from the present direction."""
        width, height = self._view.size
        self.set_camera(framed(self._camera, points, aspect=width / height, margin=_MARGIN))

    def frame(self, vertices: ArrayLike, azimuth: float = 25.0, elevation: float = 8.0) -> None:
        """Aim the camera at points (n, 3) from a direction in degrees; see `aim`."""
        width, height = self._view.size
        self.set_camera(
            aim(
                vertices,
                up=self._up,
                azimuth=azimuth,
                elevation=elevation,
                aspect=width / height,
                margin=_MARGIN,
                orthographic=self._camera.is_orthographic,
            )
        )
