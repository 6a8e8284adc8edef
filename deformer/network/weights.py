"""The weights of a network as plain arrays: all that decoding and encoding need, without torch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from deformer.checks import LARGEST, checked_array
from deformer.errors import InputError
from deformer.geometry import IntArray
from deformer.network.config import FEATURES

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

    def check(self, name: str, width: int) -> int:
        """Check shapes and numbers for features of a width d; returns the width d'.

        Raises:
            InputError: other shapes, or numbers that are not finite; `name` comes first.
        """
        to = len(self.point) if np.ndim(self.point) else 0
        shapes = {"point": (to, width), "neighbour": (to, width), "bias": (to,)}
        for field, shape in {**shapes, "bias_back": (width,)}.items():
            _check_weights(f"{name}.{field}", getattr(self, field), shape)
        return to


@dataclass(frozen=True, eq=False)
class NetworkWeights:
    """Weights of an autoencoder.

    Args:
        convolutions: convolutions of the encoder, in its order.
        C: (V, μ, K) float32, the linear map between convolved features and the latent code. For a
            mesh with links (`Mesh.links`), V counts all sites: the vertices, then the links.
    """

    convolutions: tuple[ConvolutionWeights, ...]
    C: Weights

    def __post_init__(self) -> None:
        """Check that the layers fit each other.

        Raises:
            InputError: no layer, other shapes, or numbers that are not finite.
        """
        width = FEATURES
        if not self.convolutions:
            raise InputError("network: no 'convs.0.point', expected at least one layer; retrain")
        for depth, convolution in enumerate(self.convolutions):
            width = convolution.check(f"network.convs.{depth}", width)
        _check_weights("network.C", self.C, ("V", width, "K"))

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
            InputError: an array is missing, unknown, of another shape, or not finite.
        """
        depth = max(1, len({name.split(".")[1] for name in arrays if name.startswith("convs.")}))
        fields = ("point", "neighbour", "bias", "bias_back")
        expected = {"C", *(f"convs.{n}.{field}" for n in range(depth) for field in fields)}
        if set(arrays) != expected:
            name = sorted(set(arrays) ^ expected)[0]
            what = "missing" if name in expected else "unknown"
            raise InputError(f"network.{name}: {what}; restore the file or retrain")
        convolutions = (
            ConvolutionWeights(
                *(np.asarray(arrays[f"convs.{n}.{name}"], dtype=np.float32) for name in fields)
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


def _check_weights(name: str, array: Weights, shape: tuple[int | str, ...]) -> None:
    remedy = "restore the file, or train again with a lower learning rate"
    if array.size and max(-float(array.min()), float(array.max())) <= LARGEST:
        # Only the shape is left to check: a large array is not converted.
        array = np.broadcast_to(np.float32(0), array.shape)
    checked_array(array, name, shape, largest=LARGEST, remedy=remedy)


def ring_mean(indptr: IntArray, rings: IntArray) -> sparse.csr_array:
    """Matrix (V, V) that averages over the one-ring; 0 for a vertex without neighbours.

    Args:
        indptr, rings: one-rings in compressed rows, as `deformer.geometry.one_rings` returns them.
    """
    degree = np.diff(indptr)
    data = np.repeat(1.0 / np.maximum(degree, 1), degree)
    return sparse.csr_array((data, rings, indptr), shape=(len(degree), len(degree)))
