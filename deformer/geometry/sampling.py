"""Points that spread over a mesh or a set: each is the farthest from those before it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

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
    nearest = np.min([geodesics.row(i) for i in chosen], axis=0)
    while len(chosen) < count:
        taken = nearest.copy()
        taken[chosen] = -1.0
        chosen.append(int(taken.argmax()))
        nearest = np.minimum(nearest, geodesics.row(chosen[-1]))
    return np.array(chosen, dtype=np.int64)


def spread(points: FloatArray, count: int) -> IntArray:
    """Up to `count` of the points (N, d), straight-line farthest: each from those before it.

    The first is the one nearest to the origin.
    """
    chosen = [int(np.linalg.norm(points, axis=1).argmin())]
    nearest = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen, dtype=np.int64)
