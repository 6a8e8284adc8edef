"""Kernels of a frame: single precision, a SIMD block of 16 vertices at a time.

A block stores nine numbers a vertex as nine rows of 16, which fill the processor's vectors. The
kernels index flat arrays by sums of constants and the vertex within the block: where an array has
two indices the compiler cannot tell that its rows do not overlap, and gives up on vectors. They
assign no array to a slice of another, which would take longer to compile than all of them.
"""

from __future__ import annotations

import math

import numpy as np

from deformer.compilation import called_with, njit

# Vertices of a block.
BLOCK = 16
# Numbers of a block: of vectors (3 rows of 16), quaternions (w, x, y, z) and matrices (by row).
# Features are stored like matrices: rotation vector, then xx xy xz yy yz zz of the stretch.
VECTORS, QUATERNIONS, MATRICES = 3 * BLOCK, 4 * BLOCK, 9 * BLOCK
# Where each row of a block begins.
ROW1, ROW2, ROW3, ROW4, ROW5, ROW6, ROW7, ROW8 = (BLOCK * row for row in range(1, 9))

# Constants as single precision: a double one would turn whole loops into double precision.
_0, _1, _2, _HALF, _QUARTER = (np.float32(x) for x in (0, 1, 2, 0.5, 0.25))
_9, _TINY = np.float32(9), np.float32(1e-30)
# Added to the diagonal of a rotation's scaled Newton matrix: about its rounding error.
DAMPING = np.float32(1e-5)
# Tangent of half the largest angle of one Newton step.
LARGEST_STEP = np.float32(0.6)
# Square of a step of half an angle, in radians, that reaches the rotation to rounding. With a
# larger one, whether the last step is taken would depend on the last digits, and be seen.
_SMALLEST_STEP = np.float32(1e-13)
_TURN = np.float32(2 * math.pi)
_PER_TURN = np.float32(0.5 / math.pi)
# Over-relaxation in frames: local steps go beyond their optimum by this factor; local and global
# steps then converge in about half as many rounds. From 2 on they would diverge.
OVER_RELAXATION = np.float32(1.5)
# tanh y as a continued fraction of seven terms, multiplied out: exact to 1e-8 up to y = 2.25.
_N0, _N1, _N2, _N3 = (np.float32(x / 135135) for x in (135135, 17325, 378, 1))
_D1, _D2, _D3 = (np.float32(x / 135135) for x in (62370, 3150, 28))
# Taylor series of sin(u)/u and cos(u) in u², exact to 4e-8 up to u = π/2.
_S = tuple(np.float32((-1) ** n / math.factorial(2 * n + 1)) for n in range(7))
_C = tuple(np.float32((-1) ** n / math.factorial(2 * n)) for n in range(8))
_S1, _S2, _S3, _S4, _S5, _S6 = _S[1:]
_C1, _C2, _C3, _C4, _C5, _C6, _C7 = _C[1:]
# Types of a decoder's `layer`: with a matrix in single precision, and as `DecodedSurface` has it.
_LAYER = "Tuple((i8[::1], {}[::1], f4[::1], {}[:, ::1], f4[::1], f4[::1], f4[::1], f4[::1]))"
LAYER, STORED_LAYER = _LAYER.format("i8", "f4"), _LAYER.format("i4", "i2")


@njit(nogil=True, error_model="numpy", fastmath=True)
def memory_():
    """Scratch memory of a kernel, 32 blocks (32, 144); shared, as each `np.empty` is compiled."""
    return np.empty((32, MATRICES), dtype=np.float32)


@njit(nogil=True, error_model="numpy", fastmath=True)
def gradients(q, T):
    """T (144,) = exp(r) S of a block's features q (144,).

    Whole turns are subtracted from the rotation vector before it is converted to a quaternion.
    """
    for n in range(BLOCK):
        rx, ry, rz = q[n], q[ROW1 + n], q[ROW2 + n]
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
        xx, xy, xz = q[ROW3 + n], q[ROW4 + n], q[ROW5 + n]
        yy, yz, zz = q[ROW6 + n], q[ROW7 + n], q[ROW8 + n]
        T[n] = R00 * xx + R01 * xy + R02 * xz
        T[ROW1 + n] = R00 * xy + R01 * yy + R02 * yz
        T[ROW2 + n] = R00 * xz + R01 * yz + R02 * zz
        T[ROW3 + n] = R10 * xx + R11 * xy + R12 * xz
        T[ROW4 + n] = R10 * xy + R11 * yy + R12 * yz
        T[ROW5 + n] = R10 * xz + R11 * yz + R12 * zz
        T[ROW6 + n] = R20 * xx + R21 * xy + R22 * xz
        T[ROW7 + n] = R20 * xy + R21 * yy + R22 * yz
        T[ROW8 + n] = R20 * xz + R21 * yz + R22 * zz


