"""A trained decoder as plain arrays: features, their differential and its transpose.

The linear map Cᵀ and the linear part of the first decoder convolution collapse into one matrix,
so a network of one layer costs one matrix-vector product and one tanh. A decoder can be restricted
to a few vertices; it then holds only what those depend on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse

from deformer.autoencoder import GraphConv, MeshAutoencoder
from deformer.features import FeatureScaler, scaled_to_gradients
from deformer.mesh import FloatArray, IntArray
from deformer.parallel import over_ranges


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _affine(start, stop, matrix, z, bias, out):
    """out_i = matrix_i z + bias, single precision, vertex by vertex."""
    K = matrix.shape[2]
    for i in range(start, stop):
        for d in range(matrix.shape[1]):
            row = matrix[i, d]
            total = np.float32(0.0)
            for k in range(K):
                total += row[k] * z[k]
            out[i, d] = total + bias[d]


@dataclass(frozen=True, eq=False)
class _Layer:
    """tanh(x_own point + (mean x) neighbour + bias), for the vertices that later layers need."""

    own: IntArray
    mean: sparse.csr_array
    point: FloatArray
    neighbour: FloatArray
    bias: FloatArray

    def __call__(self, x: FloatArray) -> FloatArray:
        return np.tanh(x[self.own] @ self.point + (self.mean @ x) @ self.neighbour + self.bias)

    def push(self, dx: FloatArray, y: FloatArray) -> FloatArray:
        """Differentials (K, n, ·) through the layer with output y."""
        averaged = np.stack([self.mean @ d for d in dx])
        return (dx[:, self.own] @ self.point + averaged @ self.neighbour) * (1.0 - y**2)

    def pull(self, g: FloatArray, y: FloatArray, size: int) -> FloatArray:
        """Gradients (m, n, ·) back through the layer with output y and `size` input rows."""
        g = g * (1.0 - y**2)
        spread = g @ self.neighbour.T
        back = np.stack([self.mean.T @ s for s in spread])
        back[:, self.own] += g @ self.point.T
        return back.reshape(len(g), size, -1)


class Decoder:
    """z (K,) to features (V, 9), or to those of the vertices it is restricted to.

    Args:
        network: the trained autoencoder.
        scaler: the feature scaling it was trained with.
        indptr, rings: one-rings of the mesh.
        vertices: (n,) the vertices wanted; None is all.
    """

    def __init__(
        self,
        network: MeshAutoencoder,
        scaler: FeatureScaler,
        indptr: IntArray,
        rings: IntArray,
        vertices: IntArray | None = None,
    ) -> None:
        """Collapse the affine first part and copy the remaining layers."""
        V = len(indptr) - 1
        degree = np.diff(indptr)
        data = np.repeat(1.0 / np.maximum(degree, 1), degree)
        mean = sparse.csr_array((data, rings, indptr), shape=(V, V))
        convs = [_arrays(conv) for conv in reversed(network.layers)]
        rows = np.arange(V) if vertices is None else np.asarray(vertices, dtype=np.int64)
        self._layers: list[_Layer] = []
        for point, neighbour, bias in reversed(convs[1:]):
            below = rows
            if vertices is not None:
                below = np.unique(np.concatenate([rows, mean[rows].indices]))
            place = np.zeros(V, dtype=np.int64)
            place[below] = np.arange(len(below))
            layer = _Layer(place[rows], mean[rows][:, below], point, neighbour, bias)
            self._layers.insert(0, layer)
            rows = below
        C = network.C.detach().double().cpu().numpy()
        self.components = C.shape[2]
        self.vertex_count = len(rows) if not self._layers else len(self._layers[-1].own)
        point, neighbour, bias = convs[0]
        averaged = (mean[rows] @ C.reshape(V, -1)).reshape(len(rows), *C.shape[1:])
        matrix = np.einsum("vmk,md->vdk", C[rows], point)
        matrix += np.einsum("vmk,md->vdk", averaged, neighbour)
        self.matrix = np.ascontiguousarray(matrix.reshape(-1, self.components))
        self.bias = np.tile(bias, len(rows))
        self._first_rows = len(rows)
        self._gain, self._offset = scaler.gain, scaler.offset
        self._single = self.matrix.astype(np.float32).reshape(len(rows), -1, self.components)
        self._single_bias = bias.astype(np.float32)

    def features(self, z: FloatArray) -> FloatArray:
        """Features (n, 9) of a latent code (K,)."""
        return self._activations(z)[-1] * self._gain + self._offset

    def fast_gradients(self, z: FloatArray) -> FloatArray:
        """Deformation gradients (n, 3, 3), the affine first part in single precision."""
        x = np.empty(self._single.shape[:2], dtype=np.float32)
        code = z.astype(np.float32)
        over_ranges(_affine, len(x), self._single, code, self._single_bias, x)
        np.tanh(x, out=x)
        output: NDArray = x
        for layer in self._layers:
            output = layer(output)
        return scaled_to_gradients(output, self._gain, self._offset)

    def single_features(self, z: FloatArray) -> FloatArray:
        """Features (n, 9), the affine first part in single precision; for few vertices."""
        flat = self._single.reshape(-1, self.components)
        x: NDArray = (flat @ z.astype(np.float32)).reshape(self._single.shape[:2])
        x += self._single_bias
        np.tanh(x, out=x)
        for layer in self._layers:
            x = layer(x)
        return x * self._gain + self._offset

    def _activations(self, z: FloatArray) -> list[FloatArray]:
        """Outputs (·, ·) of every tanh."""
        outputs = [np.tanh(self.matrix @ z + self.bias).reshape(self._first_rows, -1)]
        for layer in self._layers:
            outputs.append(layer(outputs[-1]))
        return outputs

    def differential(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Features (n, 9) and their derivative (K, n, 9) with respect to z."""
        outputs = self._activations(z)
        slope = 1.0 - outputs[0] ** 2
        dx = self.matrix.T.reshape(self.components, self._first_rows, -1) * slope
        for layer, y in zip(self._layers, outputs[1:], strict=True):
            dx = layer.push(dx, y)
        return outputs[-1] * self._gain + self._offset, dx * self._gain

    @property
    def pointwise(self) -> bool:
        """Whether a vertex's features depend on one tanh of its own rows alone (one layer)."""
        return not self._layers

    def pointwise_slope(self, q: FloatArray) -> FloatArray:
        """Derivative (n, 9) of features q (n, 9) with respect to the affine part's output."""
        x = (q - self._offset) / self._gain
        return (1.0 - x * x) * self._gain

    def pull_back_affine(self, g: NDArray) -> FloatArray:
        """Gradients (m, K) of gradients g (m, 9n) with respect to the affine part's output."""
        flat = self._single.reshape(-1, self.components)
        return (g @ flat).astype(np.float64)

    def pull_back(self, z: FloatArray, g: FloatArray) -> FloatArray:
        """Gradients (m, K) with respect to z of gradients g (m, n, 9) with respect to features."""
        outputs = self._activations(z)
        g = g * self._gain
        for layer, x, y in zip(self._layers[::-1], outputs[-2::-1], outputs[:0:-1], strict=True):
            g = layer.pull(g, y, len(x))
        g = g * (1.0 - outputs[0] ** 2)
        return g.reshape(len(g), self.matrix.shape[0]) @ self.matrix


def _arrays(conv: GraphConv) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Decoder-direction arrays: point (d', d), neighbour (d', d), bias (d)."""
    return (
        conv.point.detach().double().cpu().numpy(),
        conv.neighbour.detach().double().cpu().numpy(),
        conv.bias_back.detach().double().cpu().numpy(),
    )
