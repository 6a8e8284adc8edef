"""Farthest-point sampling of a mesh or a set of points."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer.checks import (
    as_array,
    checked_array,
    checked_indices,
    checked_instance,
    checked_integer,
)
from deformer.geometry.mesh import FloatArray, IntArray

if TYPE_CHECKING:
    from deformer.geometry.geodesics import Geodesics


def farthest_points(
    geodesics: Geodesics, count: int, seed: int | None = None, start: ArrayLike | None = None
) -> IntArray:
    """Vertices spread over a mesh: each is the one farthest from those before it.

    Args:
        geodesics: distances over the mesh of V vertices.
        count: number of vertices, at most V.
        seed: seed of the random first vertex, used if `start` is None.
        start: (n,) vertices to begin with; they are among the `count`.

    Returns:
        Indices (count,) in order of choice, all different. A connected component without a chosen
        vertex is infinitely far, so every component gets one early.

    Raises:
        InputError: `count` is not in 1…V.
    """
    from deformer.geometry.geodesics import Geodesics  # needs numba's kernels, this module does not

    checked_instance(geodesics, "geodesics", Geodesics, remedy="make them of a mesh")
    V = len(geodesics.mesh.vertices)
    count = checked_integer(count, "count", least=1, most=V, remedy="ask for as many as there are")
    if seed is not None:
        checked_integer(seed, "seed", least=0)
    if start is None:
        chosen = [int(np.random.default_rng(seed).integers(V))]
    else:
        chosen = checked_indices(np.atleast_1d(as_array(start, "start")), "start", V).tolist()[
            :count
        ]
    return _farthest(geodesics.row, chosen, count)[0]


def spread(points: FloatArray, count: int) -> IntArray:
    """Farthest points of a set, by Euclidean distance, from the one nearest to the origin on.

    Args:
        points: (N, d).
        count: number of points, unless N is less.

    Returns:
        Indices in order of choice.
    """
    points = checked_array(points, "points", ("N", "d"))
    count = checked_integer(count, "count", least=1)
    first = int(np.linalg.norm(points, axis=1).argmin())
    count = min(count, len(points))
    return _farthest(lambda i: np.linalg.norm(points - points[i], axis=1), [first], count)[0]


def farthest_rows(points: NDArray, count: int) -> tuple[IntArray, IntArray]:
    """Farthest points of a set, by Euclidean distance, from the first one on.

    Args:
        points: (N, d), of any floating dtype; distances are computed in it.
        count: number of points, at most N.

    Returns:
        Indices (count,) in order of choice; and, for every point (N,), the number of the nearest
        chosen one, 0…count − 1.
    """

    # Coordinate by coordinate: rows of a few numbers would take ten times as long.
    coordinates = np.ascontiguousarray(points.T)

    def squares_from(i: int) -> NDArray:
        total = np.zeros(len(points), dtype=points.dtype)
        for coordinate in coordinates:
            difference = coordinate - coordinate[i]
            difference *= difference
            total += difference
        return total

    return _farthest(squares_from, [0], count)


def _farthest(
    distances_from: Callable[[int], NDArray], first: list[int], count: int
) -> tuple[IntArray, IntArray]:
    """Farthest points, from the points `first` on: each is the farthest from those before it.

    Args:
        distances_from: gives the distances (N,) from point i to all, or an increasing function of
            them.
        first: points to begin with, all different.
        count: number of points with `first`, at most N.

    Returns:
        Indices (count,), all different; and, for every point (N,), the number of the nearest chosen
        one, 0…count − 1.
    """
    chosen = list(first)
    nearest = distances_from(chosen[0]).copy()
    labels = np.zeros(len(nearest), dtype=np.int64)
    for n in range(count):
        if n == len(chosen):
            chosen.append(int(nearest.argmax()))
        if n > 0:
            distances = distances_from(chosen[n])
            closer = distances < nearest
            nearest[closer] = distances[closer]
            labels[closer] = n
        # A chosen point is not chosen again, even if all others coincide with it.
        nearest[chosen[n]], labels[chosen[n]] = -np.inf, n
    return np.array(chosen[:count], dtype=np.int64), labels
