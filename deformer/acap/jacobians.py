"""Handle positions as functions of features and latent codes, and their derivatives.

They contract T = exp(r) S and its derivative with the coefficients of the positions on one side,
and with the decoder's derivative on the other. Handle positions are linear in the deformation
gradients, p_h = Σ_i T_i a_h,i with the coefficients a of `PoissonSystem.position_coefficients`.
Positions and their gradients with respect to the features therefore need one pass over the vertices
and no linear solve.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deformer.acap.gradients import features_to_gradients
from deformer.compilation import called_with, njit
from deformer.geometry import FloatArray, exp_, right_jacobian_
from deformer.linalg import over_ranges, scratch

# Vertices whose tangents are in memory at once: the memory must not grow with the mesh.
_VERTEX_BATCH = 8192
# Index of S_ab among the six stored entries xx xy xz yy yz zz.
_ENTRY = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


@njit(nogil=True, error_model="numpy")
def gradient_derivative_(q, R, J, D):
    """D (9, 3, 3) = ∂T/∂q_m of T = exp(r) S at a feature q (9,) = (r, S); R and J (3, 3) are spare.

    The one double-precision version. exp(r + δ) = exp(r) exp(J δ) to first order, so that
    ∂T/∂r_m = R [J_m]× S with column m of the right Jacobian J, and ∂T/∂s_m = R ∂S/∂s_m.
    """
    exp_(q, R)
    right_jacobian_(q, J)
    for a in range(3):
        x, y, z = R[a, 0], R[a, 1], R[a, 2]
        for b in range(3):
            s0, s1, s2 = q[3 + _ENTRY[0, b]], q[3 + _ENTRY[1, b]], q[3 + _ENTRY[2, b]]
            # Row a of R times [J_m]× column b of S is J_m · (column b of S × row a of R).
            c0, c1, c2 = s1 * z - s2 * y, s2 * x - s0 * z, s0 * y - s1 * x
            for m in range(3):
                D[m, a, b] = J[0, m] * c0 + J[1, m] * c1 + J[2, m] * c2
            for m in range(3, 9):
                D[m, a, b] = 0.0
            for d in range(3):
                D[3 + _ENTRY[d, b], a, b] = R[a, d]


@njit(nogil=True, error_model="numpy")
def _sensitivities(q, coefficients, g):
    """g[3h + d, 9i + m] = ∂p_h,d / ∂q_i,m."""
    R, J, D = np.empty((3, 3)), np.empty((3, 3)), np.empty((9, 3, 3))
    for i in range(len(q)):
        gradient_derivative_(q[i], R, J, D)
        for h in range(len(coefficients)):
            x, y, z = coefficients[h, i, 0], coefficients[h, i, 1], coefficients[h, i, 2]
            for d in range(3):
                for m in range(9):
                    g[3 * h + d, 9 * i + m] = D[m, d, 0] * x + D[m, d, 1] * y + D[m, d, 2] * z


@called_with("void(i8, i8, f8[:, ::1], f8[:, ::1], f4[:, :, ::1], f4[:, ::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def _decoder_tangents(start, stop, q, slope, matrix, out):
    """out[3 i + b, a K + k] = ∂T_i,ab / ∂z_k."""
    R, J, D = np.empty((3, 3)), np.empty((3, 3)), np.empty((9, 3, 3))
    c = np.empty(9, dtype=np.float32)
    K = matrix.shape[2]
    for i in range(start, stop):
        gradient_derivative_(q[i], R, J, D)
        M = matrix[i]
        M0, M1, M2, M3, M4, M5, M6, M7, M8 = M[0], M[1], M[2], M[3], M[4], M[5], M[6], M[7], M[8]
        for b in range(3):
            for a in range(3):
                for m in range(9):
                    c[m] = slope[i, m] * D[m, a, b]
                row = out[3 * i + b, a * K : (a + 1) * K]
                # In two passes: the compiler checks few pairs of arrays for overlap.
                c0, c1, c2, c3, c4 = c[0], c[1], c[2], c[3], c[4]
                for k in range(K):
                    row[k] = c0 * M0[k] + c1 * M1[k] + c2 * M2[k] + c3 * M3[k] + c4 * M4[k]
                c0, c1, c2, c3 = c[5], c[6], c[7], c[8]
                for k in range(K):
                    row[k] += c0 * M5[k] + c1 * M6[k] + c2 * M7[k] + c3 * M8[k]


@njit(nogil=True, error_model="numpy")
def _tangents(q, dq, dT):
    """dT[k, i] = Σ_m ∂T_i/∂q_i,m dq[k, i, m]."""
    R, J, D = np.empty((3, 3)), np.empty((3, 3)), np.empty((9, 3, 3))
    for i in range(len(q)):
        gradient_derivative_(q[i], R, J, D)
        for k in range(len(dq)):
            for a in range(3):
                for b in range(3):
                    total = 0.0
                    for m in range(9):
                        total += D[m, a, b] * dq[k, i, m]
                    dT[k, i, a, b] = total


def positions_from_features(q: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Sums Σ_i T_i(q_i) a_h,i (H, 3) for features q (V, 9) and coefficients a (H, V, 3)."""
    T = features_to_gradients(q).transpose(0, 2, 1).reshape(-1, 3)
    return coefficients.reshape(len(coefficients), len(T)) @ T


def position_sensitivities(q: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Gradient (H, 3, V, 9) of `positions_from_features` with respect to the features.

    Args:
        q: (V, 9) features.
        coefficients: a (H, V, 3).
    """
    g = np.empty((3 * len(coefficients), 9 * len(q)))
    _sensitivities(np.ascontiguousarray(q), coefficients, g)
    return g.reshape(len(coefficients), 3, len(q), 9)


def position_jacobian(
    q: FloatArray, slope: FloatArray, matrix: NDArray, coefficients: NDArray
) -> FloatArray:
    """Derivative (H, 3, K) of Σ_i T_i(z) a_h,i for features q_i = f(M_i z + base).

    Args:
        q: (n, 9) features.
        slope: (n, 9) derivative of f at these features.
        matrix: M (n, 9, K) float32.
        coefficients: a (H, n, 3) float32.
    """
    n, _, K = matrix.shape
    J = np.zeros((len(coefficients), 3 * K))
    for start in range(0, n, _VERTEX_BATCH):
        part = slice(start, min(start + _VERTEX_BATCH, n))
        size = part.stop - start
        tangents = scratch("tangents", (3 * size, 3 * K))
        layer = q[part], slope[part], matrix[part]
        over_ranges(_decoder_tangents, size, *layer, tangents)
        J += coefficients[:, part].reshape(len(coefficients), 3 * size) @ tangents
    return J.reshape(len(coefficients), 3, K)


def gradient_tangents(q: FloatArray, dq: FloatArray) -> FloatArray:
    """Change of T (m, V, 3, 3) under changes dq (m, V, 9) of the features q (V, 9)."""
    dT = np.empty((len(dq), len(q), 3, 3))
    _tangents(np.ascontiguousarray(q), np.ascontiguousarray(dq), dT)
    return dT
