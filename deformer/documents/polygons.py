"""What polygon-mesh formats have in common: the form in which one becomes another."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deformer.documents.normals import mean_normals
from deformer.geometry import FloatArray, IntArray


@dataclass(frozen=True)
class Material:
    """A material: its name, and its base colour, linear RGBA of 0 to 1, where it is known."""

    name: str
    colour: tuple[float, float, float, float] | None = None


@dataclass(frozen=True)
class Part:
    """Names of what a polygon belongs to; empty where it has none."""

    object: str = ""
    group: str = ""


@dataclass(frozen=True, eq=False)
class PolygonMesh:
    """P polygons on V vertices, with C corners in all; positions come apart.

    Args:
        counts: (P,) corners of each polygon.
        corners: (C,) vertices of all polygons, one polygon after the other.
        uvs: (C, 2) texture coordinates, the origin at the lower left; NaN for a corner without.
            None if no corner has any.
        normals: (C,) number of each corner's normal, counted from 0: corners with one number are
            shaded as one, and edges between different numbers are hard; −1 for none. None if no
            corner has any.
        colours: (V, 3) or (V, 4) of 0 to 1, encoded as sRGB; None if there are none.
        material: (P,) index of each polygon's material; −1 for none.
        materials: the materials.
        part: (P,) index of what each polygon belongs to.
        parts: the objects and groups.
    """

    counts: IntArray
    corners: IntArray
    uvs: FloatArray | None
    normals: IntArray | None
    colours: FloatArray | None
    material: IntArray
    materials: tuple[Material, ...]
    part: IntArray
    parts: tuple[Part, ...]

    def corners_of(self, faces: IntArray) -> IntArray:
        """The corners (F, 3) that the corners of triangles are.

        Args:
            faces: (F, 3) vertices of the triangles that the polygons are cut into: each polygon of
                n corners is n − 2 triangles, one polygon after the other.
        """
        polygon = self.polygon_of_triangle
        start, size = (np.cumsum(self.counts) - self.counts)[polygon], self.counts[polygon]
        found = np.full(faces.shape, -1)
        for step in range(int(self.counts.max())):
            inside = step < size
            at = start + np.where(inside, step, 0)
            same = inside[:, None] & (self.corners[at][:, None] == faces) & (found < 0)
            found = np.where(same, at[:, None], found)
        return found

    @property
    def polygon_of_triangle(self) -> IntArray:
        """The polygon (F,) that each triangle is a part of."""
        return np.repeat(np.arange(len(self.counts)), self.counts - 2)

    def with_all_normals(self) -> PolygonMesh:
        """The mesh with a normal of its own for each polygon at corners that have none."""
        if self.normals is None or (self.normals >= 0).all():
            return self
        own = np.repeat(np.arange(len(self.counts)), self.counts) + self.normals.max() + 1
        keys = np.where(self.normals >= 0, self.normals, own)
        return replace(self, normals=numbered(keys))

    def shading(self, vertices: FloatArray) -> FloatArray:
        """Unit normals (G, 3) by their numbers.

        Args:
            vertices: (V, 3) positions.
        """
        if self.normals is None:
            return np.empty((0, 3))
        count = int(self.normals.max()) + 1
        found = mean_normals(vertices, self.counts, self.corners, self.normals, count)
        # Formats demand unit vectors, of degenerate polygons too.
        found[~found.any(axis=1)] = (0.0, 0.0, 1.0)
        return found


def numbered(*keys: IntArray) -> IntArray:
    """Numbers (C,) from 0 of the combinations of the keys (C,); −1 where a key is −1."""
    rows = np.stack(keys, axis=1)
    chosen = (rows >= 0).all(axis=1)
    found = np.full(len(rows), -1)
    found[chosen] = np.unique(rows[chosen], axis=0, return_inverse=True)[1].ravel()
    return found


def first_of_each(owners: IntArray, values: FloatArray, count: int) -> tuple[FloatArray, bool]:
    """The value of each owner, NaN without one, and true if no owner has two.

    Args:
        owners: (n,) index of each value's owner.
        values: (n, k).
        count: owners.
    """
    found = np.full((count, values.shape[1]), np.nan)
    found[owners[::-1]] = values[::-1]
    return found, bool(np.array_equal(found[owners], values, equal_nan=True))
