"""Cotangent weights of a mesh's edges, its Laplacian L, and the right-hand side b(T) of L p = b(T).

The one double-precision version of b_i(T) = Σ_j ½ c_ij (T_i + T_j)(v_i − v_j), in three forms: as a
compiled loop, as a sparse matrix, and its adjoint. The solver's kernels and the torch backend have
versions in single precision, which the tests compare with this one.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from deformer.compilation import called_with, njit
from deformer.geometry.mesh import FloatArray, Mesh

# Bounds on the cotangent weight of an edge. Cotangents have no unit: the bounds suit any scale.
MIN_COTAN_WEIGHT = 1e-2
MAX_COTAN_WEIGHT = 1e2


def cotan_weights(mesh: Mesh) -> sparse.csr_array:
    """Symmetric (V, V) matrix of cotangent weights c_ij = ½(cot α_ij + cot β_ij) of the edges.

    Slivers, obtuse triangles and coincident vertices give negative, huge or undefined cotangents.
    Twice a triangle's area is therefore clamped to at least 1e-12 of its longest squared edge (a
    triangle shrunk to a point has the cotangent 0), and the sum over the triangles of an edge to
    [MIN_COTAN_WEIGHT, MAX_COTAN_WEIGHT]. Every edge has a positive finite weight, and the Laplacian
    is positive semi-definite on any mesh.

    Args:
        mesh: V vertices in any unit.
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


def graph_laplacian(weights: sparse.csr_array) -> sparse.csr_array:
    """Laplacian L = diag(Σ_j c_ij) − C (V, V) of symmetric edge weights C (V, V)."""
    degree = np.asarray(weights.sum(axis=1)).ravel()
    return sparse.csr_array(sparse.diags_array(degree) - weights)


@njit(nogil=True, error_model="numpy")
def rhs_(start, stop, indptr, rings, c, v, T, b):
    """b_i = Σ_j ½ c_ij (T_i + T_j)(v_i − v_j) of gradients T (V, 3, 3), for rows start…stop − 1.

    The right-hand side of the reconstruction p = argmin Σ_i Σ_j c_ij ‖(p_i − p_j) − T_i (v_i −
    v_j)‖² (Tan et al. 2018, section 3; Gao et al. 2019).

    Args:
        start, stop: range of rows.
        indptr, rings: one-rings in compressed rows.
        c: (2E,) weights c_ij of the entries of `rings`.
        v: (V, 3) reference vertices.
        T: (V, 3, 3) deformation gradients.
        b: (V, 3) output; rows outside the range are not changed.
    """
    for i in range(start, stop):
        bx = by = bz = 0.0
        for k in range(indptr[i], indptr[i + 1]):
            j = rings[k]
            x = 0.5 * c[k] * (v[i, 0] - v[j, 0])
            y = 0.5 * c[k] * (v[i, 1] - v[j, 1])
            z = 0.5 * c[k] * (v[i, 2] - v[j, 2])
            bx += (T[i, 0, 0] + T[j, 0, 0]) * x
            bx += (T[i, 0, 1] + T[j, 0, 1]) * y
            bx += (T[i, 0, 2] + T[j, 0, 2]) * z
            by += (T[i, 1, 0] + T[j, 1, 0]) * x
            by += (T[i, 1, 1] + T[j, 1, 1]) * y
            by += (T[i, 1, 2] + T[j, 1, 2]) * z
            bz += (T[i, 2, 0] + T[j, 2, 0]) * x
            bz += (T[i, 2, 1] + T[j, 2, 1]) * y
            bz += (T[i, 2, 2] + T[j, 2, 2]) * z
        b[i, 0] = bx
        b[i, 1] = by
        b[i, 2] = bz


@called_with(
    "void(i8, i8, i8[::1], i8[::1], f8[::1], Array(f8, 2, 'C', True), f8[::1], f8[:, ::1])"
)
@njit(nogil=True, error_model="numpy")
def rhs_adjoint_(start, stop, indptr, rings, c, v, green, out):
    """Coefficients a_i = Σ_j ½ c_ij (G_i − G_j)(v_i − v_j) with Σ_i G_i b_i(T) = Σ_i T_i a_i.

    Args:
        start, stop: range of rows i.
        indptr, rings, c, v: as in `rhs_`.
        green: G (V,), a row of the inverse of the Laplacian.
        out: a (V, 3), output; rows outside the range are not changed.
    """
    for i in range(start, stop):
        x = y = z = 0.0
        for k in range(indptr[i], indptr[i + 1]):
            j = rings[k]
            w = 0.5 * c[k] * (green[i] - green[j])
            x += w * (v[i, 0] - v[j, 0])
            y += w * (v[i, 1] - v[j, 1])
            z += w * (v[i, 2] - v[j, 2])
        out[i, 0] = x
        out[i, 1] = y
        out[i, 2] = z


def rhs_matrix(weights: sparse.csr_array, v: FloatArray) -> sparse.csr_array:
    """Matrix D (V, 3V) with b(T) = D columns(T); row 3i + d of columns(T) is column d of T_i.

    Args:
        weights: (V, V) symmetric edge weights c_ij.
        v: (V, 3) reference vertices.
    """
    V = len(v)
    rows = np.repeat(np.arange(V), np.diff(weights.indptr))
    # ½ c_ij (v_i − v_j) multiplies T_j, and their sum over the ring T_i.
    edges = 0.5 * weights.data[:, None] * (v[rows] - v[weights.indices])
    own = np.zeros((V, 3))
    np.add.at(own, rows, edges)
    data = np.concatenate([edges, own])
    row = np.concatenate([rows, np.arange(V)])
    column = np.concatenate([weights.indices, np.arange(V)])
    return sparse.csr_array(
        (data.ravel(), (np.repeat(row, 3), (3 * column[:, None] + np.arange(3)).ravel())),
        shape=(V, 3 * V),
    )