@called_with("void(i8, i8, i8[::1], f8[:, ::1], f8, f4[:, ::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def coefficients_by_block(start, stop, order, coefficients, scale, out):
    """Blocks out (·, 48) of coefficients (V, 3) times scale; zeros fill the last block."""
    for B in range(start, stop):
        for n in range(BLOCK):
            i = BLOCK * B + n
            for d in range(3):
                out[B, BLOCK * d + n] = scale * coefficients[order[i], d] if i < len(order) else 0.0


@njit(nogil=True, error_model="numpy", fastmath=True)
def add_positions(t, coefficients, offset, sums):
    """sums (48 H,) += T a of a block's gradients t (144,), one sum for each vertex.

    The coefficients a of H handles begin at coefficients[offset].
    """
    for g in range(0, len(sums), VECTORS):
        o = offset + g
        for n in range(BLOCK):
            x, y, z = coefficients[o + n], coefficients[o + ROW1 + n], coefficients[o + ROW2 + n]
            sums[g + n] += t[n] * x + t[ROW1 + n] * y + t[ROW2 + n] * z
            sums[g + ROW1 + n] += t[ROW3 + n] * x + t[ROW4 + n] * y + t[ROW5 + n] * z
            sums[g + ROW2 + n] += t[ROW6 + n] * x + t[ROW7 + n] * y + t[ROW8 + n] * z


@njit(nogil=True, error_model="numpy", fastmath=True)
def _store_by_vertex(t, B, T):
    """Matrices t (144,) of block B to T, nine numbers a vertex."""
    for n in range(BLOCK):
        o = MATRICES * B + 9 * n
        T[o], T[o + 1], T[o + 2] = t[n], t[ROW1 + n], t[ROW2 + n]
        T[o + 3], T[o + 4], T[o + 5] = t[ROW3 + n], t[ROW4 + n], t[ROW5 + n]
        T[o + 6], T[o + 7], T[o + 8] = t[ROW6 + n], t[ROW7 + n], t[ROW8 + n]


@njit(nogil=True, error_model="numpy", fastmath=True)
def gradients_and_positions(start, stop, q, coefficients, T, sums):
    """Gradients T (9 a vertex) of blocks with features q (·, 144), and their handle positions.

    The products T_i a_h,i with the coefficients of H handles are added to sums (48 H,), one sum for
    each of a block's 16 vertices.
    """
    # `add_positions` and `_store_by_vertex`, written out: in a function of its own the compiler
    # does not know that t overlaps no other array, and the decoding takes 1.4 times as long.
    t = np.empty(MATRICES, dtype=np.float32)
    H = len(sums) // VECTORS
    # The coefficients may have room for more handles than there are.
    stride = len(coefficients) // (len(T) // MATRICES)
    for B in range(start, stop):
        gradients(q[B - start], t)
        for h in range(H):
            o, g = B * stride + VECTORS * h, VECTORS * h
            for n in range(BLOCK):
                x, y, z = (
                    coefficients[o + n],
                    coefficients[o + ROW1 + n],
                    coefficients[o + ROW2 + n],
                )
                sums[g + n] += t[n] * x + t[ROW1 + n] * y + t[ROW2 + n] * z
                sums[g + ROW1 + n] += t[ROW3 + n] * x + t[ROW4 + n] * y + t[ROW5 + n] * z
                sums[g + ROW2 + n] += t[ROW6 + n] * x + t[ROW7 + n] * y + t[ROW8 + n] * z
        for n in range(BLOCK):
            o = MATRICES * B + 9 * n
            T[o], T[o + 1], T[o + 2] = t[n], t[ROW1 + n], t[ROW2 + n]
            T[o + 3], T[o + 4], T[o + 5] = t[ROW3 + n], t[ROW4 + n], t[ROW5 + n]
            T[o + 6], T[o + 7], T[o + 8] = t[ROW6 + n], t[ROW7 + n], t[ROW8 + n]


@njit(nogil=True, error_model="numpy", fastmath=True)
def decode(start, stop, layer, q):
    """Features q (stop − start, 144) of blocks, q[B] = gain tanh(Σ_k z_k matrix_k + base) + offset.

    matrix[slices[B]:slices[B + 1]] holds block B for the listed components, in units of `scale`.
    """
    slices, components, scale, matrix, z, base, gain, offset = layer
    for B in range(start, stop):
        x = q[B - start]
        for n in range(MATRICES):
            x[n] = base[n]
        for e in range(slices[B], slices[B + 1]):
            weight = z[components[e]] * scale[e]
            row = matrix[e]
            for n in range(MATRICES):
                x[n] += weight * np.float32(row[n])
        for n in range(MATRICES):
            # tanh x from tanh(x/4) by doubling the argument twice.
            y = _QUARTER * min(max(x[n], -_9), _9)
            u = y * y
            t = y * (_N0 + u * (_N1 + u * (_N2 + u * _N3)))
            t /= _1 + u * (_D1 + u * (_D2 + u * _D3))
            t = _2 * t / (_1 + t * t)
            x[n] = gain[n] * (_2 * t / (_1 + t * t)) + offset[n]


@called_with(f"void(i8, i8, {STORED_LAYER}, f4[::1], f4[::1], f8[::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def decode_to_positions(start, stop, layer, coefficients, T, sums):
    """`decode`, then `gradients_and_positions`, of 32 blocks at a time, which stay in the cache."""
    q = memory_()
    for B in range(start, stop, len(q)):
        end = min(B + len(q), stop)
        decode(B, end, layer, q)
        gradients_and_positions(B, end, q, coefficients, T, sums)


@called_with("void(i8, i8, i8[::1], i4[::1], f4[::1], f4[::1], f4[::1], f4[::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def rhs(start, stop, indptr, rings, halves, x, T, b):
    """b_i = Σ_j ½ c_ij (T_i + T_j)(x_i − x_j) with halves ½ c_ij; T, x and b are flat.

    The single-precision version of `geometry.rhs_`. T are deformation gradients of the reference x,
    or rotations of a rest shape x.
    """
    for i in range(start, stop):
        o = 9 * i
        a00, a01, a02 = T[o], T[o + 1], T[o + 2]
        a10, a11, a12 = T[o + 3], T[o + 4], T[o + 5]
        a20, a21, a22 = T[o + 6], T[o + 7], T[o + 8]
        px, py, pz = x[3 * i], x[3 * i + 1], x[3 * i + 2]
        bx = by = bz = _0
        for k in range(indptr[i], indptr[i + 1]):
            j, o, w = 3 * rings[k], 9 * rings[k], halves[k]
            ex, ey, ez = w * (px - x[j]), w * (py - x[j + 1]), w * (pz - x[j + 2])
            bx += (a00 + T[o]) * ex + (a01 + T[o + 1]) * ey + (a02 + T[o + 2]) * ez
            by += (a10 + T[o + 3]) * ex + (a11 + T[o + 4]) * ey + (a12 + T[o + 5]) * ez
            bz += (a20 + T[o + 6]) * ex + (a21 + T[o + 7]) * ey + (a22 + T[o + 8]) * ez
        b[3 * i] = bx
        b[3 * i + 1] = by
        b[3 * i + 2] = bz


@njit(nogil=True, error_model="numpy", fastmath=True)
def fit_step(A, D):
    """One step of quaternions D (64,) towards the rotations closest to A (144,).

    It is Newton's step, (tr M − M) ω = axial M with the symmetric part of M = R Aᵀ. Where that
    matrix is not definite, far from the maximum, it is the fixed-point iteration of Müller et al.
    (A Robust Method to Extract the Rotational Part of Deformations, 2016). Neither needs a
    decomposition, and both work for flat one-rings, whose A is singular.

    Returns:
        The largest squared step, of half an angle.
    """
    largest = _0
    for n in range(BLOCK):
        a, b, c, d = D[n], D[ROW1 + n], D[ROW2 + n], D[ROW3 + n]
        R00, R11 = _1 - _2 * (c * c + d * d), _1 - _2 * (b * b + d * d)
        R22 = _1 - _2 * (b * b + c * c)
        R01, R10 = _2 * (b * c - a * d), _2 * (b * c + a * d)
        R02, R20 = _2 * (b * d + a * c), _2 * (b * d - a * c)
        R12, R21 = _2 * (c * d - a * b), _2 * (c * d + a * b)
        A00, A01, A02 = A[n], A[ROW1 + n], A[ROW2 + n]
        A10, A11, A12 = A[ROW3 + n], A[ROW4 + n], A[ROW5 + n]
        A20, A21, A22 = A[ROW6 + n], A[ROW7 + n], A[ROW8 + n]
        M00 = R00 * A00 + R01 * A01 + R02 * A02
        M11 = R10 * A10 + R11 * A11 + R12 * A12
        M22 = R20 * A20 + R21 * A21 + R22 * A22
        M01, M10 = R00 * A10 + R01 * A11 + R02 * A12, R10 * A00 + R11 * A01 + R12 * A02
        M02, M20 = R00 * A20 + R01 * A21 + R02 * A22, R20 * A00 + R21 * A01 + R22 * A02
        M12, M21 = R10 * A20 + R11 * A21 + R12 * A22, R20 * A10 + R21 * A11 + R22 * A12
        u, v, w = M12 - M21, M20 - M02, M01 - M10
        # The trace may be near zero (a one-ring turned by 90°, or collapsed): steps stay bounded.
        scale = max(abs(M00 + M11 + M22), math.sqrt(u * u + v * v + w * w)) + _TINY
        scale = _1 / scale
        u, v, w = scale * u, scale * v, scale * w
        xx, yy = scale * (M11 + M22) + DAMPING, scale * (M00 + M22) + DAMPING
        zz = scale * (M00 + M11) + DAMPING
        xy, xz = -_HALF * scale * (M01 + M10), -_HALF * scale * (M02 + M20)
        yz = -_HALF * scale * (M12 + M21)
        # The inverse is the adjugate over det; the minors show whether the matrix is definite.
        c00, c01, c02 = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        c11, c12, c22 = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
        det = xx * c00 + xy * c01 + xz * c02
        newton = xx > _0 and c22 > _0 and det > DAMPING * DAMPING
        f = _HALF / det if newton else _HALF
        x = f * (c00 * u + c01 * v + c02 * w) if newton else f * u
        y = f * (c01 * u + c11 * v + c12 * w) if newton else f * v
        z = f * (c02 * u + c12 * v + c22 * w) if newton else f * w
        # The quadratic model is good for steps up to LARGEST_STEP.
        size = x * x + y * y + z * z
        largest = max(largest, size)
        f = min(_1, LARGEST_STEP / math.sqrt(size + _TINY))
        x, y, z = f * x, f * y, f * z
        e, f = a - x * b - y * c - z * d, b + x * a + y * d - z * c
        g, h = c - x * d + y * a + z * b, d + x * c - y * b + z * a
        scale = _1 / math.sqrt(e * e + f * f + g * g + h * h)
        D[n], D[ROW1 + n], D[ROW2 + n], D[ROW3 + n] = scale * e, scale * f, scale * g, scale * h
    return largest


@njit(nogil=True, error_model="numpy", fastmath=True)
def _compose(D, q, over):
    """Quaternions q (64,) ← D q, after over-relaxation of D (64,).

    It multiplies the tangents of D's half angles by the factor `over`.
    """
    for n in range(BLOCK):
        a, b = D[n], over * D[ROW1 + n]
        c, d = over * D[ROW2 + n], over * D[ROW3 + n]
        scale = _1 / math.sqrt(a * a + b * b + c * c + d * d)
        a, b, c, d = scale * a, scale * b, scale * c, scale * d
        D[n], D[ROW1 + n], D[ROW2 + n], D[ROW3 + n] = a, b, c, d
        w, x, y, z = q[n], q[ROW1 + n], q[ROW2 + n], q[ROW3 + n]
        e, f = a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y
        g, h = a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w
        scale = _1 / math.sqrt(e * e + f * f + g * g + h * h)
        q[n], q[ROW1 + n], q[ROW2 + n], q[ROW3 + n] = scale * e, scale * f, scale * g, scale * h


@njit(nogil=True, error_model="numpy", fastmath=True)
def _matrices(D, A):
    """Rotation matrices A (144,) of quaternions D (64,)."""
    for n in range(BLOCK):
        a, b, c, d = D[n], D[ROW1 + n], D[ROW2 + n], D[ROW3 + n]
        A[n], A[ROW4 + n] = _1 - _2 * (c * c + d * d), _1 - _2 * (b * b + d * d)
        A[ROW8 + n] = _1 - _2 * (b * b + c * c)
        A[ROW1 + n], A[ROW3 + n] = _2 * (b * c - a * d), _2 * (b * c + a * d)
        A[ROW2 + n], A[ROW6 + n] = _2 * (b * d + a * c), _2 * (b * d - a * c)
        A[ROW5 + n], A[ROW7 + n] = _2 * (c * d - a * b), _2 * (c * d + a * b)


@njit(nogil=True, error_model="numpy", fastmath=True)
def _times_transposed(B, T, A):
    """A = B Tᵀ, all (144,)."""
    for r in range(0, MATRICES, VECTORS):
        for n in range(BLOCK):
            x, y, z = B[r + n], B[r + ROW1 + n], B[r + ROW2 + n]
            A[r + n] = x * T[n] + y * T[ROW1 + n] + z * T[ROW2 + n]
            A[r + ROW1 + n] = x * T[ROW3 + n] + y * T[ROW4 + n] + z * T[ROW5 + n]
            A[r + ROW2 + n] = x * T[ROW6 + n] + y * T[ROW7 + n] + z * T[ROW8 + n]


@called_with("void(i8, i8, i8[::1], i4[::1], f4[::1], f4[::1], f4[::1], f4[::1], f4[::1], i8, f4)")
@njit(nogil=True, error_model="numpy", fastmath=True)
def fit_rotations(start, stop, indptr, rings, halves, x, p, R, turn, steps, over):
    """Local step of blocks: fit rotations R, and their quaternions `turn`, to the edges of p.

    R_i becomes D R_i with D = argmax tr(Dᵀ A_i), A_i = Σ_j c_ij (p_i − p_j) (R_i (x_i − x_j))ᵀ and
    the rest shape x (Sorkine and Alexa, As-Rigid-As-Possible Surface Modeling, 2007, equation 6),
    beyond it by the factor `over`.
    """
    memory = memory_()
    A, D, q, B, r = memory[0], memory[1], memory[2], memory[3], memory[4]
    for n in range(MATRICES):
        B[n] = _0
    count = len(p) // 3
    for block in range(start, stop):
        for n in range(BLOCK):
            i = BLOCK * block + n
            if i >= count:
                continue
            b00 = b01 = b02 = b10 = b11 = b12 = b20 = b21 = b22 = _0
            px, py, pz = p[3 * i], p[3 * i + 1], p[3 * i + 2]
            rx, ry, rz = x[3 * i], x[3 * i + 1], x[3 * i + 2]
            for k in range(indptr[i], indptr[i + 1]):
                j, w = 3 * rings[k], halves[k]
                ex, ey, ez = px - p[j], py - p[j + 1], pz - p[j + 2]
                ax, ay, az = w * (rx - x[j]), w * (ry - x[j + 1]), w * (rz - x[j + 2])
                b00 += ex * ax
                b01 += ex * ay
                b02 += ex * az
                b10 += ey * ax
                b11 += ey * ay
                b12 += ey * az
                b20 += ez * ax
                b21 += ez * ay
                b22 += ez * az
            B[n], B[ROW1 + n], B[ROW2 + n] = b00, b01, b02
            B[ROW3 + n], B[ROW4 + n], B[ROW5 + n] = b10, b11, b12
            B[ROW6 + n], B[ROW7 + n], B[ROW8 + n] = b20, b21, b22
        for n in range(QUATERNIONS):
            q[n] = turn[QUATERNIONS * block + n]
            D[n] = _1 if n < BLOCK else _0
        _matrices(q, r)
        _times_transposed(B, r, A)
        for _ in range(steps):
            if fit_step(A, D) < _SMALLEST_STEP:
                break
        _compose(D, q, over)
        for n in range(QUATERNIONS):
            turn[QUATERNIONS * block + n] = q[n]
        _matrices(q, r)
        _store_by_vertex(r, block, R)


@called_with("void(i8, i8, f4[:, ::1], f4[:, ::1], f4[::1], f4[:, ::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def add_green_functions(start, stop, green, push, shift, x):
    """x_i += Σ_h green_h,i push_h + shift."""
    memory = memory_()
    a, b, c = memory[0], memory[1], memory[2]
    for begin in range(start, stop, MATRICES):
        count = min(MATRICES, stop - begin)
        for n in range(count):
            a[n], b[n], c[n] = shift[0], shift[1], shift[2]
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


@called_with("void(i8, i8, i8[::1], f8[:, ::1], f8[::1], f4[:, ::1], f8[:, ::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def to_user_order(start, stop, order, Q, origin, x, out):
    """out_order[i] = Q x_i + origin: from the blocks' order (n, 3) to the vertices' (V, 3).

    Q (3, 3) and origin (3,) are the rigid motion; `order` (V,) is the vertex in each place.
    """
    for i in range(start, stop):
        a, b, c = x[i, 0], x[i, 1], x[i, 2]
        for d in range(3):
            out[order[i], d] = Q[d, 0] * a + Q[d, 1] * b + Q[d, 2] * c + origin[d]
