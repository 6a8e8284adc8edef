"""The weights of a network as plain arrays: all that decoding and encoding need, without torch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from deformer.geometry import IntArray

Weights = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class ConvolutionWeights:
    """Weights of one graph convolution from width d to width d' (Tan et al. 2018, equation 1).

    Args:
        point: (d', d) float32, W_point.
        neighbour: (d', d) float32, W_neighbour.
        bias: (d',) float32, b of the encoder's direction.
        bias_back: (d,) float32, b of the decoder's direction, whose matrices are the transposes.
    """

    point: Weights
    neighbour: Weights
    bias: Weights
    bias_back: Weights


@dataclass(frozen=True, eq=False)
class NetworkWeights:
    """Weights of an autoencoder.

    Args:
        convolutions: convolutions of the encoder, in its order.
        C: (V, μ, K) float32, the linear map between convolved features and the latent code.
    """

    convolutions: tuple[ConvolutionWeights, ...]
    C: Weights

    @property
    def arrays(self) -> dict[str, Weights]:
        """All arrays by their names in `MeshAutoencoder.state_dict`, sorted by name."""
        named = {"C": self.C}
        for depth, convolution in enumerate(self.convolutions):
            for name, array in vars(convolution).items():
                named[f"convs.{depth}.{name}"] = array
        return dict(sorted(named.items()))

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray]) -> NetworkWeights:
        """Weights from arrays by name: the inverse of the property `arrays`.

        Raises:
            KeyError: an array is missing.
        """
        depth = len({name.split(".")[1] for name in arrays if name.startswith("convs.")})
        convolutions = (
            ConvolutionWeights(
                *(
                    np.asarray(arrays[f"convs.{n}.{name}"], dtype=np.float32)
                    for name in ("point", "neighbour", "bias", "bias_back")
                )
            )
            for n in range(depth)
        )
        return cls(tuple(convolutions), np.asarray(arrays["C"], dtype=np.float32))

    @property
    def layers(self) -> tuple[int, ...]:
        """Output width of each convolution, as `ModelConfig.layers`."""
        return tuple(len(convolution.point) for convolution in self.convolutions)

    def pruned(self, share: float) -> NetworkWeights:
        """A copy with weights ‖C_k^i‖ below `share` of component k's largest set to zero."""
        strength = np.linalg.norm(self.C, axis=1, keepdims=True)
        small = strength < share * strength.max(axis=0)
        return replace(self, C=np.where(small, np.float32(0.0), self.C))


def ring_mean(indptr: IntArray, rings: IntArray) -> sparse.csr_array:
    """Matrix (V, V) that averages over the one-ring; 0 for a vertex without neighbours.

    Args:
        indptr, rings: one-rings in compressed rows, as `deformer.geometry.one_rings` returns them.
    """
    degree = np.diff(indptr)
    data = np.repeat(1.0 / np.maximum(degree, 1), degree)
    return sparse.csr_array((data, rings, indptr), shape=(len(degree), len(degree)))
