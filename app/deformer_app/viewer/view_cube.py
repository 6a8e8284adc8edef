"""The orientation cube in a corner of the picture: where it is, and what lies under the mouse."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer_app.rendering.camera import Camera
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.gizmo import Gizmo

# Part of the cube's surface, from -1 to 1 along its left, up and front: three of a corner are not
# zero, two of an edge, one of a face.
Side = tuple[int, int, int]
Size = tuple[int, int]

FACES: dict[Side, str] = {
    (1, 0, 0): "Left",
    (-1, 0, 0): "Right",
    (0, 1, 0): "Top",
    (0, -1, 0): "Bottom",
    (0, 0, 1): "Front",
    (0, 0, -1): "Back",
}
HALF = 25.0  # pixels, half an edge of the cube
REACH = 48  # pixels from the cube's centre to the border of its part of the picture
_ASIDE, _DOWN = 58.0, 82.0  # pixels of its centre from the picture's top right corner
# Pixels from the picture's right to the left border of the cube's part, and from its top to the
# bottom one.
LEFT, BOTTOM = _ASIDE + REACH, _DOWN + REACH
_INNER = 0.62  # share of a face that belongs to no edge


def centre(size: Size) -> NDArray[np.float64]:
    """Return the pixel (2,) of the cube's centre in a picture of `size` (width, height)."""
    return np.array([size[0] - _ASIDE, _DOWN])


def side_at(pixel: Pixel, axes: ArrayLike, size: Size) -> Side | None:
    """Return the part of the cube under a pixel, or None beside it.

    Args:
        pixel: of the picture.
        axes: rows (3, 3): the camera's right, up and backward in terms of left, up and front.
        size: width and height of the picture.
    """
    right, up, backward = np.asarray(axes, dtype=np.float64)
    x, y = (np.asarray(pixel) - centre(size)) / HALF
    origin = x * right - y * up
    # A line enters the cube where it has entered the slabs of all three axes.
    along = np.where(np.abs(backward) < 1e-12, 1e-12, backward)
    slabs = np.sort(np.stack([(-1 - origin) / along, (1 - origin) / along]), axis=0)
    near, far = slabs[1].min(), slabs[0].max()
    if near < far:
        return None
    entry = origin + near * backward
    i, j, k = (int(np.sign(value)) if abs(value) > _INNER else 0 for value in entry)
    return i, j, k


def is_reached(gizmo: Gizmo, camera: Camera, size: Size) -> bool:
    """Return True if the manipulator reaches the cube's part of a picture of `size`."""
    return gizmo.distance(centre(size), camera, size) < REACH


def outlines(side: Side) -> list[NDArray[np.float64]]:
    """Return the squares (4, 3) of the cube's surface that a part of it consists of."""
    spans = [(-_INNER, _INNER) if s == 0 else tuple(sorted((s * _INNER, float(s)))) for s in side]
    found = []
    for axis in np.flatnonzero(side):
        u, w = (axis + 1) % 3, (axis + 2) % 3
        square = np.empty((4, 3))
        square[:, axis] = side[axis]
        square[:, u] = np.take(spans[u], [0, 1, 1, 0])
        square[:, w] = np.take(spans[w], [0, 0, 1, 1])
        found.append(square)
    return found


def looking_from(side: Side, camera: Camera, frame: ArrayLike) -> Camera:
    """Return the camera turned about its focal point, so that it looks from a part of the cube.

    Args:
        side: the part.
        camera: distance and focal point stay.
        frame: rows (3, 3) of the shape's left, up and front.
    """
    left_up_front = np.asarray(frame, dtype=np.float64)
    upright = bool(side[0] or side[2])
    # From above the front is at the bottom of the picture, from below at its top.
    top = (0, 1, 0) if upright else (0, 0, -side[1])
    return camera.seen_from(np.array(side) @ left_up_front, np.array(top) @ left_up_front)
