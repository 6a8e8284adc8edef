"""Seams: vertices that coincide in all shapes, since a file has one for each of their attributes.

Exporters split a vertex where texture coordinates or normals change. The surface is whole there: it
is closed for all computations, and opened again in what is written, vertex by vertex of the file.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import overload

import numpy as np
from scipy.spatial import KDTree

from deformer.geometry.mesh import FloatArray, IntArray, Mesh, MeshSequence, component_roots
from deformer.geometry.stored_shapes import ShapeSequence, map_shapes
from deformer.geometry.surface_points import SurfacePoint
from deformer.workspace import StoredArray, Workspace, blocks

# Vertices coincide if they are no farther apart in any shape, in its bounding diagonals. Single
# precision and texts with six decimals differ by less.
SEAM_TOLERANCE = 1e-6
# Neighbours of a vertex that are looked at: chains join more.
_NEIGHBOURS = 8
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Seams:
    """Which vertices of a file are one vertex of the closed surface.

    Args:
        closed: (V,) for every vertex of the file, its vertex of the closed surface; these are
            numbered from 0 by their first vertices.
    """

    closed: IntArray

    @cached_property
    def first(self) -> IntArray:
        """First vertex (U,) of the file for each of the U vertices of the closed surface."""
        return np.unique(self.closed, return_index=True)[1].astype(np.int64)

    def __bool__(self) -> bool:
        """True if any vertices coincide."""
        return len(self.first) < len(self.closed)

    def close(self, values: FloatArray) -> FloatArray:
        """Values (..., U, n) of the closed surface, from values (..., V, n) of the file."""
        return values[..., self.first, :] if self else values

    def open(self, values: FloatArray) -> FloatArray:
        """Values (..., V, n) of the file, from values (..., U, n) of the closed surface."""
        return values[..., self.closed, :] if self else values

    @overload
    def close_shapes(self, shapes: MeshSequence) -> MeshSequence: ...

    @overload
    def close_shapes(self, shapes: ShapeSequence, workspace: Workspace) -> ShapeSequence: ...

    def close_shapes(
        self, shapes: ShapeSequence, workspace: Workspace | None = None
    ) -> ShapeSequence:
        """Shapes of the closed surface; faces that it makes lines of are left out.

        Args:
            shapes: the shapes of the file.
            workspace: where the result is; None keeps it in memory.
        """
        if not self:
            return shapes
        faces = self._faces(shapes.faces)
        if workspace is not None:
            return map_shapes(shapes, self.close, workspace, faces)
        return MeshSequence(self.close(np.asarray(shapes.vertices)), faces)

    def close_mesh(self, mesh: Mesh) -> Mesh:
        """The mesh as `close_shapes` makes it."""
        return Mesh(self.close(mesh.vertices), self._faces(mesh.faces)) if self else mesh

    def close_point(self, point: int | SurfacePoint) -> int | SurfacePoint:
        """A vertex, or a point, of the closed surface."""
        if not self:
            return point
        if isinstance(point, int):
            return int(self.closed[point])
        vertices, owner = np.unique(self.closed[list(point.vertices)], return_inverse=True)
        weights = np.bincount(owner, point.weights)
        return SurfacePoint(tuple(vertices.tolist()), tuple(weights.tolist()), point.offset)

    def _faces(self, faces: IntArray) -> IntArray:
        found = self.closed[faces]
        whole = (found != np.roll(found, 1, axis=1)).all(axis=1)
        return found[whole] if whole.any() else found


def no_seams(vertex_count: int) -> Seams:
    """The seams of a mesh without any."""
    return Seams(np.arange(vertex_count))


def find_seams(vertices: FloatArray | StoredArray) -> Seams:
    """Vertices that coincide in all shapes (N, V, 3), within `SEAM_TOLERANCE`."""
    V = vertices.shape[1]
    exact = same_place(vertices)
    apart = np.unique(exact)
    extents = np.concatenate([np.ptp(vertices[part], axis=1) for part in blocks(vertices)])
    reach = SEAM_TOLERANCE * np.linalg.norm(extents, axis=1)
    # What is far apart in one shape need not be looked at in the others.
    count = min(_NEIGHBOURS, len(apart))
    p = vertices[0][apart]
    found = KDTree(p).query(p, count, distance_upper_bound=max(float(reach[0]), _TINY))
    i = np.repeat(apart, count)
    j = np.append(apart, V)[np.asarray(found[1]).reshape(-1)]
    i, j = i[(j < V) & (i != j)], j[(j < V) & (i != j)]
    for shape, most in zip(vertices, reach, strict=True):
        near = np.linalg.norm(shape[i] - shape[j], axis=1) <= most
        i, j = i[near], j[near]
    pairs = np.concatenate([np.stack([np.arange(V), exact], axis=1), np.stack([i, j], axis=1)])
    root = component_roots(pairs, V)
    number = np.cumsum(root == np.arange(V)) - 1
    return Seams(number[root])


def same_place(vertices: FloatArray | StoredArray) -> IntArray:
    """For every vertex of shapes (N, V, 3) the first vertex at exactly its place in all of them."""
    first = np.arange(vertices.shape[1])
    candidates, group = first.copy(), np.zeros(len(first))
    for shape in vertices:
        # Only vertices that share their place with another in all shapes before this one.
        rows = np.column_stack([group, shape[candidates] + 0.0])
        group = np.unique(rows, axis=0, return_inverse=True)[1].ravel()
        shared = np.bincount(group)[group] > 1
        candidates, group = candidates[shared], group[shared]
        if not len(candidates):
            return first
    _, index, label = np.unique(group, return_index=True, return_inverse=True)
    first[candidates] = candidates[index[label.ravel()]]
    return first
