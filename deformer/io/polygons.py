"""Polygons of a mesh file: comparison, and triangulation by fans and ear clipping."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io.ear_clipping import clip_ears

# Of a polygon's area: a triangle of a fan may be turned over by so much and still counts as flat.
_FLAT = 1e-9
# Corners that are compared with ears before polygons count as too intricate: seconds, and for every
# corner of the mesh so many more.
_MOST_TESTS, _TESTS_OF_CORNER = 30_000_000, 2_500


@dataclass(frozen=True, eq=False)
class Polygons:
    """Faces as a file has them.

    Args:
        corners: (M,) vertex indices of all polygons, one polygon after the other.
        counts: (n,) corners of each polygon, 3 or more.
    """

    corners: IntArray
    counts: IntArray

    @classmethod
    def of_triangles(cls, faces: IntArray) -> Polygons:
        """Triangles (F, 3)."""
        return cls(np.ascontiguousarray(faces, np.int64).ravel(), np.full(len(faces), 3, np.int64))

    def equals(self, other: Polygons) -> bool:
        """True if all polygons are the same, in the same order, from the same corner on."""
        return self is other or (
            np.array_equal(self.counts, other.counts)
            and np.array_equal(self.corners, other.corners)
        )

    def same_faces(self, other: Polygons) -> bool:
        """True if the polygons are the same in any order, each from any of its corners on."""
        if len(self.counts) != len(other.counts) or len(self.corners) != len(other.corners):
            return False
        pairs = zip(self._sorted(), other._sorted(), strict=True)
        return all(np.array_equal(a, b) for a, b in pairs)

    def covers(self, faces: IntArray) -> bool:
        """True if triangles (F, 3) are what the polygons are cut into, whichever way."""
        if len(faces) != (self.counts - 2).sum():
            return False
        starts = np.cumsum(self.counts) - self.counts
        polygon = np.repeat(np.arange(len(self.counts)), self.counts)
        place = np.arange(len(self.corners)) - starts[polygon]
        around: dict[int, dict[int, int]] = {}
        for vertex, p, n in zip(
            self.corners.tolist(), polygon.tolist(), place.tolist(), strict=True
        ):
            around.setdefault(vertex, {})[p] = n
        counts, left = self.counts.tolist(), (self.counts - 2).tolist()
        for triangle in faces.tolist():
            a, b, c = (around.get(vertex, {}) for vertex in triangle)
            for p in a.keys() & b.keys() & c.keys():
                forward = (b[p] - a[p]) % counts[p] < (c[p] - a[p]) % counts[p]
                if left[p] and forward and len(set(triangle)) == 3:
                    left[p] -= 1
                    break
            else:
                return False
        return True

    def _sorted(self) -> list[IntArray]:
        """Polygons (m, k) of each number k of corners, each from its least index on, sorted."""
        found = []
        starts = np.cumsum(self.counts) - self.counts
        for k in np.unique(self.counts):
            rows = self.corners[starts[self.counts == k][:, None] + np.arange(k)]
            least = rows.argmin(axis=1)[:, None]
            rows = np.take_along_axis(rows, (least + np.arange(k)) % k, axis=1)
            found.append(rows[np.lexsort(rows.T[::-1])])
        return found

    def fans(self) -> IntArray:
        """Triangles (F, 3), as fans around the first corner of each polygon."""
        counts = self.counts
        triangles = counts - 2
        polygon = np.repeat(np.arange(len(counts)), triangles)
        step = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
        hub = (np.cumsum(counts) - counts)[polygon]
        corners = self.corners
        return np.stack([corners[hub], corners[hub + step + 1], corners[hub + step + 2]], axis=1)

    def triangles(self, vertices: FloatArray, name: str) -> IntArray:
        """Triangles (F, 3), those of polygon 0 first.

        A polygon is a fan around its first corner, unless it is concave and its fan has a triangle
        without area or turned over against the polygon's normal (Newell's, which is exact for plane
        ones): then ears are clipped (Meisters 1975), and diagonals flipped until triangles are well
        shaped. A polygon without area, or one that crosses itself, stays a fan.

        Args:
            vertices: (V, 3) positions in the first shape, which decide for all.
            name: file name for messages.

        Raises:
            InputError: a polygon of very many corners that is too intricate.
        """
        faces = self.fans()
        if (self.counts == 3).all():
            return faces
        normals = self._normals(vertices)
        polygon = np.repeat(np.arange(len(self.counts)), self.counts - 2)
        starts = np.cumsum(self.counts - 2) - (self.counts - 2)
        with np.errstate(all="ignore"):
            flat = _FLAT * np.sum(normals**2, axis=1)
            areas = np.sum(_area_vectors(vertices, faces) * normals[polygon], axis=1)
            worst = np.minimum.reduceat(areas, starts)
            over = (worst < flat) & self._concave(vertices, normals, flat)
            quads = np.flatnonzero(over & (self.counts == 4))
            first = (np.cumsum(self.counts) - self.counts)[quads]
            a, b, c, d = (self.corners[first + k] for k in range(4))
            other = np.stack([np.stack([a, b, d], 1), np.stack([b, c, d], 1)], axis=1)
            other_areas = [
                np.sum(_area_vectors(vertices, other[:, k]) * normals[quads], axis=1)
                for k in range(2)
            ]
        fits = np.minimum(*other_areas) > np.maximum(worst[quads], -flat[quads])
        for k in range(2):
            faces[starts[quads[fits]] + k] = other[fits, k]
        tests = _MOST_TESTS + _TESTS_OF_CORNER * len(self.corners)
        corner_starts = np.cumsum(self.counts) - self.counts
        for i in np.flatnonzero(over & (self.counts > 4)):
            k = self.counts[i]
            ring = self.corners[corner_starts[i] : corner_starts[i] + k]
            points = _in_plane(vertices[ring], normals[i])
            clipped, tests = clip_ears(points, tests)
            if tests < 0:
                raise InputError(
                    f"{name}, polygon {i}: its {k} corners are too intricate to be cut into "
                    "triangles here; triangulate the mesh in your program"
                )
            if clipped is not None:
                faces[starts[i] : starts[i] + k - 2] = ring[clipped]
        return faces

    def _concave(
        self, vertices: FloatArray, normals: FloatArray, flat: FloatArray
    ) -> NDArray[np.bool_]:
        """True (n,) for polygons with a corner that turns against the normal."""
        starts = np.cumsum(self.counts) - self.counts
        ends = starts + self.counts - 1
        corners = np.arange(len(self.corners))
        before, after = corners - 1, corners + 1
        before[starts], after[ends] = ends, starts
        triples = self.corners[np.stack([before, corners, after], axis=1)]
        polygon = np.repeat(np.arange(len(self.counts)), self.counts)
        turns = np.sum(_area_vectors(vertices, triples) * normals[polygon], axis=1)
        return np.minimum.reduceat(turns, starts) < -flat

    def _normals(self, vertices: FloatArray) -> FloatArray:
        """Newell normals (n, 3): sums of the cross products of neighbouring corners."""
        starts = np.cumsum(self.counts) - self.counts
        following = np.arange(1, len(self.corners) + 1)
        following[starts + self.counts - 1] = starts
        with np.errstate(all="ignore"):
            # From the first corner of each, which keeps digits far from the origin.
            points = vertices[self.corners]
            points = points - np.repeat(points[starts], self.counts, axis=0)
            return np.add.reduceat(np.cross(points, points[following]), starts, axis=0)


def _area_vectors(vertices: FloatArray, faces: IntArray) -> FloatArray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _in_plane(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Points (k, 2) without the axis of the largest part of the normal, counter-clockwise."""
    axis = int(np.argmax(abs(normal)))
    kept = [(axis + 1) % 3, (axis + 2) % 3]
    flat = points[:, kept] - points[0, kept]
    return flat if normal[axis] > 0 else flat[:, ::-1]
