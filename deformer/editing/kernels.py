"""Kernels of a frame: single precision, 16 vertices at a time.

A block is 16 vertices, the lanes of the processor's vectors. Nine numbers a vertex are stored as
nine rows of 16. The kernels index flat arrays by sums of constants and the lane: where an array
has two indices the compiler cannot tell that its rows do not overlap, and gives up on vectors.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

LANES = 16

# Constants as single precision: a double one would turn whole loops into double precision.
_0, _1, _2, _HALF, _QUARTER = (np.float32(x) for x in (0, 1, 2, 0.5, 0.25))
_9, _TINY = np.float32(9), np.float32(1e-30)
# Of Newton steps of rotations, against their scale: what single precision cannot tell from zero.
DAMPING = np.float32(1e-5)
# Tangent of half the largest angle of one such step.
FARTHEST = np.float32(0.6)
_TURN = np.float32(2 * math.pi)
_PER_TURN = np.float32(0.5 / math.pi)
# Local steps go this much further than their optimum, as over-relaxation does: rounds of local and
# global steps then converge in about half as many. From 2 on they would diverge.
FURTHER = np.float32(1.5)
# tanh y as a continued fraction of seven terms, multiplied out: exact to 1e-8 up to y = 2.25.
_N0, _N1, _N2, _N3 = (np.float32(x / 135135) for x in (135135, 17325, 378, 1))
_D1, _D2, _D3 = (np.float32(x / 135135) for x in (62370, 3150, 28))
# Taylor series of sin(u)/u and cos(u) in u², exact to 4e-8 up to u = π/2.
_S = tuple(np.float32((-1) ** n / math.factorial(2 * n + 1)) for n in range(7))
_C = tuple(np.float32((-1) ** n / math.factorial(2 * n)) for n in range(8))
_S1, _S2, _S3, _S4, _S5, _S6 = _S[1:]
_C1, _C2, _C3, _C4, _C5, _C6, _C7 = _C[1:]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True, inline="always")
def tanh_(x):
    """In place for numbers x (n,): tanh x from tanh(x/4) by doubling the argument twice."""
    for n in range(len(x)):
        y = _QUARTER * min(max(x[n], -_9), _9)
        u = y * y
        t = y * (_N0 + u * (_N1 + u * (_N2 + u * _N3)))
        t /= _1 + u * (_D1 + u * (_D2 + u * _D3))
        t = _2 * t / (_1 + t * t)
        x[n] = _2 * t / (_1 + t * t)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def gradients(q, T):
    """T (144,) = exp(r) S of features q (144,).

    The rotation vector is brought within half a turn, then becomes a quaternion.
    """
    for n in range(16):
        rx, ry, rz = q[n], q[16 + n], q[32 + n]
        angle = math.sqrt(rx * rx + ry * ry + rz * rz) + _TINY
        inside = angle - _TURN * np.float32(np.int32(angle * _PER_TURN + _HALF))
        half = _HALF * inside
        u = half * half
        s = _1 + u * (_S1 + u * (_S2 + u * (_S3 + u * (_S4 + u * (_S5 + u * _S6)))))
        w = _1 + u * (_C1 + u * (_C2 + u * (_C3 + u * (_C4 + u * (_C5 + u * (_C6 + u * _C7))))))
        s *= half / angle
        a, b, c, d = w, s * rx, s * ry, s * rz
        R00, R11 = _1 - _2 * (c * c + d * d), _1 - _2 * (b * b + d * d)
        R22 = _1 - _2 * (b * b + c * c)
        R01, R10 = _2 * (b * c - a * d), _2 * (b * c + a * d)
        R02, R20 = _2 * (b * d + a * c), _2 * (b * d - a * c)
        R12, R21 = _2 * (c * d - a * b), _2 * (c * d + a * b)
        xx, xy, xz = q[48 + n], q[64 + n], q[80 + n]
        yy, yz, zz = q[96 + n], q[112 + n], q[128 + n]
        T[n] = R00 * xx + R01 * xy + R02 * xz
        T[16 + n] = R00 * xy + R01 * yy + R02 * yz
        T[32 + n] = R00 * xz + R01 * yz + R02 * zz
        T[48 + n] = R10 * xx + R11 * xy + R12 * xz
        T[64 + n] = R10 * xy + R11 * yy + R12 * yz
        T[80 + n] = R10 * xz + R11 * yz + R12 * zz
        T[96 + n] = R20 * xx + R21 * xy + R22 * xz
        T[112 + n] = R20 * xy + R21 * yy + R22 * yz
        T[128 + n] = R20 * xz + R21 * yz + R22 * zz


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def coefficients_by_block(start, stop, order, coefficients, scale, out):
    """Blocks out (·, 48) of coefficients (V, 3) times scale; zeros fill up the last one."""
    for B in range(start, stop):
        for n in range(16):
            i = 16 * B + n
            for d in range(3):
                out[B, 16 * d + n] = scale * coefficients[order[i], d] if i < len(order) else 0.0


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def emit(start, stop, q, coefficients, T, sums):
    """Gradients T (9 a vertex) of blocks with features q (·, 144).

    To sums (48 H,), lane by lane, go the products T_i a_h,i with the coefficients of H handles.
    """
    t = np.empty(144, dtype=np.float32)
    H = len(sums) // 48
    # There may be room for more handles than there are.
    stride = len(coefficients) // (len(T) // 144)
    for B in range(start, stop):
        gradients(q[B - start], t)
        for h in range(H):
            o, g = B * stride + 48 * h, 48 * h
            for n in range(16):
                x, y, z = coefficients[o + n], coefficients[o + 16 + n], coefficients[o + 32 + n]
                sums[g + n] += t[n] * x + t[16 + n] * y + t[32 + n] * z
                sums[g + 16 + n] += t[48 + n] * x + t[64 + n] * y + t[80 + n] * z
                sums[g + 32 + n] += t[96 + n] * x + t[112 + n] * y + t[128 + n] * z
        for n in range(16):
            o = 144 * B + 9 * n
            T[o], T[o + 1], T[o + 2] = t[n], t[16 + n], t[32 + n]
            T[o + 3], T[o + 4], T[o + 5] = t[48 + n], t[64 + n], t[80 + n]
            T[o + 6], T[o + 7], T[o + 8] = t[96 + n], t[112 + n], t[128 + n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def decode(start, stop, layer, q):
    """Features q (stop − start, 144) of blocks, q[B] = gain tanh(Σ_k z_k matrix_k + base) + offset.

    matrix[slices[B]:slices[B + 1]] holds block B for the listed components, in units of `scale`.
    """
    slices, components, scale, matrix, z, base, gain, offset = layer
    for B in range(start, stop):
        x = q[B - start]
        x[:] = base
        for e in range(slices[B], slices[B + 1]):
            weight = z[components[e]] * scale[e]
            row = matrix[e]
            for n in range(144):
                x[n] += weight * np.float32(row[n])
        tanh_(x)
        for n in range(144):
            x[n] = gain[n] * x[n] + offset[n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def decode_and_emit(start, stop, layer, coefficients, T, sums):
    """Features by `_decode`, then `emit`, a few blocks at once: features stay in the cache."""
    q = np.empty((32, 144), dtype=np.float32)
    for B in range(start, stop, len(q)):
        end = min(B + len(q), stop)
        decode(B, end, layer, q)
        emit(B, end, q, coefficients, T, sums)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def rhs(start, stop, indptr, rings, edges, own, T, b):
    """b_i = Σ_j ½ c_ij (T_i + T_j)(v_i − v_j) with edges ½ c_ij (v_i − v_j), own their sums."""
    for i in range(start, stop):
        o, x, y, z = 9 * i, own[3 * i], own[3 * i + 1], own[3 * i + 2]
        bx = T[o] * x + T[o + 1] * y + T[o + 2] * z
        by = T[o + 3] * x + T[o + 4] * y + T[o + 5] * z
        bz = T[o + 6] * x + T[o + 7] * y + T[o + 8] * z
        for k in range(indptr[i], indptr[i + 1]):
            o, x, y, z = 9 * rings[k], edges[3 * k], edges[3 * k + 1], edges[3 * k + 2]
            bx += T[o] * x + T[o + 1] * y + T[o + 2] * z
            by += T[o + 3] * x + T[o + 4] * y + T[o + 5] * z
            bz += T[o + 6] * x + T[o + 7] * y + T[o + 8] * z
        b[3 * i] = bx
        b[3 * i + 1] = by
        b[3 * i + 2] = bz


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def turned_rhs(start, stop, indptr, rings, halves, rest, R, b):
    """b_i = Σ_j ½ c_ij (R_i + R_j)(x_i − x_j) with halves ½ c_ij and the positions x at rest."""
    for i in range(start, stop):
        o = 9 * i
        a00, a01, a02 = R[o], R[o + 1], R[o + 2]
        a10, a11, a12 = R[o + 3], R[o + 4], R[o + 5]
        a20, a21, a22 = R[o + 6], R[o + 7], R[o + 8]
        px, py, pz = rest[3 * i], rest[3 * i + 1], rest[3 * i + 2]
        bx = by = bz = _0
        for k in range(indptr[i], indptr[i + 1]):
            j, o, w = 3 * rings[k], 9 * rings[k], halves[k]
            x, y, z = w * (px - rest[j]), w * (py - rest[j + 1]), w * (pz - rest[j + 2])
            bx += (a00 + R[o]) * x + (a01 + R[o + 1]) * y + (a02 + R[o + 2]) * z
            by += (a10 + R[o + 3]) * x + (a11 + R[o + 4]) * y + (a12 + R[o + 5]) * z
            bz += (a20 + R[o + 6]) * x + (a21 + R[o + 7]) * y + (a22 + R[o + 8]) * z
        b[3 * i] = bx
        b[3 * i + 1] = by
        b[3 * i + 2] = bz


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def fit_step(A, D):
    """One step of quaternions D (64,) towards the rotations closest to A (144,).

    Newton's, (tr M − M) ω = axial M with the symmetric part of M = R Aᵀ, and where that is not
    definite, far from the maximum, the fixed-point iteration of Müller et al. (A Robust Method to
    Extract the Rotational Part of Deformations, 2016). Neither needs a decomposition, and both
    hold for flat rings, whose A is singular.
    """
    for n in range(16):
        a, b, c, d = D[n], D[16 + n], D[32 + n], D[48 + n]
        R00, R11 = _1 - _2 * (c * c + d * d), _1 - _2 * (b * b + d * d)
        R22 = _1 - _2 * (b * b + c * c)
        R01, R10 = _2 * (b * c - a * d), _2 * (b * c + a * d)
        R02, R20 = _2 * (b * d + a * c), _2 * (b * d - a * c)
        R12, R21 = _2 * (c * d - a * b), _2 * (c * d + a * b)
        A00, A01, A02 = A[n], A[16 + n], A[32 + n]
        A10, A11, A12 = A[48 + n], A[64 + n], A[80 + n]
        A20, A21, A22 = A[96 + n], A[112 + n], A[128 + n]
        M00 = R00 * A00 + R01 * A01 + R02 * A02
        M11 = R10 * A10 + R11 * A11 + R12 * A12
        M22 = R20 * A20 + R21 * A21 + R22 * A22
        M01, M10 = R00 * A10 + R01 * A11 + R02 * A12, R10 * A00 + R11 * A01 + R12 * A02
        M02, M20 = R00 * A20 + R01 * A21 + R02 * A22, R20 * A00 + R21 * A01 + R22 * A02
        M12, M21 = R10 * A20 + R11 * A21 + R12 * A22, R20 * A10 + R21 * A11 + R22 * A12
        u, v, w = M12 - M21, M20 - M02, M01 - M10
        # A near-zero trace (a ring turned by 90° or collapsed) must not spin wildly.
        scale = max(abs(M00 + M11 + M22), math.sqrt(u * u + v * v + w * w)) + _TINY
        scale = _1 / scale
        u, v, w = scale * u, scale * v, scale * w
        xx, yy = scale * (M11 + M22) + DAMPING, scale * (M00 + M22) + DAMPING
        zz = scale * (M00 + M11) + DAMPING
        xy, xz = -_HALF * scale * (M01 + M10), -_HALF * scale * (M02 + M20)
        yz = -_HALF * scale * (M12 + M21)
        # By the adjugate; its minors tell whether the matrix is definite.
        c00, c01, c02 = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        c11, c12, c22 = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
        det = xx * c00 + xy * c01 + xz * c02
        newton = xx > _0 and c22 > _0 and det > DAMPING * DAMPING
        f = _HALF / det if newton else _HALF
        x = f * (c00 * u + c01 * v + c02 * w) if newton else f * u
        y = f * (c01 * u + c11 * v + c12 * w) if newton else f * v
        z = f * (c02 * u + c12 * v + c22 * w) if newton else f * w
        # Not further than the quadratic model can be trusted.
        f = min(_1, FARTHEST / math.sqrt(x * x + y * y + z * z + _TINY))
        x, y, z = f * x, f * y, f * z
        e, f = a - x * b - y * c - z * d, b + x * a + y * d - z * c
        g, h = c - x * d + y * a + z * b, d + x * c - y * b + z * a
        scale = _1 / math.sqrt(e * e + f * f + g * g + h * h)
        D[n], D[16 + n], D[32 + n], D[48 + n] = scale * e, scale * f, scale * g, scale * h


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _follow(D, q):
    """Quaternions q (64,) followed by D (64,), which is over-relaxed first.

    Half-angle tangents grow by FURTHER.
    """
    for n in range(16):
        a, b, c, d = D[n], FURTHER * D[16 + n], FURTHER * D[32 + n], FURTHER * D[48 + n]
        scale = _1 / math.sqrt(a * a + b * b + c * c + d * d)
        a, b, c, d = scale * a, scale * b, scale * c, scale * d
        D[n], D[16 + n], D[32 + n], D[48 + n] = a, b, c, d
        w, x, y, z = q[n], q[16 + n], q[32 + n], q[48 + n]
        e, f = a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y
        g, h = a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w
        scale = _1 / math.sqrt(e * e + f * f + g * g + h * h)
        q[n], q[16 + n], q[32 + n], q[48 + n] = scale * e, scale * f, scale * g, scale * h


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _matrices(D, A):
    """Rotation matrices A (144,) of quaternions D (64,)."""
    for n in range(16):
        a, b, c, d = D[n], D[16 + n], D[32 + n], D[48 + n]
        A[n], A[64 + n] = _1 - _2 * (c * c + d * d), _1 - _2 * (b * b + d * d)
        A[128 + n] = _1 - _2 * (b * b + c * c)
        A[16 + n], A[48 + n] = _2 * (b * c - a * d), _2 * (b * c + a * d)
        A[32 + n], A[96 + n] = _2 * (b * d + a * c), _2 * (b * d - a * c)
        A[80 + n], A[112 + n] = _2 * (c * d - a * b), _2 * (c * d + a * b)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _times_transposed(B, T, A):
    """A = B Tᵀ, all (144,)."""
    for r in range(0, 144, 48):
        for n in range(16):
            x, y, z = B[r + n], B[r + 16 + n], B[r + 32 + n]
            A[r + n] = x * T[n] + y * T[16 + n] + z * T[32 + n]
            A[r + 16 + n] = x * T[48 + n] + y * T[64 + n] + z * T[80 + n]
            A[r + 32 + n] = x * T[96 + n] + y * T[112 + n] + z * T[128 + n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def local(start, stop, indptr, rings, halves, rest, p, R, turn, steps):
    """Local step of blocks: rotations R, and their quaternions, turned to fit the edges of p.

    By the rotation D = argmax tr(Dᵀ A), A_i = Σ_j c_ij (p_i − p_j) (R_i (x_i − x_j))ᵀ.
    """
    A, D = np.empty(144, dtype=np.float32), np.empty(64, dtype=np.float32)
    q = np.empty(64, dtype=np.float32)
    B, r = np.zeros(144, dtype=np.float32), np.empty(144, dtype=np.float32)
    count = len(p) // 3
    for block in range(start, stop):
        for n in range(16):
            i = 16 * block + n
            if i >= count:
                continue
            b00 = b01 = b02 = b10 = b11 = b12 = b20 = b21 = b22 = _0
            px, py, pz = p[3 * i], p[3 * i + 1], p[3 * i + 2]
            rx, ry, rz = rest[3 * i], rest[3 * i + 1], rest[3 * i + 2]
            for k in range(indptr[i], indptr[i + 1]):
                j, w = 3 * rings[k], halves[k]
                ex, ey, ez = px - p[j], py - p[j + 1], pz - p[j + 2]
                ax, ay, az = w * (rx - rest[j]), w * (ry - rest[j + 1]), w * (rz - rest[j + 2])
                b00 += ex * ax
                b01 += ex * ay
                b02 += ex * az
                b10 += ey * ax
                b11 += ey * ay
                b12 += ey * az
                b20 += ez * ax
                b21 += ez * ay
                b22 += ez * az
            B[n], B[16 + n], B[32 + n] = b00, b01, b02
            B[48 + n], B[64 + n], B[80 + n] = b10, b11, b12
            B[96 + n], B[112 + n], B[128 + n] = b20, b21, b22
        q[:] = turn[64 * block : 64 * block + 64]
        _matrices(q, r)
        _times_transposed(B, r, A)
        D[:] = _0
        D[:16] = _1
        for _ in range(steps):
            fit_step(A, D)
        _follow(D, q)
        turn[64 * block : 64 * block + 64] = q
        _matrices(q, r)
        for n in range(16):
            o = 144 * block + 9 * n
            for c in range(9):
                R[o + c] = r[16 * c + n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def move(start, stop, green, push, shift, x):
    """x_i += Σ_h green_h,i push_h + shift."""
    a = np.empty(64, dtype=np.float32)
    b = np.empty(64, dtype=np.float32)
    c = np.empty(64, dtype=np.float32)
    for begin in range(start, stop, 64):
        count = min(64, stop - begin)
        a[:], b[:], c[:] = shift[0], shift[1], shift[2]
        for h in range(len(push)):
            row = green[h, begin : begin + count]
            u, v, w = push[h, 0], push[h, 1], push[h, 2]
            for n in range(count):
                a[n] += row[n] * u
                b[n] += row[n] * v
                c[n] += row[n] * w
        for n in range(count):
            x[begin + n, 0] += a[n]
            x[begin + n, 1] += b[n]
            x[begin + n, 2] += c[n]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def place(start, stop, order, Q, origin, x, out):
    """out_order[i] = Q x_i + origin."""
    for i in range(start, stop):
        a, b, c = x[i, 0], x[i, 1], x[i, 2]
        row = out[order[i]]
        for d in range(3):
            row[d] = Q[d, 0] * a + Q[d, 1] * b + Q[d, 2] * c + origin[d]
