"""A trained decoder as plain arrays: features, their differential and its transpose.

The linear map Cᵀ and the linear part of the first decoder convolution collapse into one matrix,
so a network of one layer costs one matrix-vector product and one tanh. A decoder restricted to a
few vertices contains only the rows that these vertices depend on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from deformer.acap import FeatureScaler
from deformer.compilation import called_with, njit
from deformer.geometry import FloatArray, IntArray
from deformer.linalg import over_ranges
from deformer.network.weights import NetworkWeights, ring_mean


@called_with("void(i8, i8, f4[:, :, ::1], f4[::1], f4[::1], f4[:, ::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def _affine(start, stop, matrix, z, bias, out):
    """out_i = matrix_i z + bias, vertex by vertex, in the precision of z."""
    K = matrix.shape[2]
    for i in range(start, stop):
        for d in range(matrix.shape[1]):
            row = matrix[i, d]
            total = bias[d]
            for k in range(K):
                total += row[k] * z[k]
            out[i, d] = total


# Scaled features are clipped to ± this before artanh.
_SATURATED = 0.99
_RIDGE = 1e-7
# Rows of the matrix that are converted to double precision at once: bounds memory.
_ROWS = 4096


@dataclass(frozen=True, eq=False)
class _Layer:
    """tanh(x_own point + (mean x) neighbour + bias), for the vertices that later layers need.

    Args:
        own: (n,) input row of each of the layer's n vertices.
        mean: (n, m) averages the m input rows over the one-rings.
        point: (d', d) weights of the vertex itself, transposed.
        neighbour: (d', d) weights of the ring mean, transposed.
        bias: (d,).
    """

    own: IntArray
    mean: sparse.csr_array
    point: FloatArray
    neighbour: FloatArray
    bias: FloatArray

    def __call__(self, x: FloatArray) -> FloatArray:
        return np.tanh(x[self.own] @ self.point + (self.mean @ x) @ self.neighbour + self.bias)

    def pushforward(self, dx: FloatArray, y: FloatArray) -> FloatArray:
        """Differentials (K, n, d) of the output y (n, d) for those of the input, dx (K, m, d')."""
        averaged = np.stack([self.mean @ d for d in dx])
        return (dx[:, self.own] @ self.point + averaged @ self.neighbour) * (1.0 - y**2)

    def pullback(self, g: FloatArray, y: FloatArray, size: int) -> FloatArray:
        """Gradients for the `size` input rows, given those for the output y (n, d), g (·, n, d)."""
        g = g * (1.0 - y**2)
        by_mean = g @ self.neighbour.T
        total = np.stack([self.mean.T @ row for row in by_mean])
        total[:, self.own] += g @ self.point.T
        return total.reshape(len(g), size, -1)


class Decoder:
    """Features (n, 9) of latent codes z (K,), for all vertices or some.

    Args:
        weights: weights of the trained network.
        scaler: the feature scaling that it was trained with.
        indptr, rings: one-rings of the mesh, as `deformer.geometry.one_rings` returns them.
        vertices: (n,) int64 the vertices to decode; None decodes all, n = V.
    """

    def __init__(
        self,
        weights: NetworkWeights,
        scaler: FeatureScaler,
        indptr: IntArray,
        rings: IntArray,
        vertices: IntArray | None = None,
    ) -> None:
        """Collapse the affine first part and copy the remaining layers."""
        V = len(indptr) - 1
        mean = ring_mean(indptr, rings)
        # The decoder's convolutions in its own order, (point, neighbour, bias) in double precision.
        convs = [
            tuple(np.asarray(a, dtype=np.float64) for a in (w.point, w.neighbour, w.bias_back))
            for w in reversed(weights.convolutions)
        ]
        rows = np.arange(V) if vertices is None else np.asarray(vertices, dtype=np.int64)
        self._layers: list[_Layer] = []
        for point, neighbour, bias in reversed(convs[1:]):
            inputs = rows
            if vertices is not None:
                inputs = np.unique(np.concatenate([rows, mean[rows].indices]))
            input_row = np.zeros(V, dtype=np.int64)
            input_row[inputs] = np.arange(len(inputs))
            layer = _Layer(input_row[rows], mean[rows][:, inputs], point, neighbour, bias)
            self._layers.insert(0, layer)
            rows = inputs
        C = weights.C
        self.components = C.shape[2]
        self.vertex_count = len(rows) if not self._layers else len(self._layers[-1].own)
        point, neighbour, self.base = convs[0]
        own = C if vertices is None else C[rows]
        # f̂ = Cᵀ z (Tan et al. 2018, equation 3) and the first convolution's affine part in one:
        # (n, d, K), single precision as the network itself.
        self.matrix = np.matmul(point.T.astype(np.float32), own)
        if neighbour.any():
            near = mean[rows].astype(np.float32) @ C.reshape(V, -1)
            near = near.reshape(len(rows), *C.shape[1:])
            self.matrix += np.matmul(neighbour.T.astype(np.float32), near)
        self.gain, self.offset = scaler.gain, scaler.offset

    def features(self, z: FloatArray) -> FloatArray:
        """Features (n, 9) of a latent code z (K,)."""
        return self._activations(z)[-1] * self.gain + self.offset

    def single_features(self, z: FloatArray) -> FloatArray:
        """Features (n, 9) of a latent code z (K,), the affine first part in single precision."""
        x: NDArray = self._first(z.astype(np.float32))
        for layer in self._layers:
            x = layer(x)
        return x * self.gain + self.offset

    def _first(self, z: NDArray) -> NDArray:
        """Output (·, d) of the first tanh, in the precision of z."""
        x = np.empty(self.matrix.shape[:2], dtype=z.dtype)
        over_ranges(_affine, len(x), self.matrix, z, self.base.astype(z.dtype), x)
        return np.tanh(x, out=x)

    def _activations(self, z: FloatArray) -> list[FloatArray]:
        """Outputs (·, ·) of every tanh."""
        outputs = [self._first(np.asarray(z, dtype=np.float64))]
        for layer in self._layers:
            outputs.append(layer(outputs[-1]))
        return outputs

    def differential(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Features (n, 9) and their derivative (K, n, 9) with respect to z."""
        outputs = self._activations(z)
        slope = 1.0 - outputs[0] ** 2
        dx = np.moveaxis(self.matrix, 2, 0) * slope
        for layer, y in zip(self._layers, outputs[1:], strict=True):
            dx = layer.pushforward(dx, y)
        return outputs[-1] * self.gain + self.offset, dx * self.gain

    @property
    def pointwise(self) -> bool:
        """True for one layer: a vertex's features are then a tanh of its own rows times z."""
        return not self._layers

    def pointwise_slope(self, q: FloatArray) -> FloatArray:
        """Derivative (n, 9) of features q (n, 9) with respect to the affine part's output."""
        x = (q - self.offset) / self.gain
        return (1.0 - x * x) * self.gain

    def project(self, q: FloatArray) -> FloatArray:
        """Code (K,) whose features come closest to q (n, 9), to first order; one layer only.

        Least squares in front of the tanh: Σ ‖w (M z + base − artanh x)‖² for x in (−1, 1), where q
        is gain x + offset, with the slopes w = gain (1 − x²) at x as weights.
        """
        x = np.clip((q - self.offset) / self.gain, -_SATURATED, _SATURATED)
        weights = self.gain * (1.0 - x * x)
        target = weights * (np.arctanh(x) - self.base)
        K = self.components
        A, b = np.zeros((K, K)), np.zeros(K)
        for start in range(0, len(x), _ROWS):
            part = slice(start, start + _ROWS)
            M = (self.matrix[part] * weights[part, :, None]).reshape(-1, K)
            A += M.T @ M
            b += M.T @ target[part].ravel()
        # With the ridge, components without effect have the code 0.
        A += _RIDGE * max(np.trace(A) / K, 1e-30) * np.eye(K)
        return np.asarray(np.linalg.solve(A, b), dtype=np.float64)

    def pull_back(self, z: FloatArray, g: FloatArray) -> FloatArray:
        """Gradients (m, K) with respect to z of gradients g (m, n, 9) with respect to features."""
        outputs = self._activations(z)
        g = g * self.gain
        for layer, x, y in zip(self._layers[::-1], outputs[-2::-1], outputs[:0:-1], strict=True):
            g = layer.pullback(g, y, len(x))
        g = g * (1.0 - outputs[0] ** 2)
        total = np.zeros((len(g), self.components))
        for start in range(0, len(self.matrix), _ROWS):
            part = self.matrix[start : start + _ROWS].astype(np.float64)
            size = part.shape[0] * part.shape[1]
            total += g[:, start : start + _ROWS].reshape(len(g), size) @ part.reshape(size, -1)
        return total
