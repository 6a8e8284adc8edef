"""Handle positions and their derivative by a few vertices, 16 at a time, without what is zero.

Components of a localised prior reach few vertices each. The decoder's matrix is kept by blocks of
16 vertices as the rows of the components that reach them.
"""

from __future__ import annotations

import math

import numpy as np

from deformer.compilation import called_with, njit
from deformer.editing.kernels import (
    BLOCK,
    LAYER,
    MATRICES,
    ROW1,
    ROW2,
    ROW3,
    ROW4,
    ROW5,
    ROW6,
    ROW7,
    ROW8,
    VECTORS,
    add_positions,
    decode,
    gradients,
    memory_,
)
from deformer.geometry import FloatArray
from deformer.linalg import ranges, run_calls
from deformer.network import Decoder

# Work, in blocks times 10 + H for H handles, below which a thread of its own does not pay (half a
# millisecond): while a window draws, both the way there and the way back wait for Python's lock.
_SHARE = 1500

_1, _HALF, _TINY = np.float32(1), np.float32(0.5), np.float32(1e-30)
# (1 − cos θ)/θ² and (θ − sin θ)/θ³ as series in θ², where subtraction would cancel too much.
_SMALL = np.float32(0.7)
_F = tuple(np.float32((-1) ** n / math.factorial(2 * n + 2)) for n in range(4))
_G = tuple(np.float32((-1) ** n / math.factorial(2 * n + 3)) for n in range(4))
_F0, _F1, _F2, _F3 = _F
_G0, _G1, _G2, _G3 = _G


@njit(nogil=True, error_model="numpy", fastmath=True)
def _rotation_tangents(q, R, T, slope, C):
    """C (3, 144): the derivatives [l_m]× T of T = exp(r) S, l_m column m of the left Jacobian.

    Times the slopes; R = exp(r) is there, which gives sine and cosine of the angle.
    """
    for n in range(BLOCK):
        x, y, z = q[n], q[ROW1 + n], q[ROW2 + n]
        u = x * x + y * y + z * z + _TINY
        angle = math.sqrt(u)
        cosine = _HALF * (R[n] + R[ROW4 + n] + R[ROW8 + n] - _1)
        sine = x * (R[ROW7 + n] - R[ROW5 + n]) + y * (R[ROW2 + n] - R[ROW6 + n])
        sine = _HALF * (sine + z * (R[ROW3 + n] - R[ROW1 + n])) / angle
        # The left Jacobian is 1 + f [r]× + g [r]×².
        small = angle < _SMALL
        f = _F0 + u * (_F1 + u * (_F2 + u * _F3)) if small else (_1 - cosine) / u
        g = _G0 + u * (_G1 + u * (_G2 + u * _G3)) if small else (angle - sine) / (u * angle)
        d = _1 - g * u
        a0, a1, a2 = slope[n], slope[ROW1 + n], slope[ROW2 + n]
        l00, l10, l20 = a0 * (d + g * x * x), a0 * (g * x * y + f * z), a0 * (g * x * z - f * y)
        l01, l11, l21 = a1 * (g * x * y - f * z), a1 * (d + g * y * y), a1 * (g * y * z + f * x)
        l02, l12, l22 = a2 * (g * x * z + f * y), a2 * (g * y * z - f * x), a2 * (d + g * z * z)
        for b in range(0, VECTORS, BLOCK):
            t0, t1, t2 = T[b + n], T[ROW3 + b + n], T[ROW6 + b + n]
            C[b + n] = l10 * t2 - l20 * t1
            C[ROW3 + b + n] = l20 * t0 - l00 * t2
            C[ROW6 + b + n] = l00 * t1 - l10 * t0
            C[MATRICES + b + n] = l11 * t2 - l21 * t1
            C[MATRICES + ROW3 + b + n] = l21 * t0 - l01 * t2
            C[MATRICES + ROW6 + b + n] = l01 * t1 - l11 * t0
            C[2 * MATRICES + b + n] = l12 * t2 - l22 * t1
            C[2 * MATRICES + ROW3 + b + n] = l22 * t0 - l02 * t2
            C[2 * MATRICES + ROW6 + b + n] = l02 * t1 - l12 * t0


@njit(nogil=True, error_model="numpy", fastmath=True)
def _gradient_tangent(row, slope, R, C, t):
    """t (144,) = change of T under a row (144,) of the decoder's matrix."""
    for n in range(BLOCK):
        x, y, z = row[n], row[ROW1 + n], row[ROW2 + n]
        xx, xy = slope[ROW3 + n] * row[ROW3 + n], slope[ROW4 + n] * row[ROW4 + n]
        xz, yy = slope[ROW5 + n] * row[ROW5 + n], slope[ROW6 + n] * row[ROW6 + n]
        yz, zz = slope[ROW7 + n] * row[ROW7 + n], slope[ROW8 + n] * row[ROW8 + n]
        for o in range(0, MATRICES, VECTORS):
            a, b, c = R[o + n], R[o + ROW1 + n], R[o + ROW2 + n]
            t0, t1 = a * xx + b * xy + c * xz, a * xy + b * yy + c * yz
            t2 = a * xz + b * yz + c * zz
            i, j, k = o + n, MATRICES + o + n, 2 * MATRICES + o + n
            t[i] = t0 + x * C[i] + y * C[j] + z * C[k]
            t[ROW1 + i] = t1 + x * C[ROW1 + i] + y * C[ROW1 + j] + z * C[ROW1 + k]
            t[ROW2 + i] = t2 + x * C[ROW2 + i] + y * C[ROW2 + j] + z * C[ROW2 + k]


