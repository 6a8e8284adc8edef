"""Handle positions and their derivative by a few vertices, 16 at a time, without what is zero.

Components of a localised prior reach few vertices each. The decoder's matrix is kept by blocks of
16 vertices as the rows of the components that reach them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from deformer.editing.kernels import LANES, decode, gradients
from deformer.geometry import FloatArray
from deformer.linalg import ranges, together
from deformer.network import Decoder

# Blocks below which a second thread does not pay.
_SHARE = 16

_1, _HALF, _TINY = np.float32(1), np.float32(0.5), np.float32(1e-30)
# (1 − cos θ)/θ² and (θ − sin θ)/θ³ as series in θ², where subtraction would cancel too much.
_SMALL = np.float32(0.7)
_F = tuple(np.float32((-1) ** n / math.factorial(2 * n + 2)) for n in range(4))
_G = tuple(np.float32((-1) ** n / math.factorial(2 * n + 3)) for n in range(4))
_F0, _F1, _F2, _F3 = _F
_G0, _G1, _G2, _G3 = _G


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _turning(q, R, T, slope, C):
    """C (3, 144): the derivatives [l_m]× T of T = exp(r) S, l_m column m of the left Jacobian.

    Times the slopes; R = exp(r) is there, which gives sine and cosine of the angle.
    """
    for n in range(16):
        x, y, z = q[n], q[16 + n], q[32 + n]
        u = x * x + y * y + z * z + _TINY
        angle = math.sqrt(u)
        cosine = _HALF * (R[n] + R[64 + n] + R[128 + n] - _1)
        sine = x * (R[112 + n] - R[80 + n]) + y * (R[32 + n] - R[96 + n])
        sine = _HALF * (sine + z * (R[48 + n] - R[16 + n])) / angle
        # The left Jacobian is 1 + f [r]× + g [r]×².
        small = angle < _SMALL
        f = _F0 + u * (_F1 + u * (_F2 + u * _F3)) if small else (_1 - cosine) / u
        g = _G0 + u * (_G1 + u * (_G2 + u * _G3)) if small else (angle - sine) / (u * angle)
        d = _1 - g * u
        a0, a1, a2 = slope[n], slope[16 + n], slope[32 + n]
        l00, l10, l20 = a0 * (d + g * x * x), a0 * (g * x * y + f * z), a0 * (g * x * z - f * y)
        l01, l11, l21 = a1 * (g * x * y - f * z), a1 * (d + g * y * y), a1 * (g * y * z + f * x)
        l02, l12, l22 = a2 * (g * x * z + f * y), a2 * (g * y * z - f * x), a2 * (d + g * z * z)
        for b in range(0, 48, 16):
            t0, t1, t2 = T[b + n], T[48 + b + n], T[96 + b + n]
            C[b + n] = l10 * t2 - l20 * t1
            C[48 + b + n] = l20 * t0 - l00 * t2
            C[96 + b + n] = l00 * t1 - l10 * t0
            C[144 + b + n] = l11 * t2 - l21 * t1
            C[192 + b + n] = l21 * t0 - l01 * t2
            C[240 + b + n] = l01 * t1 - l11 * t0
            C[288 + b + n] = l12 * t2 - l22 * t1
            C[336 + b + n] = l22 * t0 - l02 * t2
            C[384 + b + n] = l02 * t1 - l12 * t0


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _tangent(row, slope, R, C, t):
    """t (144,) = change of T under a row (144,) of the decoder's matrix."""
    for n in range(16):
        x, y, z = row[n], row[16 + n], row[32 + n]
        xx, xy = slope[48 + n] * row[48 + n], slope[64 + n] * row[64 + n]
        xz, yy = slope[80 + n] * row[80 + n], slope[96 + n] * row[96 + n]
        yz, zz = slope[112 + n] * row[112 + n], slope[128 + n] * row[128 + n]
        for o in range(0, 144, 48):
            a, b, c = R[o + n], R[o + 16 + n], R[o + 32 + n]
            t0, t1 = a * xx + b * xy + c * xz, a * xy + b * yy + c * yz
            t2 = a * xz + b * yz + c * zz
            t[o + n] = t0 + x * C[o + n] + y * C[144 + o + n] + z * C[288 + o + n]
            t1 += x * C[16 + o + n] + y * C[160 + o + n] + z * C[304 + o + n]
            t2 += x * C[32 + o + n] + y * C[176 + o + n] + z * C[320 + o + n]
            t[o + 16 + n] = t1
            t[o + 32 + n] = t2


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _move(t, coefficients, sums):
    """sums (48 H,) += T a, vertex by vertex of a block, for coefficients a (48 H,)."""
    for o in range(0, len(sums), 48):
        for n in range(16):
            x, y, z = coefficients[o + n], coefficients[o + 16 + n], coefficients[o + 32 + n]
            sums[o + n] += t[n] * x + t[16 + n] * y + t[32 + n] * z
            sums[o + 16 + n] += t[48 + n] * x + t[64 + n] * y + t[80 + n] * z
            sums[o + 32 + n] += t[96 + n] * x + t[112 + n] * y + t[128 + n] * z


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _positions(layer, coefficients, sums):
    """sums (48 H,) = Σ T a over blocks, lane by lane, with coefficients (blocks, 48 H)."""
    q, t = np.empty((1, 144), dtype=np.float32), np.empty(144, dtype=np.float32)
    for B in range(len(coefficients)):
        decode(B, B + 1, layer, q)
        gradients(q[0], t)
        _move(t, coefficients[B], sums)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _derivative(start, stop, layer, columns, out):
    """out[k] += ∂/∂z_k of the positions (3, H) by blocks, with coefficients (blocks, 48, H)."""
    q = np.empty((1, 144), dtype=np.float32)
    T, R = np.empty(144, dtype=np.float32), np.empty(144, dtype=np.float32)
    slope, C = np.empty(144, dtype=np.float32), np.empty(432, dtype=np.float32)
    tangents = np.empty((len(out), 144), dtype=np.float32)
    slices, components, _, matrix, _, _, gain, offset = layer
    for B in range(start, stop):
        decode(B, B + 1, layer, q)
        features = q[0]
        for n in range(144):
            x = (features[n] - offset[n]) / gain[n]
            slope[n] = gain[n] * (_1 - x * x)
        gradients(features, T)
        features[48:] = 0
        features[48:64], features[96:112], features[128:] = 1, 1, 1
        gradients(features, R)
        _turning(features, R, T, slope, C)
        first = slices[B]
        count = slices[B + 1] - first
        for e in range(count):
            _tangent(matrix[first + e], slope, R, C, tangents[e])
        moved = np.dot(tangents[:count].reshape(3 * count, 48), columns[B])
        for e in range(count):
            target = out[components[first + e]]
            for a in range(3):
                target[a] += moved[3 * e + a]


