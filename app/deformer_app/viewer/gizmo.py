"""The manipulator at the centre of the selected handles: its parts, and the motions of drags.

Move: three axes and three planes. Rotate: three rings. Scale: one square at the centre. Its axes
are those of the world, its size is constant on the screen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer import log_to_rotation
from deformer_app.rendering.camera import Camera

Mode = Literal["move", "rotate", "scale"]
Size = tuple[int, int]

LENGTH = 84  # pixels from the centre to the tip of an axis, or of a ring's radius
REACH = 8  # pixels from a part within which a press is on it
_PLANE = (0.28, 0.5)  # inner and outer corner of a plane's square, in lengths of an axis
_RING = np.linspace(0.0, 2.0 * np.pi, 65)
_DOUBLING = 120.0  # pixels to the right that double what is scaled

AXES = ("x", "y", "z")
_PARTS: dict[str, tuple[str, ...]] = {
    "move": ("x", "y", "z", "yz", "zx", "xy"),
    "rotate": ("rx", "ry", "rz"),
    "scale": ("s",),
}


@dataclass(frozen=True, eq=False)
class Motion:
    """x ↦ matrix · (x − centre) + centre + shift.

    Args:
        matrix: (3, 3).
        centre, shift: (3,).
        turns: true if the matrix is a rotation that also turns what is moved.
    """

    matrix: NDArray[np.float64]
    centre: NDArray[np.float64]
    shift: NDArray[np.float64]
    turns: bool = False

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return points (n, 3), moved."""
        return (np.asarray(points) - self.centre) @ self.matrix.T + self.centre + self.shift


def translation(shift: ArrayLike) -> Motion:
    """Return the motion that shifts by a vector (3,)."""
    return Motion(np.eye(3), np.zeros(3), np.asarray(shift, dtype=np.float64))


def rotation(centre: ArrayLike, vector: ArrayLike) -> Motion:
    """Return the motion that turns about `centre` (3,) by a rotation vector (3,) in radians."""
    turn = log_to_rotation(np.asarray(vector, dtype=np.float64))
    return Motion(turn, np.asarray(centre, dtype=np.float64), np.zeros(3), turns=True)


def scaling(centre: ArrayLike, factor: float) -> Motion:
    """Return the motion that scales about `centre` (3,)."""
    return Motion(factor * np.eye(3), np.asarray(centre, dtype=np.float64), np.zeros(3))


@dataclass(frozen=True)
class Gizmo:
    """The manipulator.

    Args:
        centre: (3,) its position.
        mode: "move", "rotate" or "scale", which determines its parts.
    """

    centre: tuple[float, float, float]
    mode: Mode

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts; a plane or ring is named for its axes."""
        return _PARTS[self.mode]

    def outline(self, part: str, camera: Camera, size: Size) -> NDArray[np.float64]:
        """Return the corners (n, 3) of a part: a line, a closed square or a closed ring."""
        length = LENGTH * camera.pixel_size(self.centre, size)
        if part == "s":
            right, up, _ = 0.16 * length * camera.axes()
            corners = [right + up, right - up, -right - up, -right + up, right + up]
        elif part in AXES:
            corners = [0.12 * length * _axis(part), length * _axis(part)]
        elif part.startswith("r"):
            u, w = np.delete(np.eye(3), AXES.index(part[1]), axis=0)
            corners = length * (np.cos(_RING)[:, None] * u + np.sin(_RING)[:, None] * w)
        else:
            u, w = _axis(part[0]), _axis(part[1])
            low, high = (length * share for share in _PLANE)
            corners = [low * (u + w), high * u + low * w, high * (u + w), low * u + high * w]
            corners.append(corners[0])
        return np.asarray(self.centre) + corners

    def part_at(self, pixel: ArrayLike, camera: Camera, size: Size) -> str | None:
        """Return the part under a pixel: the nearest within reach; a square, anywhere inside it."""
        at, best = np.asarray(pixel, dtype=np.float64), (float(REACH), None)
        for part in self.parts:
            line = camera.project(self.outline(part, camera, size), size)
            closed_square = len(line) == 5
            distance = 0.0 if closed_square and _inside(at, line) else _to_line(at, line)
            if distance < best[0]:
                best = (distance, part)
        return best[1]

    def motion(
        self, part: str, start: ArrayLike, now: ArrayLike, camera: Camera, size: Size
    ) -> Motion | None:
        """Return the motion of a drag of a part from pixel `start` to pixel `now`.

        None where the view is so flat along the part that the mouse does not determine it.
        """
        first, second = camera.ray(start, size), camera.ray(now, size)
        centre = np.asarray(self.centre)
        if part == "s":
            return scaling(centre, float(2.0 ** ((np.subtract(now, start)[0]) / _DOUBLING)))
        if part in AXES:
            a, b = (ray.along(centre, _axis(part)) for ray in (first, second))
            return None if a is None or b is None else translation((b - a) * _axis(part))
        turns = part.startswith("r")
        normal = _axis(part[1]) if turns else np.cross(_axis(part[0]), _axis(part[1]))
        p, q = (ray.on_plane(centre, normal) for ray in (first, second))
        if p is None or q is None:
            return None
        if not turns:
            return translation(q - p)
        p, q = p - centre, q - centre
        angle = float(np.arctan2(np.cross(p, q) @ normal, p @ q))
        return rotation(centre, angle * normal)


def _axis(name: str) -> NDArray[np.float64]:
    return np.eye(3)[AXES.index(name)]


def _to_line(point: NDArray, line: NDArray) -> float:
    """Return the distance from a point (2,) to a polyline (n, 2)."""
    a, step = line[:-1], np.diff(line, axis=0)
    along = ((point - a) * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-12)
    nearest = a + np.clip(along, 0.0, 1.0)[:, None] * step
    return float(np.sqrt(((point - nearest) ** 2).sum(axis=1).min()))


def _inside(point: NDArray, square: NDArray) -> bool:
    """Return True if a point (2,) lies in a closed convex polygon (n, 2)."""
    step, gap = np.diff(square, axis=0), point - square[:-1]
    turn = step[:, 0] * gap[:, 1] - step[:, 1] * gap[:, 0]
    return bool((turn >= 0).all() or (turn <= 0).all())