@called_with(f"void({LAYER}, f4[::1], f8[::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def _positions(layer, coefficients, sums):
    """sums (48 H,) = Σ T a over blocks, each vertex of a block for itself; flat coefficients."""
    memory = memory_()
    q, t = memory[:1], memory[1]
    for B in range(len(layer[0]) - 1):
        decode(B, B + 1, layer, q)
        gradients(q[0], t)
        add_positions(t, coefficients, B * len(sums), sums)


@called_with(f"void(i8, i8, {LAYER}, f4[:, :, ::1], f4[:, ::1], f4[:, :, ::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def _derivative(start, stop, layer, columns, tangents, out):
    """out[k] += ∂/∂z_k of the positions (3, H) by blocks, with coefficients (blocks, 48, H).

    `tangents` (K, 144) is memory.
    """
    memory = memory_()
    q, T, R, slope = memory[:1], memory[1], memory[2], memory[3]
    C = memory[4:7].reshape(3 * MATRICES)
    slices, components, _, matrix, _, _, gain, offset = layer
    for B in range(start, stop):
        decode(B, B + 1, layer, q)
        features = q[0]
        for n in range(MATRICES):
            x = (features[n] - offset[n]) / gain[n]
            slope[n] = gain[n] * (_1 - x * x)
        gradients(features, T)
        # With the identity as the stretch the gradients are the rotations.
        for n in range(BLOCK):
            features[ROW3 + n] = features[ROW6 + n] = features[ROW8 + n] = 1
            features[ROW4 + n] = features[ROW5 + n] = features[ROW7 + n] = 0
        gradients(features, R)
        _rotation_tangents(features, R, T, slope, C)
        first = slices[B]
        count = slices[B + 1] - first
        for e in range(count):
            _gradient_tangent(matrix[first + e], slope, R, C, tangents[e])
        moved = np.dot(tangents[:count].reshape(3 * count, VECTORS), columns[B])
        for e in range(count):
            k = components[first + e]
            for a in range(3):
                for h in range(out.shape[2]):
                    out[k, a, h] += moved[3 * e + a, h]


class BlockDecoder:
    """The matrix of a one-layer decoder of n vertices by blocks, without components that are zero.

    Args:
        decoder: `pointwise`.
    """

    def __init__(self, decoder: Decoder) -> None:
        """Copy the rows that are not zero."""
        K, n = decoder.components, decoder.vertex_count
        self.components, self.blocks = K, -(-n // BLOCK)
        # The last block is filled up with its last vertex.
        padded = np.minimum(np.arange(self.blocks * BLOCK), n - 1)
        by_block = decoder.matrix[padded].reshape(-1, BLOCK, 9, K).transpose(0, 3, 2, 1)
        by_block = by_block.reshape(-1, K, MATRICES)
        used = by_block.any(axis=2)
        self._matrix = np.ascontiguousarray(by_block[used])
        self._slices = np.concatenate([[0], np.cumsum(used.sum(axis=1))])
        self._rows = np.ascontiguousarray(np.nonzero(used)[1])
        self._scale = np.ones(len(self._rows), dtype=np.float32)
        affine = decoder.base, decoder.gain, decoder.offset
        self._affine = tuple(np.repeat(a, BLOCK).astype(np.float32) for a in affine)

    def layer(self, z: FloatArray) -> tuple:
        """What `kernels.decode` takes for a code (K,)."""
        matrix = self._slices, self._rows, self._scale, self._matrix
        return *matrix, z.astype(np.float32), *self._affine


class BlockHandlePositions:
    """Handle positions Σ_i T_i(z) a_h,i; see `HandlePositions`.

    Args:
        decoder: of n vertices.
        coefficients: (H, n, 3).
    """

    def __init__(self, decoder: BlockDecoder, coefficients: FloatArray) -> None:
        """Copy the coefficients by blocks."""
        H, n, _ = coefficients.shape
        self.decoder, self.count = decoder, H
        # Vertices that fill up the last block have no coefficients.
        padded = np.zeros((decoder.blocks * BLOCK, H, 3), dtype=np.float32)
        padded[:n] = coefficients.transpose(1, 0, 2)
        by_block = padded.reshape(decoder.blocks, BLOCK, H, 3)
        # The same numbers for `add_positions` and for a product of matrices.
        self.coefficients = by_block.transpose(0, 2, 3, 1).ravel()
        self.columns = by_block.transpose(0, 3, 1, 2).reshape(decoder.blocks, VECTORS, H)

    def at(self, z: FloatArray) -> BlockEvaluation:
        """Positions, and their derivative if it is asked for."""
        return BlockEvaluation(self, z)


class BlockEvaluation:
    """`BlockHandlePositions` at one latent code."""

    def __init__(self, handles: BlockHandlePositions, z: FloatArray) -> None:
        """Evaluate the positions (H, 3)."""
        self._handles, self._layer = handles, handles.decoder.layer(z)
        sums = np.zeros(VECTORS * handles.count)
        _positions(self._layer, handles.coefficients, sums)
        self.positions: FloatArray = sums.reshape(handles.count, 3, BLOCK).sum(axis=2)

    def derivative(self) -> FloatArray:
        """Derivative (H, 3, K) of the positions with respect to the code."""
        handles = self._handles
        pieces = ranges(len(handles.columns), max(1, _SHARE // (10 + handles.count)))
        J = np.zeros((len(pieces), handles.decoder.components, 3, handles.count), dtype=np.float32)
        tangents = np.empty((len(pieces), J.shape[1], MATRICES), dtype=np.float32)
        rest = zip(pieces, tangents, J, strict=True)
        calls = [(*p, self._layer, handles.columns, t, j) for p, t, j in rest]
        run_calls(_derivative, calls)
        return J.sum(axis=0).transpose(2, 1, 0).astype(np.float64, order="C")
