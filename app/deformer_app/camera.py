"""A perspective camera as plain numbers: aim it at vertices, project points to pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer import InputError

Vector = tuple[float, float, float]

# Up axis → the direction that a shape faces by habit of its file format's tools.
_FRONT: dict[str, Vector] = {"x": (0, -1, 0), "y": (0, 0, 1), "z": (0, -1, 0)}
_UP: dict[str, Vector] = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


def _unit(vector: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(vector, dtype=np.float64)
    return array / np.sqrt((array**2).sum())


@dataclass(frozen=True)
class Camera:
    """A perspective camera.

    Args:
        position: where the eye is, in the data's units.
        focal: the point that lands in the middle of the image.
        up: direction that is up in the image; need not be perpendicular to the view.
        view_angle: full vertical opening, in degrees.
    """

    position: Vector
    focal: Vector
    up: Vector
    view_angle: float = 25.0

    def axes(self) -> NDArray[np.float64]:
        """Unit rows (3, 3): right, up and backward (from the focal point towards the eye)."""
        backward = _unit(np.subtract(self.position, self.focal))
        right = _unit(np.cross(self.up, backward))
        return np.stack([right, np.cross(backward, right), backward])

    def project(self, points: ArrayLike, size: tuple[int, int]) -> NDArray[np.float64]:
        """Pixels (N, 2) of `points` (N, 3) in an image of `size` (width, height).

        The origin is the top left corner of the image, x to the right and y downwards.
        """
        width, height = size
        local = (np.asarray(points, dtype=np.float64) - self.position) @ self.axes().T
        scale = 0.5 * height / np.tan(np.radians(self.view_angle) / 2)
        xy = scale * local[:, :2] / -local[:, 2:]
        return np.stack([width / 2 + xy[:, 0], height / 2 - xy[:, 1]], axis=1)


def upright_axes(up: str = "y") -> NDArray[np.float64]:
    """Unit rows (3, 3) of a shape that stands along `up`: its left, its up and its front.

    Args:
        up: "x", "y" or "z", with a minus in front if the axis points down.

    Raises:
        InputError: `up` is not an axis.
    """
    name = up.removeprefix("-").lower()
    if name not in _UP:
        raise InputError(f"up axis: got {up!r}, expected x, y, z, -x, -y or -z")
    sky = np.asarray(_UP[name], dtype=np.float64) * (-1 if up.startswith("-") else 1)
    front = np.asarray(_FRONT[name], dtype=np.float64)
    return np.stack([np.cross(sky, front), sky, front])


def aim(
    vertices: ArrayLike,
    *,
    up: str = "y",
    azimuth: float = 30.0,
    elevation: float = 10.0,
    aspect: float = 1.0,
    margin: float = 0.08,
) -> Camera:
    """Camera that sees all of `vertices` as large as the image allows.

    Args:
        vertices: (..., 3) points to keep in view; several shapes may be stacked.
        up: axis that is up in the image, as for `upright_axes`.
        azimuth: turn about the up axis, in degrees; 0 looks at the front, positive from its left.
        elevation: height of the eye above the horizon, in degrees.
        aspect: width of the image over its height.
        margin: part of the image left empty on each side.

    Raises:
        InputError: `up` is not an axis.
    """
    _, sky, front = upright_axes(up)
    turn, rise = np.radians(azimuth), np.radians(elevation)
    around = np.cos(turn) * front + np.sin(turn) * np.cross(sky, front)
    backward = np.cos(rise) * around + np.sin(rise) * sky

    points = np.asarray(vertices, dtype=np.float64).reshape(-1, 3)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    view = Camera(_vector(middle + backward), _vector(middle), _vector(sky))
    local = (points - middle) @ view.axes().T

    # With the eye on the axis through the middle of the silhouette, a point at depth
    # z needs the distance z + |y| / tan(half opening), and the same across the width.
    tangent = np.tan(np.radians(view.view_angle) / 2) * (1 - 2 * margin)
    shift = (local[:, :2].min(axis=0) + local[:, :2].max(axis=0)) / 2
    flat = np.abs(local[:, :2] - shift)
    reach = np.maximum(flat[:, 0] / aspect, flat[:, 1]) / tangent
    distance = max(float((local[:, 2] + reach).max()), np.finfo(float).tiny)
    focal = middle + shift @ view.axes()[:2]
    return Camera(_vector(focal + distance * backward), _vector(focal), _vector(sky))


def _vector(array: NDArray) -> Vector:
    x, y, z = (float(value) for value in array)
    return (x, y, z)
