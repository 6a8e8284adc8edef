"""Triangulation of one plane polygon by ear clipping (Meisters 1975), improved by flips."""

from __future__ import annotations

import numpy as np

from deformer.geometry import FloatArray, IntArray

# Of the polygon's area: corners that enclose less are on one line.
_FLAT = 1e-9
# What one ear costs, in comparisons of a corner with it.
_TESTS_OF_EAR = 1_000
# Passes over the diagonals, and by how much a flip must improve the worse triangle.
_MOST_PASSES, _GAIN = 20, 1e-6


def clip_ears(points: FloatArray, tests: int) -> tuple[IntArray | None, int]:
    """Triangles (k − 2, 3) of a simple polygon; None if it has no ear.

    Args:
        points: (k, 2) its corners, counter-clockwise.
        tests: how many comparisons of a corner with an ear are allowed.

    Returns:
        the triangles, and what is left of the number of `tests`; below 0 it gave up.
    """
    k = len(points)
    before, after = np.roll(np.arange(k), 1), np.roll(np.arange(k), -1)
    alive = np.ones(k, bool)
    whole = abs(_double_area(points, np.roll(points, -1, axis=0), np.zeros(2)).sum())
    flat = _FLAT * whole
    found: list[tuple[int, int, int]] = []
    at, missed, strict = 0, 0, True
    while len(found) < k - 3:
        a, c = before[at], after[at]
        area = _double_area(points[a], points[at], points[c])
        tests -= _TESTS_OF_EAR
        # A corner on the line of its neighbours cuts nothing off.
        ear = not strict and abs(area) <= flat
        if area > flat:
            rest = np.flatnonzero(alive)
            tests -= len(rest)
            ear = not _any_inside(points[rest], points[[a, at, c]])
        if tests < 0:
            return None, tests
        if ear:
            found.append((int(a), at, int(c)))
            alive[at] = False
            after[a], before[c] = c, a
            missed, strict = 0, True
            # Goes on behind the next corner: ears on alternate sides make fewer slivers.
            at = int(after[c])
        else:
            missed += 1
            at = int(c)
            if missed > k - len(found):
                if not strict:
                    return None, tests
                missed, strict = 0, False
    a, b, c = np.flatnonzero(alive)
    return _flipped(points, np.array([*found, (a, b, c)], np.int64)), tests


def _flipped(points: FloatArray, faces: IntArray) -> IntArray:
    """Triangles whose diagonals are flipped where the worse of two triangles becomes better."""
    xy: list[list[float]] = points.tolist()
    triangles: list[list[int]] = faces.tolist()
    # The triangle to the left of each directed edge.
    left = {edge: t for t, face in enumerate(triangles) for edge in _edges(face)}
    for _ in range(_MOST_PASSES):
        changed = False
        for i, j in [edge for edge in left if edge[0] < edge[1]]:
            if (i, j) not in left or (j, i) not in left:
                continue
            t, u = left[i, j], left[j, i]
            k, m = _opposite(triangles[t], i, j), _opposite(triangles[u], j, i)
            now = min(_quality(xy, i, j, k), _quality(xy, j, i, m))
            if min(_quality(xy, k, m, j), _quality(xy, m, k, i)) > now + _GAIN:
                del left[i, j], left[j, i]
                triangles[t], triangles[u] = [k, m, j], [m, k, i]
                left |= {edge: n for n in (t, u) for edge in _edges(triangles[n])}
                changed = True
        if not changed:
            break
    return np.array(triangles, np.int64)


def _edges(face: list[int]) -> tuple[tuple[int, int], ...]:
    a, b, c = face
    return (a, b), (b, c), (c, a)


def _opposite(face: list[int], i: int, j: int) -> int:
    return next(corner for corner in face if corner not in (i, j))


def _quality(xy: list[list[float]], i: int, j: int, k: int) -> float:
    """Signed area of a triangle over the sum of its squared sides: largest for equal sides."""
    (ax, ay), (bx, by), (cx, cy) = xy[i], xy[j], xy[k]
    ux, uy, vx, vy = bx - ax, by - ay, cx - ax, cy - ay
    squares = ux * ux + uy * uy + vx * vx + vy * vy + (vx - ux) ** 2 + (vy - uy) ** 2
    return (ux * vy - uy * vx) / squares if squares > 0 else 0.0


def _double_area(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Twice the signed area of triangles with corners (…, 2)."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (
        c[..., 0] - a[..., 0]
    )


def _any_inside(points: FloatArray, triangle: FloatArray) -> bool:
    """True if a point (m, 2) lies in a triangle or on its edges, its own corners left out."""
    a, b, c = triangle
    inside = (_double_area(a, b, points) >= 0) & (_double_area(b, c, points) >= 0)
    inside &= _double_area(c, a, points) >= 0
    own = (points[:, None] == triangle[None]).all(axis=2).any(axis=1)
    return bool((inside & ~own).any())
