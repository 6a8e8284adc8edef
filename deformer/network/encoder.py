"""A trained encoder: features to latent codes."""

from __future__ import annotations

import numpy as np

from deformer.acap import FeatureScaler
from deformer.geometry import FloatArray, IntArray
from deformer.linalg import in_parallel
from deformer.network.decoder import Decoder
from deformer.network.weights import NetworkWeights, Weights, ring_mean

# Shapes whose convolved features are in memory at once.
_BATCH = 16


class Encoder:
    """Features (N, V, 9) to latent codes (N, K).

    Args:
        weights: weights of the trained network.
        scaler: the feature scaling that it was trained with.
        indptr, rings: one-rings of the mesh, as `deformer.geometry.one_rings` returns them.
        projection: decoder whose `Decoder.project` encodes; None encodes with the network's own
            encoder (Tan et al. 2018).
    """

    def __init__(
        self,
        weights: NetworkWeights,
        scaler: FeatureScaler,
        indptr: IntArray,
        rings: IntArray,
        projection: Decoder | None = None,
    ) -> None:
        """Prepare the ring mean in single precision, which the network is in."""
        self._weights, self._scaler, self._projection = weights, scaler, projection
        self._mean = ring_mean(indptr, rings).astype(np.float32)

    def encode(self, q: FloatArray) -> FloatArray:
        """Latent codes (N, K) of features q (N, V, 9)."""
        if self._projection is not None:
            return np.array(list(in_parallel(self._projection.project, list(q))))
        C = self._weights.C
        codes = np.empty((len(q), C.shape[2]))
        for start in range(0, len(q), _BATCH):
            part = slice(start, start + _BATCH)
            x = self._scaler.scale(q[part]).astype(np.float32)
            f = np.stack([self._convolve(shape).ravel() for shape in x])
            # z = C f (Tan et al. 2018, equation 2)
            codes[part] = f @ C.reshape(-1, C.shape[2])
        return codes

    def _convolve(self, x: Weights) -> Weights:
        """Output f (V, μ) of the convolutions for scaled features x (V, 9)."""
        last = len(self._weights.convolutions) - 1
        for depth, w in enumerate(self._weights.convolutions):
            # y_i = W_point x_i + W_neighbour mean_{j∈N(i)} x_j + b (Tan et al. 2018, equation 1)
            x = x @ w.point.T + (self._mean @ x) @ w.neighbour.T + w.bias
            if depth < last or last == 0:  # the last of several is linear
                x = np.tanh(x)
        return x
