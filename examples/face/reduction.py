"""Reduction of a symmetric face to fewer of its own vertices, the same on both sides."""

from __future__ import annotations

import numpy as np
from decimation import adjacency, compact, decimate, worst_triangles
from numpy.typing import NDArray

import deformer
from face.kit import Face

# Misfit of the mirror images up to which a face counts as symmetric, in bounding diagonals.
SYMMETRIC = 1e-4


def reduce_face(face: Face, vertex_count: int) -> Face:
    """The face over about `vertex_count` of its vertices; most stay where expressions strain it.

    One side is decimated, and the other gets the mirror images of its triangles. Vertices on
    boundaries (eyes, mouth, neck) and on the plane of symmetry all stay.

    Args:
        face: V vertices, symmetric about a plane through edges.
        vertex_count: number of vertices that stay, on both sides together.

    Raises:
        deformer.InputError: the neutral face is not symmetric.
        ValueError: the face cannot be reduced so far.
    """
    symmetry = deformer.find_symmetry(deformer.Mesh(face.neutral, face.faces))
    if symmetry.error > SYMMETRIC:
        raise deformer.InputError(
            f"the neutral face differs from its mirror image by {symmetry.error:.2g} bounding "
            f"diagonals, expected at most {SYMMETRIC:g}; give the kit's generic neutral mesh"
        )
    opposite = symmetry.opposite
    middle = opposite == np.arange(len(opposite))
    beside = (face.neutral - symmetry.point) @ symmetry.normal > 0
    half, kept = compact(face.faces[(beside | middle)[face.faces].all(axis=1)])
    points = face.neutral[kept]
    even = np.clip(worst_triangles(points, half) / 0.03, 0.2, 1)
    count = (vertex_count + np.count_nonzero(middle)) // 2
    reduced = kept[decimate(points, half, strain_importance(face)[kept] * even, count)]
    faces, kept = compact(np.concatenate([reduced, opposite[reduced][:, [0, 2, 1]]]))
    offsets = {name: offset[kept] for name, offset in face.offsets.items()}
    return Face(face.neutral[kept], faces, offsets)


def strain_importance(face: Face) -> NDArray:
    """Importance (V,) for the decimation: 1 where nothing moves, up to 20 at strained vertices.

    The strain of an edge is the length of the difference of its ends' displacements over the
    edge's length, as a root mean square over expressions; that of a vertex is its edges' largest.
    """
    edges = np.stack(adjacency(face.faces, len(face.neutral)).tocoo().coords, axis=1)
    i, j = edges.T
    square = sum(((offset[i] - offset[j]) ** 2).sum(axis=1) for offset in face.offsets.values())
    length = ((face.neutral[i] - face.neutral[j]) ** 2).sum(axis=1)
    strain = np.zeros(len(face.neutral))
    np.maximum.at(strain, i, np.sqrt(square / (len(face.offsets) * length)))
    return 1 + 19 * np.clip(strain / np.percentile(strain, 95), 0, 1)