class BlockDecoder:
    """The matrix of a one-layer decoder of n vertices by blocks, without components that are zero.

    Args:
        decoder: `pointwise`.
    """

    def __init__(self, decoder: Decoder) -> None:
        """Copy the rows that are not zero."""
        K, n = decoder.components, decoder.vertex_count
        self.components, self.blocks = K, -(-n // LANES)
        # The last block is filled up with its last vertex.
        padded = np.minimum(np.arange(self.blocks * LANES), n - 1)
        by_block = decoder.matrix[padded].reshape(-1, LANES, 9, K).transpose(0, 3, 2, 1)
        by_block = by_block.reshape(-1, K, 9 * LANES)
        used = by_block.any(axis=2)
        self._matrix = np.ascontiguousarray(by_block[used])
        self._slices = np.concatenate([[0], np.cumsum(used.sum(axis=1))])
        self._rows = np.nonzero(used)[1]
        self._scale = np.ones(len(self._rows), dtype=np.float32)
        affine = decoder.base, decoder.gain, decoder.offset
        self._affine = tuple(np.repeat(a, LANES).astype(np.float32) for a in affine)

    def layer(self, z: FloatArray) -> tuple:
        """What `lanes.decode` wants for a code (K,)."""
        matrix = self._slices, self._rows, self._scale, self._matrix
        return *matrix, z.astype(np.float32), *self._affine


class BlockHandlePositions:
    """Handle positions Σ_i T_i(z) a_h,i; see `objective.Handles`.

    Args:
        decoder: of n vertices.
        coefficients: (H, n, 3).
    """

    def __init__(self, decoder: BlockDecoder, coefficients: FloatArray) -> None:
        """Copy the coefficients by blocks."""
        H, n, _ = coefficients.shape
        self.decoder, self.count = decoder, H
        # Vertices that fill up the last block have no coefficients.
        padded = np.zeros((decoder.blocks * LANES, H, 3), dtype=np.float32)
        padded[:n] = coefficients.transpose(1, 0, 2)
        by_block = padded.reshape(decoder.blocks, LANES, H, 3)
        # The same numbers for the lanes of `_move` and for a product of matrices.
        self.coefficients = by_block.transpose(0, 2, 3, 1).reshape(decoder.blocks, 3 * LANES * H)
        self.columns = by_block.transpose(0, 3, 1, 2).reshape(decoder.blocks, 3 * LANES, H)

    def at(self, z: FloatArray) -> BlockEvaluation:
        """Positions, and their derivative if it is asked for."""
        return BlockEvaluation(self, z)


class BlockEvaluation:
    """`BlockHandlePositions` at one latent code."""

    def __init__(self, handles: BlockHandlePositions, z: FloatArray) -> None:
        """Evaluate the positions (H, 3)."""
        self._handles, self._layer = handles, handles.decoder.layer(z)
        sums = np.zeros(handles.coefficients.shape[1])
        _positions(self._layer, handles.coefficients, sums)
        self.positions: FloatArray = sums.reshape(handles.count, 3, LANES).sum(axis=2)

    def derivative(self) -> FloatArray:
        """Derivative (H, 3, K) of the positions with respect to the code."""
        handles = self._handles
        pieces = ranges(len(handles.columns), _SHARE)
        J = np.zeros((len(pieces), handles.decoder.components, 3, handles.count), dtype=np.float32)
        calls = [(*p, self._layer, handles.columns, j) for p, j in zip(pieces, J, strict=True)]
        together(_derivative, calls)
        return J.sum(axis=0).transpose(2, 1, 0).astype(np.float64, order="C")
