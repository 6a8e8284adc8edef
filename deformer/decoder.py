"""A trained decoder as plain arrays: features, their differential and its transpose, in float64.

The linear map Cᵀ and the linear part of the first decoder convolution collapse into one matrix,
so a network of one layer costs one matrix-vector product and one tanh.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from deformer.autoencoder import GraphConv, MeshAutoencoder
from deformer.features import FeatureScaler
from deformer.mesh import FloatArray, IntArray


class Decoder:
    """z (K,) to features (V, 9).

    Args:
        network: the trained autoencoder.
        scaler: the feature scaling it was trained with.
        indptr, rings: one-rings of the mesh.
    """

    def __init__(
        self,
        network: MeshAutoencoder,
        scaler: FeatureScaler,
        indptr: IntArray,
        rings: IntArray,
    ) -> None:
        """Collapse the affine first part and copy the remaining layers."""
        V = len(indptr) - 1
        degree = np.diff(indptr)
        data = np.repeat(1.0 / np.maximum(degree, 1), degree)
        self._mean = sparse.csr_array((data, rings, indptr), shape=(V, V))
        convs = [_arrays(conv) for conv in reversed(network.layers)]
        C = network.C.detach().double().cpu().numpy()
        self.vertex_count, _, self.components = C.shape
        point, neighbour, bias = convs[0]
        averaged = (self._mean @ C.reshape(V, -1)).reshape(C.shape)
        matrix = np.einsum("vmk,md->vdk", C, point) + np.einsum("vmk,md->vdk", averaged, neighbour)
        self.matrix = np.ascontiguousarray(matrix.reshape(-1, self.components))
        self.bias = np.tile(bias, V)
        self._layers = convs[1:]
        self._gain, self._offset = scaler.gain, scaler.offset

    def features(self, z: FloatArray) -> FloatArray:
        """Features (V, 9) of a latent code (K,)."""
        return self._activations(z)[-1] * self._gain + self._offset

    def _activations(self, z: FloatArray) -> list[FloatArray]:
        """Outputs (V, ·) of every tanh."""
        x = np.tanh(self.matrix @ z + self.bias).reshape(self.vertex_count, -1)
        outputs = [x]
        for point, neighbour, bias in self._layers:
            x = np.tanh(x @ point + (self._mean @ x) @ neighbour + bias)
            outputs.append(x)
        return outputs

    def differential(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Features (V, 9) and their derivative (K, V, 9) with respect to z."""
        outputs = self._activations(z)
        V, K = self.vertex_count, self.components
        slope = 1.0 - outputs[0] ** 2
        dx = self.matrix.T.reshape(K, V, -1) * slope
        for (point, neighbour, _), y in zip(self._layers, outputs[1:], strict=True):
            averaged = np.stack([self._mean @ d for d in dx])
            dx = (dx @ point + averaged @ neighbour) * (1.0 - y**2)
        return outputs[-1] * self._gain + self._offset, dx * self._gain

    def pull_back(self, z: FloatArray, g: FloatArray) -> FloatArray:
        """Gradients (m, K) with respect to z of gradients g (m, V, 9) with respect to features."""
        outputs = self._activations(z)
        g = g * self._gain
        for (point, neighbour, _), y in zip(self._layers[::-1], outputs[:0:-1], strict=True):
            g = g * (1.0 - y**2)
            spread = g @ neighbour.T
            g = g @ point.T + np.stack([self._mean.T @ s for s in spread])
        g = g * (1.0 - outputs[0] ** 2)
        return g.reshape(len(g), self.matrix.shape[0]) @ self.matrix


def _arrays(conv: GraphConv) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Decoder-direction arrays: point (d', d), neighbour (d', d), bias (d)."""
    return (
        conv.point.detach().double().cpu().numpy(),
        conv.neighbour.detach().double().cpu().numpy(),
        conv.bias_back.detach().double().cpu().numpy(),
    )
