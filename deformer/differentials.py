"""T = exp(r) S and its derivatives, contracted with what stands on either side of it.

Handle positions are linear in the deformation gradients, p_h = Σ_i T_i a_h,i (the arms a of
`PoissonSystem.arms`), so positions and their gradients with respect to the features come out of
one pass over the vertices, without a linear solve.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from deformer.mesh import FloatArray
from deformer.rotations import exp_, right_jacobian_


@njit(cache=True, nogil=True, error_model="numpy")
def _positions(q, arms, p):
    R = np.empty((3, 3))
    p[:] = 0.0
    for i in range(len(q)):
        exp_(q[i, :3], R)
        s = q[i, 3:]
        for h in range(len(arms)):
            a0, a1, a2 = arms[h, i]
            y0 = s[0] * a0 + s[1] * a1 + s[2] * a2
            y1 = s[1] * a0 + s[3] * a1 + s[4] * a2
            y2 = s[2] * a0 + s[4] * a1 + s[5] * a2
            for d in range(3):
                p[h, d] += R[d, 0] * y0 + R[d, 1] * y1 + R[d, 2] * y2


@njit(cache=True, nogil=True, error_model="numpy")
def _scaled_sensitivities(q, arms, scale, g):
    """g[3h + d, 9i + m] = scale[i, m] ∂p_h,d / ∂q_i,m in the precision of g."""
    R = np.empty((3, 3))
    J = np.empty((3, 3))
    for i in range(len(q)):
        exp_(q[i, :3], R)
        right_jacobian_(q[i, :3], J)
        s = q[i, 3:]
        e = scale[i]
        for a in range(3):
            for b in range(3):
                J[a, b] *= e[b]
        for h in range(len(arms)):
            a0, a1, a2 = arms[h, i]
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
                row[3] = e[3] * (x * a0)
                row[4] = e[4] * (x * a1 + y * a0)
                row[5] = e[5] * (x * a2 + z * a0)
                row[6] = e[6] * (y * a1)
                row[7] = e[7] * (y * a2 + z * a1)
                row[8] = e[8] * (z * a2)


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


def arm_positions(q: FloatArray, arms: FloatArray) -> FloatArray:
    """Sums Σ_i T_i(q_i) a_h,i (H, 3) for features q (V, 9) and arms (H, V, 3)."""
    p = np.empty((len(arms), 3))
    _positions(np.ascontiguousarray(q), arms, p)
    return p


def arm_sensitivities(q: FloatArray, arms: FloatArray) -> FloatArray:
    """Gradient (H, 3, V, 9) of `arm_positions` with respect to the features q (V, 9)."""
    g = np.empty((3 * len(arms), 9 * len(q)))
    _scaled_sensitivities(np.ascontiguousarray(q), arms, np.ones((len(q), 9)), g)
    return g.reshape(len(arms), 3, len(q), 9)


def scaled_sensitivities(q: FloatArray, arms: FloatArray, scale: FloatArray) -> NDArray:
    """Gradient of handle positions times `scale` (V, 9): (3H, 9V), single precision."""
    g = np.empty((3 * len(arms), 9 * len(q)), dtype=np.float32)
    _scaled_sensitivities(q, arms, scale, g)
    return g


def gradient_tangents(q: FloatArray, dq: FloatArray) -> FloatArray:
    """Change of T (m, V, 3, 3) under changes dq (m, V, 9) of the features q (V, 9)."""
    dT = np.empty((len(dq), len(q), 3, 3))
    _tangents(np.ascontiguousarray(q), np.ascontiguousarray(dq), dT)
    return dT
