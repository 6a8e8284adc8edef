"""T = exp(r) S and its derivatives, contracted with what stands on either side of it.

Handle positions are linear in the deformation gradients, p_h = Σ_i T_i a_h,i with the coefficients
a of `PoissonSystem.position_coefficients`. Positions and their gradients with respect to the
features therefore need one pass over the vertices and no linear solve.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from deformer.acap.features import features_to_gradients
from deformer.geometry import FloatArray, exp_, right_jacobian_
from deformer.linalg import over_ranges, scratch

# Vertices whose tangents are there at once: their memory must not grow with the mesh.
_PORTION = 8192
# Place of S_ab among the six stored entries xx xy xz yy yz zz.
_ENTRY = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


@njit(cache=True, nogil=True, error_model="numpy")
def _sensitivities(q, coefficients, g):
    """g[3h + d, 9i + m] = ∂p_h,d / ∂q_i,m."""
    R = np.empty((3, 3))
    J = np.empty((3, 3))
    for i in range(len(q)):
        exp_(q[i, :3], R)
        right_jacobian_(q[i, :3], J)
        s = q[i, 3:]
        for h in range(len(coefficients)):
            a0, a1, a2 = coefficients[h, i]
            y0 = s[0] * a0 + s[1] * a1 + s[2] * a2
            y1 = s[1] * a0 + s[3] * a1 + s[4] * a2
            y2 = s[2] * a0 + s[4] * a1 + s[5] * a2
            for d in range(3):
                x, y, z = R[d, 0], R[d, 1], R[d, 2]
                c0 = z * y1 - y * y2
                c1 = x * y2 - z * y0
                c2 = y * y0 - x * y1
                row = g[3 * h + d, 9 * i : 9 * i + 9]
                row[0] = c0 * J[0, 0] + c1 * J[1, 0] + c2 * J[2, 0]
                row[1] = c0 * J[0, 1] + c1 * J[1, 1] + c2 * J[2, 1]
                row[2] = c0 * J[0, 2] + c1 * J[1, 2] + c2 * J[2, 2]
                row[3] = x * a0
                row[4] = x * a1 + y * a0
                row[5] = x * a2 + z * a0
                row[6] = y * a1
                row[7] = y * a2 + z * a1
                row[8] = z * a2


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _decoder_tangents(start, stop, q, slope, matrix, out):
    """out[3 i + b, a K + k] = ∂T_i,ab / ∂z_k."""
    R = np.empty((3, 3))
    J = np.empty((3, 3))
    c = np.empty(9, dtype=np.float32)
    K = matrix.shape[2]
    for i in range(start, stop):
        exp_(q[i, :3], R)
        right_jacobian_(q[i, :3], J)
        e, s, M = slope[i], q[i, 3:], matrix[i]
        M0, M1, M2, M3, M4, M5, M6, M7, M8 = M[0], M[1], M[2], M[3], M[4], M[5], M[6], M[7], M[8]
        for b in range(3):
            # Column b of S, and where its entries stand among the six of the stretch.
            s0, s1, s2 = s[_ENTRY[0, b]], s[_ENTRY[1, b]], s[_ENTRY[2, b]]
            for a in range(3):
                x, y, z = R[a, 0], R[a, 1], R[a, 2]
                c[:] = 0.0
                for m in range(3):
                    turned = x * (J[1, m] * s2 - J[2, m] * s1)
                    turned += y * (J[2, m] * s0 - J[0, m] * s2)
                    turned += z * (J[0, m] * s1 - J[1, m] * s0)
                    c[m] = e[m] * turned
                for d in range(3):
                    m = 3 + _ENTRY[d, b]
                    c[m] += e[m] * R[a, d]
                row = out[3 * i + b, a * K : (a + 1) * K]
                # In two passes: the compiler checks few pairs of arrays for overlap.
                c0, c1, c2, c3, c4 = c[0], c[1], c[2], c[3], c[4]
                for k in range(K):
                    row[k] = c0 * M0[k] + c1 * M1[k] + c2 * M2[k] + c3 * M3[k] + c4 * M4[k]
                c0, c1, c2, c3 = c[5], c[6], c[7], c[8]
                for k in range(K):
                    row[k] += c0 * M5[k] + c1 * M6[k] + c2 * M7[k] + c3 * M8[k]


@njit(cache=True, nogil=True, error_model="numpy")
def _tangents(q, dq, dT):
    R = np.empty((3, 3))
    J = np.empty((3, 3))
    D = np.empty((3, 3))
    S = np.empty((3, 3))
    w = np.empty(3)
    for i in range(len(q)):
        exp_(q[i, :3], R)
        right_jacobian_(q[i, :3], J)
        s = q[i, 3:]
        S[0, 0], S[0, 1], S[0, 2] = s[0], s[1], s[2]
        S[1, 0], S[1, 1], S[1, 2] = s[1], s[3], s[4]
        S[2, 0], S[2, 1], S[2, 2] = s[2], s[4], s[5]
        for k in range(len(dq)):
            e = dq[k, i]
            for d in range(3):
                w[d] = J[d, 0] * e[0] + J[d, 1] * e[1] + J[d, 2] * e[2]
            # D = [w]× S + dS, then dT = R D.
            for b in range(3):
                D[0, b] = w[1] * S[2, b] - w[2] * S[1, b]
                D[1, b] = w[2] * S[0, b] - w[0] * S[2, b]
                D[2, b] = w[0] * S[1, b] - w[1] * S[0, b]
            D[0, 0] += e[3]
            D[0, 1] += e[4]
            D[1, 0] += e[4]
            D[0, 2] += e[5]
            D[2, 0] += e[5]
            D[1, 1] += e[6]
            D[1, 2] += e[7]
            D[2, 1] += e[7]
            D[2, 2] += e[8]
            for a in range(3):
                for b in range(3):
                    dT[k, i, a, b] = R[a, 0] * D[0, b] + R[a, 1] * D[1, b] + R[a, 2] * D[2, b]


def positions_from_features(q: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Sums Σ_i T_i(q_i) a_h,i (H, 3) for features q (V, 9) and coefficients (H, V, 3)."""
    T = features_to_gradients(q).transpose(0, 2, 1).reshape(-1, 3)
    return coefficients.reshape(len(coefficients), len(T)) @ T


def position_sensitivities(q: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Gradient (H, 3, V, 9) of `positions_from_features` with respect to the features q (V, 9)."""
    g = np.empty((3 * len(coefficients), 9 * len(q)))
    _sensitivities(np.ascontiguousarray(q), coefficients, g)
    return g.reshape(len(coefficients), 3, len(q), 9)


def position_jacobian(
    q: FloatArray, slope: FloatArray, matrix: NDArray, coefficients: NDArray
) -> FloatArray:
    """Derivative (H, 3, K) of Σ_i T_i(z) a_h,i where features are q_i = f(M_i z + base).

    Args:
        q: (n, 9) features.
        slope: (n, 9) derivative of f there.
        matrix: M (n, 9, K), single precision.
        coefficients: (H, n, 3), single precision.
    """
    n, _, K = matrix.shape
    J = np.zeros((len(coefficients), 3 * K))
    for start in range(0, n, _PORTION):
        part = slice(start, min(start + _PORTION, n))
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
