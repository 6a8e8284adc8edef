"""Points that spread over a mesh or a set: each is the farthest from those before it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer.errors import InputError
from deformer.geometry.mesh import FloatArray, IntArray

if TYPE_CHECKING:
    from deformer.geometry.geodesics import Geodesics


def farthest_points(
    geodesics: Geodesics, count: int, seed: int | None = None, start: ArrayLike | None = None
) -> IntArray:
    """Vertices (count,) that spread over the mesh: each is the farthest from those before it.

    Args:
        geodesics: distances of the mesh.
        count: how many, at most V.
        seed: draws the first vertex, when `start` is None.
        start: vertices to begin with (they count).

    Returns:
        Indices in order of choice, all different. A component without a point is infinitely far,
        so every component gets one early.
    """
    V = len(geodesics.mesh.vertices)
    if not 1 <= count <= V:
        raise InputError(f"count: expected 1…{V} points, got {count}")
    if start is None:
        chosen = [int(np.random.default_rng(seed).integers(V))]
    else:
        chosen = [int(i) for i in np.atleast_1d(np.asarray(start))][:count]
    return _farthest(geodesics.row, chosen, count)[0]


def spread(points: FloatArray, count: int) -> IntArray:
    """Up to `count` of the points (N, d), straight-line farthest: each from those before it.

    The first is the one nearest to the origin.
    """
    first = int(np.linalg.norm(points, axis=1).argmin())
    count = min(count, len(points))
    return _farthest(lambda i: np.linalg.norm(points - points[i], axis=1), [first], count)[0]


def farthest_rows(points: NDArray, count: int) -> tuple[IntArray, IntArray]:
    """Farthest points among the rows (N, d), straight-line, from the first row on.

    Args:
        points: (N, d) rows, of any floating dtype; distances are computed in it.
        count: how many, at most N.

    Returns:
        Indices (count,) in order of choice; for every row (N,) which of the chosen, 0…count − 1,
        is nearest.
    """

    def squares_from(i: int) -> NDArray:
        difference = points - points[i]
        return np.einsum("nd,nd->n", difference, difference)

    return _farthest(squares_from, [0], count)


def _farthest(
    distances_from: Callable[[int], NDArray], first: list[int], count: int
) -> tuple[IntArray, IntArray]:
    """Continue the points `first` to `count`: each is the farthest from those before it.

    Args:
        distances_from: (N,) distances, or a growing function of them, from point i to all.
        first: points to begin with.
        count: how many in all, at most N.

    Returns:
        Indices (count,), all different where `first` are, and for every point (N,) which of them,
        0…count − 1, is nearest.
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
        # A chosen point is not chosen again, even where others are at no distance from it.
        nearest[chosen[n]], labels[chosen[n]] = -np.inf, n
    return np.array(chosen[:count], dtype=np.int64), labels
