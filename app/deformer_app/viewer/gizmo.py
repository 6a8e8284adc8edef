"""The manipulator at the centre of the selected handles: its parts, and the motions of drags.

Move: three axes and three planes. Rotate: three rings. Scale: one square at the centre. Its axes
are those of the world, of the surface or of the screen; its size on the screen does not depend on
the distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer import log_to_rotation
from deformer_app.rendering.camera import Camera, Vector

Mode = Literal["move", "rotate", "scale"]
Frame = tuple[Vector, Vector, Vector]  # unit axes x, y and z
Size = tuple[int, int]

# Pixels from the centre to the tip of an axis, or of a ring's radius, and the share of the smaller
# side of the picture that they are at most.
_LENGTH, _SHARE = 84.0, 0.14
REACH = 8  # pixels from a part within which a press is on it
_PLANE = (0.28, 0.5)  # inner and outer corner of a plane's square, in lengths of an axis
_RING = np.linspace(0.0, 2.0 * np.pi, 65)
_SMALLEST = 1e-3  # factor
_DOUBLING = 120.0  # pixels to the right that double what is scaled

_END_ON = 0.98  # cosine to the line of sight from which an axis is too short to be used
_EDGE_ON = 0.1  # the same of a normal, up to which a square is too narrow
_FLAT = 0.25  # and up to which a ring is dragged along the line that it looks like

AXES = ("x", "y", "z")
WORLD: Frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_NEXT = {"x": "y", "y": "z", "z": "x"}  # right-handed
_ACROSS = {"yz": "x", "zx": "y", "xy": "z"}  # the normal of each plane
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


def axis_length(size: Size) -> float:
    """Return the pixels from the centre to the tip of an axis in a picture of (width, height)."""
    return min(_LENGTH, _SHARE * min(size))


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


def is_square(part: str) -> bool:
    """True for a part that is pressed anywhere inside: a plane, or the square that scales."""
    return part == "s" or (len(part) == 2 and part[0] in AXES)


@dataclass(frozen=True)
class Gizmo:
    """The manipulator.

    How far a part has been dragged is its amount: a distance along an axis (1,), two along the axes
    of a plane (2,), an angle of a ring in radians (1,), or the number of doublings of what is
    scaled (1,). Amounts of successive steps add up.

    Args:
        centre: (3,) its position.
        mode: "move", "rotate" or "scale", which determines its parts.
        frame: its axes.
    """

    centre: tuple[float, float, float]
    mode: Mode
    frame: Frame = WORLD

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts; a plane or ring is named for its axes."""
        return _PARTS[self.mode]

    def parts_seen(self, camera: Camera) -> list[str]:
        """Return the parts that can be used: no axis seen end on, no square seen edge on."""
        if self.mode != "move":
            return list(self.parts)
        cosines = np.abs(self._axes @ camera.sight(self.centre)).tolist()
        along: dict[str, float] = dict(zip(AXES, cosines, strict=True))
        return [
            part
            for part in self.parts
            if (along[part] < _END_ON if part in AXES else along[_ACROSS[part]] > _EDGE_ON)
        ]

    @cached_property
    def _axes(self) -> NDArray[np.float64]:
        return np.array(self.frame)

    def _axis(self, name: str) -> NDArray[np.float64]:
        return self._axes[AXES.index(name)]

    def _normal(self, part: str) -> NDArray[np.float64]:
        """Return the axis (3,) of an axis or a ring, or the normal of a plane."""
        return self._axis(_ACROSS.get(part, part[-1]))

    def outline(self, part: str, camera: Camera, size: Size) -> NDArray[np.float64]:
        """Return the corners (n, 3) of a part: a line, a closed square or a closed ring."""
        length = axis_length(size) * camera.pixel_size(self.centre, size)
        if part == "s":
            right, up, _ = 0.16 * length * camera.axes()
            corners = [right + up, right - up, -right - up, -right + up, right + up]
        elif part in AXES:
            corners = [0.12 * length * self._axis(part), length * self._axis(part)]
        elif part.startswith("r"):
            u, w = np.delete(self._axes, AXES.index(part[1]), axis=0)
            corners = length * (np.cos(_RING)[:, None] * u + np.sin(_RING)[:, None] * w)
        else:
            u, w = self._axis(part[0]), self._axis(part[1])
            low, high = (length * share for share in _PLANE)
            corners = [low * (u + w), high * u + low * w, high * (u + w), low * u + high * w]
            corners.append(corners[0])
        return np.asarray(self.centre) + corners

    def part_at(self, pixel: ArrayLike, camera: Camera, size: Size) -> str | None:
        """Return the part under a pixel: the nearest within reach; a square, anywhere inside it."""
        distances = self._distances(pixel, camera, size)
        part = min(distances, key=lambda name: distances[name], default=None)
        return None if part is None or distances[part] >= REACH else part

    def distance(self, pixel: ArrayLike, camera: Camera, size: Size) -> float:
        """Return the distance in pixels from a pixel to the centre or, if nearer, to a part."""
        apart = camera.project(np.array([self.centre]), size)[0] - np.asarray(pixel)
        return min([float(np.hypot(*apart)), *self._distances(pixel, camera, size).values()])

    def _distances(self, pixel: ArrayLike, camera: Camera, size: Size) -> dict[str, float]:
        """Return the distance in pixels from a pixel to each part that can be used."""
        at, found = np.asarray(pixel, dtype=np.float64), {}
        for part in self.parts_seen(camera):
            line = camera.project(self.outline(part, camera, size), size)
            found[part] = 0.0 if is_square(part) and _inside(at, line) else _to_line(at, line)
        return found

    def step(
        self, part: str, start: ArrayLike, now: ArrayLike, camera: Camera, size: Size
    ) -> NDArray[np.float64] | None:
        """Return the amount by which the mouse drags a part from pixel `start` to pixel `now`.

        None where the view is so flat along the part that the mouse does not determine it.
        """
        if part == "s":
            return np.array([np.subtract(now, start)[0] / _DOUBLING])
        if part.startswith("r") and self._lies_flat(part, camera):
            right, up, backward = camera.axes()
            front = np.cross(self._normal(part), backward)  # where its front moves to
            tangent = np.array([front @ right, -front @ up])
            way = np.subtract(now, start) @ tangent / np.sqrt(tangent @ tangent)
            return np.array([way / axis_length(size)])
        places = [self._place(part, pixel, camera, size) for pixel in (start, now)]
        if places[0] is None or places[1] is None:
            return None
        step = places[1] - places[0]
        # Between two angles, the shorter way.
        return (step + np.pi) % (2.0 * np.pi) - np.pi if part.startswith("r") else step

    def _lies_flat(self, ring: str, camera: Camera) -> bool:
        return bool(abs(self._normal(ring) @ camera.axes()[2]) < _FLAT)

    def _place(
        self, part: str, pixel: ArrayLike, camera: Camera, size: Size
    ) -> NDArray[np.float64] | None:
        """Return where on a part a pixel is, in its amounts."""
        ray, centre = camera.ray(pixel, size), np.asarray(self.centre)
        if part in AXES:
            along = ray.along(centre, self._axis(part))
            return None if along is None else np.array([along])
        point = ray.on_plane(centre, self._normal(part))
        if point is None:
            return None
        if not part.startswith("r"):
            return np.array([self._axis(name) @ (point - centre) for name in part])
        u, w = self._axis(_NEXT[part[1]]), self._axis(_NEXT[_NEXT[part[1]]])
        return np.array([np.arctan2((point - centre) @ w, (point - centre) @ u)])

    def no_amount(self, part: str) -> NDArray[np.float64]:
        """Return the amount of a part that has not been dragged."""
        return np.zeros(2 if is_square(part) and part != "s" else 1)

    def amount_of(self, part: str, numbers: ArrayLike) -> NDArray[np.float64]:
        """Return the amount of typed numbers: distances, an angle in degrees, or a factor.

        A factor that is not above 0 counts as the smallest that is.
        """
        values = np.asarray(numbers, dtype=np.float64)
        if part == "s":
            return np.log2(np.maximum(values, _SMALLEST))
        return np.radians(values) if part.startswith("r") else values

    def words(self, part: str, amount: ArrayLike, typed: Sequence[str] | None = None) -> str:
        """Return how far a part has been dragged, in words.

        Args:
            part: the part.
            amount: of it.
            typed: the numbers as they are being typed, in place of those of `amount`.
        """
        amounts = np.asarray(amount, dtype=np.float64)
        if part == "s":
            return "× " + (typed[0] if typed else f"{2.0 ** amounts[0]:.3f}")
        if part.startswith("r"):
            turned = typed[0] if typed else f"{np.degrees(amounts[0]):.1f}"
            return f"{part[1].upper()}  {turned}°"
        numbers = typed or [f"{value:.4g}" for value in amounts]
        pairs = [f"{name.upper()}  {value}" for name, value in zip(part, numbers, strict=True)]
        return "   ".join(pairs) + " units"

    def motion(self, part: str, amount: ArrayLike) -> Motion:
        """Return the motion of a part by an amount."""
        amounts = np.asarray(amount, dtype=np.float64)
        if part == "s":
            return scaling(self.centre, float(2.0 ** amounts[0]))
        if part.startswith("r"):
            return rotation(self.centre, amounts[0] * self._axis(part[1]))
        return translation(sum(a * self._axis(name) for a, name in zip(amounts, part, strict=True)))


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
