"""The choice of what the manipulator does and along which axes, and where it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer_app.rendering.camera import Camera
from deformer_app.viewer.edit import Handle, point
from deformer_app.viewer.gizmo import WORLD, Frame, Gizmo, Mode

Axes = Literal["world", "surface", "screen"]


class Manipulator:
    """Settings of the manipulator.

    Attributes:
        mode: what it does.
        axes: whose axes it has: the world's; those of the surface, z along its normal and x
            level; or those of the screen, z towards the viewer.
        held: its axes during a drag of one of its parts, while the surface and the view move.
    """

    def __init__(self) -> None:
        """Start with moves along the world's axes."""
        self.mode: Mode = "move"
        self.axes: Axes = "world"
        self.held: Frame | None = None

    def can_scale(self, handles: Sequence[Handle]) -> bool:
        """True if handles have more than one point; nothing of a single one can be scaled."""
        return sum(len(handle.vertices) for handle in handles) > 1

    def gizmo(
        self,
        handles: Sequence[Handle],
        normals: Callable[[], NDArray],
        camera: Camera,
        sky: ArrayLike,
    ) -> Gizmo | None:
        """Return the manipulator of handles.

        Args:
            handles: that it moves; without any there is no manipulator.
            normals: gives those of the surface (V, 3); called if they are needed.
            camera: of the picture.
            sky: (3,) the direction that is up.
        """
        if not handles:
            return None
        centre = point(np.mean([handle.centre for handle in handles], axis=0))
        mode = "move" if self.mode == "scale" and not self.can_scale(handles) else self.mode
        if self.held is not None:
            return Gizmo(centre, mode, self.held)
        if self.axes == "world":
            return Gizmo(centre, mode)
        if self.axes == "screen":
            right, up, backward = camera.axes()
            return Gizmo(centre, mode, (point(right), point(up), point(backward)))
        vertices = [vertex for handle in handles for vertex in handle.vertices]
        return Gizmo(centre, mode, _along(normals()[vertices].mean(axis=0), np.asarray(sky)))


def _along(normal: NDArray, sky: NDArray) -> Frame:
    """Return the axes of a surface with a normal (3,), x level; the world's without a normal."""
    if normal @ normal < 1e-12:  # of a surface that closes on itself
        return WORLD
    z = normal / np.sqrt(normal @ normal)
    x = np.cross(sky, z)
    if x @ x < 1e-6:  # the surface is level, and so is any direction along it
        x = np.cross(np.roll(sky, 1), z)
    x = x / np.sqrt(x @ x)
    return point(x), point(np.cross(z, x)), point(z)
