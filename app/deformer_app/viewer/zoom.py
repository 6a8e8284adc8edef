"""The wheel's zoom: towards what is under the mouse, and within limits."""

from __future__ import annotations

import numpy as np

from deformer import Mesh
from deformer_app.rendering.camera import Camera
from deformer_app.viewer.events import Pixel

_NOTCH = 1.15  # factor of a notch of the wheel
_CLOSEST = 3.0  # length of this many edges fills the picture's height
_NEAREST = 2e-3  # bounding diagonals in it at least; nearer, the camera's near plane cuts
_FARTHEST = 12.0  # bounding diagonals in the picture's height


def zoom_limits(mesh: Mesh) -> tuple[float, float]:
    """Return the smallest and largest length that the picture's height should show of a mesh.

    The smallest is a few edges of the finest tenth, so that there is always something to see.
    """
    corners = mesh.vertices[mesh.faces]
    edges = np.sqrt(((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2))
    farthest = _FARTHEST * mesh.bounding_diagonal
    closest = max(_CLOSEST * float(np.quantile(edges, 0.1)), _NEAREST * mesh.bounding_diagonal)
    return min(closest, farthest), farthest


def zoomed_by_wheel(
    camera: Camera,
    notches: float,
    pixel: Pixel,
    depth: float,
    size: tuple[int, int],
    spans: tuple[float, float],
) -> Camera:
    """Return a camera zoomed by the wheel.

    Args:
        camera: before.
        notches: of the wheel, positive towards the scene.
        pixel: of the mouse; the point seen there at `depth` stays there.
        depth: along the view, above 0.
        size: width and height of the picture in pixels.
        spans: the smallest and largest length that the picture's height may show at `depth`. A
            camera beyond a limit goes no further, but back.
    """
    span = size[1] * camera.pixel_size(camera.unproject(pixel, depth, size), size)
    least, most = min(1.0, span / spans[1]), max(1.0, span / max(spans[0], 1e-300))
    return camera.zoomed(float(np.clip(_NOTCH**notches, least, most)), pixel, size, depth)
