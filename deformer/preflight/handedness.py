"""Shapes that are mirror images of the others, by measures that no motion without one changes.

The signed volume that a surface encloses changes its sign in a mirror image. Turns, bends and
twists keep the sign, however far they go. A shape whose volume has the other sign is mirrored if
mirroring it back brings the signed angles between its faces nearer to those of another shape.

A sheet encloses nothing, and may bend either way. One is called mirrored only if, by these angles,
it is unlike neighbours that are like each other, and like them after a reflection.
"""

from __future__ import annotations

import numpy as np

from deformer.geometry import FloatArray, IntArray, same_place
from deformer.preflight.connectivity import border_loops, half_edges
from deformer.preflight.neighbours import odd_ones
from deformer.preflight.statistics import Statistics, evenly
from deformer.workspace import Rows

# Area of the holes over that of the surface, in any of so many shapes, above which it is a sheet: a
# hemisphere has 0.5.
_HOLES, _OPENED = 0.4, 9
# Volume over the usual one, from which on its sign is clear.
_CLEAR = 0.2
# Mirroring back multiplies the least distance of angles between faces from another shape's by less.
_NEARER = 0.8
# Root mean square difference of angles between faces, in radians, from which on sheets differ.
_BENT = 0.02
_EDGES, _COMPARED = 2000, 200


def mirrored(measures: Statistics, kept: IntArray) -> IntArray:
    """Those of the shapes `kept` (n,) that are mirror images of most of them."""
    vertices, faces = measures.shapes.vertices, measures.shapes.faces
    corners = _across_edges(faces)
    if len(kept) < 3 or not len(corners):
        return kept[:0]
    # Along seams a surface is whole.
    solid = _Solid(same_place(vertices)[faces], vertices.shape[1])
    if max(solid.holes(vertices[n]) for n in kept[evenly(len(kept), _OPENED)]) > _HOLES:
        return _mirrored_sheets(vertices, corners, kept)
    volume = np.array([solid.volume(vertices[n]) for n in kept]) / measures.radius[kept] ** 3
    # Of as many on either side, those like the first are right.
    sign = np.sign(np.sign(volume).sum()) or np.sign(volume[0])
    other = sign * volume < -_CLEAR * np.median(np.abs(volume))
    if not other.any():
        return kept[:0]
    right = kept[~other][evenly(int((~other).sum()), _COMPARED)]
    angles = np.array([_dihedral_angles(vertices[n], corners) for n in right])
    found = []
    for n in kept[other]:
        own = _dihedral_angles(vertices[n], corners)
        back, as_it_is = (_rms(angles - sign * own).min() for sign in (-1.0, 1.0))
        if back < _NEARER * as_it_is:
            found.append(n)
    return np.array(found, dtype=np.int64)


def _mirrored_sheets(vertices: Rows, corners: IntArray, kept: IntArray) -> IntArray:
    """Sheets bent the other way than quiet neighbours, and like these after a reflection."""
    angles = {n: _dihedral_angles(vertices[n], corners) for n in kept.tolist()}

    def distance(one: IntArray, other: IntArray) -> FloatArray:
        pairs = zip(one.tolist(), other.tolist(), strict=True)
        return np.array([_rms(angles[n] - angles[m]) for n, m in pairs])

    found = []
    for n, near in odd_ones(kept, distance, _BENT).items():
        back = min(_rms(angles[n] + angles[m]) for m in near.tolist())
        if back <= distance(near[:-1], near[1:]).max():
            found.append(n)
    return np.array(found, dtype=np.int64)


def _rms(angles: FloatArray) -> FloatArray:
    """Root mean squares (…,) of angles (…, e)."""
    return np.sqrt((angles**2).mean(axis=-1))


class _Solid:
    """A surface whose holes are closed by fans of triangles about their middles.

    Args:
        faces: (F, 3).
        vertex_count: V.
    """

    def __init__(self, faces: IntArray, vertex_count: int) -> None:
        border, loop = border_loops(faces, vertex_count)
        self._start, self._loop, self._length = border[:, 0], loop, np.bincount(loop)
        fans = np.column_stack([border[:, ::-1], vertex_count + loop])
        # (3, F + B), corners first.
        self._corners = np.ascontiguousarray(np.concatenate([faces, fans]).T)
        self._faces = len(faces)

    def volume(self, p: FloatArray) -> float:
        """Signed volume that a shape (V, 3) encloses."""
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = self._at_corners(p)
        x, y, z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        return float((ax * x + ay * y + az * z).sum()) / 6.0

    def holes(self, p: FloatArray) -> float:
        """Area of the fans over that of the faces."""
        a, b, c = (q.T for q in self._at_corners(p))
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return float(areas[self._faces :].sum() / max(areas[: self._faces].sum(), 1e-300))

    def _at_corners(self, p: FloatArray) -> list[FloatArray]:
        """Positions (3, F + B) of each corner of faces and fans, about the mean of all."""
        p = p.T - p.mean(axis=0)[:, None]
        middles = [np.bincount(self._loop, x[self._start]) / self._length for x in p]
        p = np.concatenate([p, middles], axis=1)
        return [p.take(corner, axis=1) for corner in self._corners]


def _across_edges(faces: IntArray) -> IntArray:
    """Corners (e, 4) of inner edges, evenly chosen: the edge, and the tips of its two faces."""
    half = half_edges(faces)
    tips = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    keys = np.sort(half, axis=1)
    order = np.lexsort((keys[:, 1], keys[:, 0]))
    same = (keys[order][1:] == keys[order][:-1]).all(axis=1)
    first = np.flatnonzero(same)
    first = first[evenly(len(first), _EDGES)] if len(first) else first
    one, other = order[first], order[first + 1]
    return np.column_stack([half[one], tips[one], tips[other]])


def _dihedral_angles(p: FloatArray, corners: IntArray) -> FloatArray:
    """Signed angles (e,) between the faces at edges, 0 where they are flat."""
    a, b, c, d = (p[corners[:, k]] for k in range(4))
    n, m = np.cross(b - a, c - a), np.cross(d - a, b - a)
    sine = np.linalg.norm(b - a, axis=1) * np.einsum("ei,ei->e", n, d - a)
    return np.arctan2(sine, np.einsum("ei,ei->e", n, m))
