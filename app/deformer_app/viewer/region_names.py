"""Names of the places that regions of components have on a shape."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer_app.rendering.camera import upright_axes

# A region beyond this share of the shape's size from the middle of its bounding box is on a side;
# beyond the smaller share, if that tells it from others.
_OFF, _NEAR = 1 / 6, 1 / 20
_SIDES = (("left", "right"), ("top", "bottom"), ("front", "back"))  # in order of `upright_axes`
_LEFT, _UP, _FRONT = range(3)
_ORDER = (_UP, _FRONT, _LEFT)  # "top front left"
_FLAT = 0.4  # a shape thinner than this share of its size has no front and back parts
_LEVEL = 0.05  # share of the height up and down within which parts are at the same height


def region_names(centres: ArrayLike, vertices: NDArray[np.float64], up: str) -> list[str]:
    """Name regions by their place on a shape: "Top", "Bottom left", "Middle"; no name twice.

    Left and right are told by the box of the whole shape and, in its middle, by what the shape has
    at the same height: arms that are stretched out do not move the feet to the middle. Regions of
    one name also get the sides on which they are by little; those that are alike then are numbered
    from left to right, from top to bottom, or from front to back.

    Args:
        centres: (n, 3) of the regions.
        vertices: (V, 3) of the shape.
        up: the shape's up axis. Left is the shape's own, as of somebody who faces the viewer.
    """
    axes = upright_axes(up)
    points = vertices @ axes.T
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.maximum(high - low, 1e-9 * float((high - low).max()) + 1e-300)
    middle = (low + high) / 2
    points = (points - middle) / size
    places = (np.asarray(centres) @ axes.T - middle) / size
    told = [n for n in _ORDER if n != _FRONT or size[n] > _FLAT * size.max()]
    sides = np.zeros(places.shape, dtype=np.int64)
    sides[:, told] = _sides(places[:, told], _OFF)
    for n in np.flatnonzero(sides[:, _LEFT] == 0):
        sides[n, _LEFT] = _side_at_height(places[n], points)
    _tell_apart(sides, places, told)
    return _numbered(_texts(sides), places * size)


def _sides(values: NDArray[np.float64], beyond: float) -> NDArray[np.int64]:
    """1, −1 or 0 for values on the first side, on the second, or on neither."""
    return (np.sign(values) * (np.abs(values) > beyond)).astype(np.int64)


def _side_at_height(place: NDArray[np.float64], points: NDArray[np.float64]) -> int:
    """The side, left or right, of a place (3,) among the points (V, 3) at its height."""
    level = points[np.abs(points[:, _UP] - place[_UP]) <= _LEVEL, _LEFT]
    if not len(level):
        return 0
    low, high = float(level.min()), float(level.max())
    if not low <= place[_LEFT] <= high:  # in a gap of the shape
        return 0
    if low > 0 or high < 0:  # such as the one arm that is raised
        return 1 if low > 0 else -1
    off = place[_LEFT] - (low + high) / 2
    return int(np.sign(off)) if abs(off) > _OFF * (high - low) + 1e-9 else 0


def _tell_apart(sides: NDArray[np.int64], places: NDArray[np.float64], told: list[int]) -> None:
    """Add sides (n, 3) to regions of the same name where that tells them apart."""
    for rows in _alike(_texts(sides)):
        others = {name for n, name in enumerate(_texts(sides)) if n not in rows}
        spread = np.ptp(places[rows], axis=0)
        for axis in sorted(told, key=lambda n: -spread[n]):
            found = sides[rows]
            found[:, axis] = np.where(
                found[:, axis], found[:, axis], _sides(places[rows, axis], _NEAR)
            )
            names = set(_texts(found))
            if len(names) > 1 and not names & others:
                sides[rows] = found
                break


def _alike(names: list[str]) -> list[list[int]]:
    """Indices of the names that are there several times, by name."""
    found = defaultdict(list)
    for n, name in enumerate(names):
        found[name].append(n)
    return [rows for rows in found.values() if len(rows) > 1]


def _texts(sides: NDArray[np.int64]) -> list[str]:
    """Names of regions by their sides (n, 3)."""
    words = ([_SIDES[n][int(row[n] < 0)] for n in _ORDER if row[n]] for row in sides.tolist())
    return [" ".join(found).capitalize() or "Middle" for found in words]


def _numbered(names: list[str], places: NDArray[np.float64]) -> list[str]:
    """The names, with numbers from the second of equal ones on, in order of their places (n, 3)."""
    found = list(names)
    for rows in _alike(names):
        axis = int(np.ptp(places[rows], axis=0).argmax())
        for number, n in enumerate(sorted(rows, key=lambda n: -places[n, axis])):
            if number:
                found[n] = f"{names[n]} {number + 1}"
    return found
