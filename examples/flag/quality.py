"""Quality of a simulated flag: stretch of its edges, swing of its free edge, self-intersections."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


def edges_of(faces: NDArray) -> NDArray:
    """Edges (E, 2) of faces (F, 3), each once."""
    half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(half, axis=1), axis=0)


def stretches(vertices: NDArray, edges: NDArray, rest: NDArray) -> NDArray:
    """Length over length at rest (N, E) of edges (E, 2) in shapes (N, V, 3)."""
    i, j = edges.T
    now = np.linalg.norm(vertices[:, i] - vertices[:, j], axis=2)
    return now / np.linalg.norm(rest[i] - rest[j], axis=1)


def swing_angles(vertices: NDArray, shape: tuple[int, int]) -> NDArray:
    """Angle (N,) in degrees about the pole of the middle of the free edge, 0 along +x.

    Args:
        vertices: (N, V, 3) shapes of a flag.
        shape: its columns and rows of vertices.
    """
    free = vertices.reshape(len(vertices), *shape, 3)[:, -1].mean(axis=1)
    return np.degrees(np.arctan2(free[:, 1], free[:, 0]))


def count_intersections(vertices: NDArray, faces: NDArray) -> int:
    """How many pairs of an edge and a face without a common vertex cut each other in a shape.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
    """
    points = np.asarray(vertices, dtype=np.float64)
    corners = points[faces]
    # In the order of their lowest x, the faces that an edge may cut are consecutive.
    order = np.argsort(corners[:, :, 0].min(axis=1), kind="stable")
    corners = corners[order]
    return int(
        _count(points, edges_of(faces), faces[order], corners.min(axis=1), corners.max(axis=1))
    )


@njit(cache=True)
def _count(points, edges, faces, low, high):
    found = 0
    widest = (high[:, 0] - low[:, 0]).max()
    for s in range(len(edges)):
        p, q = points[edges[s, 0]], points[edges[s, 1]]
        least, most = np.minimum(p, q), np.maximum(p, q)
        for f in range(np.searchsorted(low[:, 0], least[0] - widest), len(faces)):
            if low[f, 0] > most[0]:
                break
            apart = False
            for k in range(3):
                apart |= low[f, k] > most[k] or high[f, k] < least[k]
            if apart:
                continue
            a, b, c = faces[f]
            i, j = edges[s]
            if i in (a, b, c) or j in (a, b, c):
                continue
            if _cuts(p, q - p, points[a], points[b] - points[a], points[c] - points[a]):
                found += 1
    return found


@njit(cache=True)
def _cuts(origin, ray, corner, e, f):
    """Whether a segment meets a triangle (Möller and Trumbore); parallel ones do not."""
    h = np.cross(ray, f)
    determinant = (e * h).sum()
    if determinant == 0.0:
        return False
    s = origin - corner
    u = (s * h).sum() / determinant
    g = np.cross(s, e)
    v = (ray * g).sum() / determinant
    t = (f * g).sum() / determinant
    return u >= 0.0 and v >= 0.0 and u + v <= 1.0 and 0.0 <= t <= 1.0
