"""Cotangent weights of a mesh's edges, the weights of its Laplacian."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from deformer.geometry.mesh import Mesh

# Bounds on the cotangent weight of an edge. Cotangents have no unit, so these hold at any scale.
MIN_COTAN_WEIGHT = 1e-2


MAX_COTAN_WEIGHT = 1e2


def cotan_weights(mesh: Mesh) -> sparse.csr_array:
    """Symmetric (V, V) matrix of cotangent weights c_ij = ½(cot α_ij + cot β_ij) of the edges.

    Slivers, obtuse triangles and coincident vertices give negative, huge or undefined cotangents.
    A triangle's double area is taken as at least 1e-12 of its longest squared edge (and a triangle
    shrunk to a point counts 0), and the sum over the triangles of an edge is clamped to
    [MIN_COTAN_WEIGHT, MAX_COTAN_WEIGHT]; every edge therefore has a positive finite weight, and
    the Laplacian built from them is positive semi-definite on any mesh.
    """
    v, f = mesh.vertices, mesh.faces
    rows, columns, values = [], [], []
    for corner in range(3):
        i, j, k = f[:, corner], f[:, (corner + 1) % 3], f[:, (corner + 2) % 3]
        to_j, to_k = v[j] - v[i], v[k] - v[i]
        double_area = np.linalg.norm(np.cross(to_j, to_k), axis=1)
        longest = np.maximum((to_j**2).sum(1), (to_k**2).sum(1))
        floor = np.maximum(1e-12 * longest, np.finfo(float).tiny)
        rows.append(j)
        columns.append(k)
        values.append(0.5 * (to_j * to_k).sum(1) / np.maximum(double_area, floor))
    row, column = np.concatenate(rows), np.concatenate(columns)
    value = np.concatenate(values)
    keep = row != column
    row, column, value = row[keep], column[keep], value[keep]
    V = len(v)
    # Each edge is summed once and mirrored: adding a matrix and its transpose would drop edges
    # whose sum is zero, and round differently on the two sides.
    pairs, edge = np.unique(
        np.sort(np.column_stack([row, column]), axis=1), axis=0, return_inverse=True
    )
    total = np.bincount(edge.ravel(), weights=value, minlength=len(pairs))
    weights = sparse.csr_array(
        (
            np.tile(total, 2),
            (np.append(pairs[:, 0], pairs[:, 1]), np.append(pairs[:, 1], pairs[:, 0])),
        ),
        shape=(V, V),
    )
    weights.sort_indices()
    np.clip(weights.data, MIN_COTAN_WEIGHT, MAX_COTAN_WEIGHT, out=weights.data)
    return weights
