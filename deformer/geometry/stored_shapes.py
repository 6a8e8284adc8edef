"""Sequences of shapes that memory does not hold: their positions are in a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from deformer.checks import checked_indices, checked_instance
from deformer.errors import InputError
from deformer.geometry.mesh import (
    FloatArray,
    IntArray,
    Mesh,
    MeshSequence,
    checked_faces,
    checked_names,
    checked_shape,
)
from deformer.workspace import Empty, Rows, StoredArray, Workspace, blocks


@dataclass(frozen=True, eq=False)
class StoredShapes:
    """N shapes with one connectivity, as a `MeshSequence`, whose positions are in a file.

    Args:
        vertices: (N, V, 3) positions in double precision, finite; read in parts.
        faces: (F, 3) vertex indices shared by all shapes, kept as int64.
        names: N texts, one for each shape; empty if the shapes have no names.

    Raises:
        InputError: wrong shape, or an index out of range.
    """

    vertices: StoredArray
    faces: IntArray
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check shapes and indices."""
        checked_instance(self.vertices, "vertices", StoredArray, remedy="load shapes with memory")
        if self.vertices.ndim != 3 or self.vertices.shape[2] != 3 or 0 in self.vertices.shape:
            raise InputError(f"vertices: expected (N, V, 3), got {self.vertices.shape}; correct it")
        object.__setattr__(self, "faces", checked_faces(self.faces, self.vertices.shape[1]))
        object.__setattr__(self, "names", checked_names(self.names, len(self.vertices)))

    def __len__(self) -> int:
        """Count the shapes."""
        return len(self.vertices)

    def mesh(self, index: int) -> Mesh:
        """Shape `index` as a Mesh; negative indices count from the end.

        Raises:
            InputError: no such shape.
        """
        return Mesh(self.vertices[checked_shape(index, len(self))], self.faces)

    def subset(self, indices: ArrayLike) -> StoredShapes:
        """Shapes at `indices` (n,), in that order, in the same file.

        Raises:
            InputError: no such shape.
        """
        chosen = checked_indices(indices, "indices", len(self), what="shape")
        names = tuple(self.names[i] for i in chosen) if self.names else ()
        return StoredShapes(self.vertices.take(chosen), self.faces, names)


# Shapes wherever their positions are.
ShapeSequence = MeshSequence | StoredShapes


def shape_sequence(vertices: Rows, faces: IntArray, names: tuple[str, ...] = ()) -> ShapeSequence:
    """Shapes of positions (N, V, 3) in memory, which become read-only, or in a file."""
    if isinstance(vertices, StoredArray):
        return StoredShapes(vertices, faces, names)
    vertices.setflags(write=False)
    return MeshSequence(vertices, faces, names)


def map_shapes(
    shapes: ShapeSequence,
    change: Callable[[FloatArray], FloatArray],
    workspace: Workspace,
    faces: IntArray | None = None,
) -> ShapeSequence:
    """Changed shapes, part by part.

    Args:
        shapes: N shapes.
        change: gives positions (n, U, 3) for those of n shapes (n, V, 3).
        workspace: where the result is.
        faces: (F, 3) of the result; None keeps them.
    """
    faces = shapes.faces if faces is None else faces
    vertices = shapes.vertices
    count = change(vertices[:1]).shape[1]
    out = workspace.doubles((len(shapes), count, 3))
    for part in blocks(vertices):
        out[part] = change(vertices[part])
    return shape_sequence(out, faces, shapes.names)


def joined_shapes(first: FloatArray, shapes: ShapeSequence, last: FloatArray, empty: Empty) -> Rows:
    """Positions of shapes with others before (m, V, 3) and after them (n, V, 3).

    Args:
        first, shapes, last: with one number of vertices.
        empty: makes the array.
    """
    N, V = shapes.vertices.shape[:2]
    out = empty((len(first) + N + len(last), V, 3))
    out[: len(first)] = first
    for part in blocks(shapes.vertices):
        out[part.start + len(first) : part.stop + len(first)] = shapes.vertices[part]
    out[len(first) + N : len(out)] = last
    return out
