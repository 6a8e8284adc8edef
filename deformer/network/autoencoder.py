"""The paper's network: graph convolutions, one tied linear map to the latent code, and back."""

from __future__ import annotations

import warnings
from itertools import pairwise
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from deformer.geometry import IntArray
from deformer.network.config import FEATURES
from deformer.network.weights import NetworkWeights

# Standard deviation of all initial weights, as in the public code of the paper's authors.
_DEVIATION = 0.02


class MeanOverRing(nn.Module):
    """Mean over the one-ring: x (V, …) to (V, …), 0 for a vertex without neighbours.

    Args:
        indptr, rings: one-rings in compressed rows, (V + 1,) and (2E,) int64, as
            `deformer.geometry.one_rings` returns them.
    """

    def __init__(self, indptr: IntArray, rings: IntArray) -> None:
        """Store the sparse averaging matrix and its transpose."""
        super().__init__()
        degree = np.diff(indptr)
        rows = np.repeat(np.arange(len(degree)), degree)
        self.register_buffer("crow", torch.from_numpy(np.array(indptr)), persistent=False)
        self.register_buffer("rows", torch.from_numpy(rows), persistent=False)
        self.register_buffer("columns", torch.from_numpy(np.array(rings)), persistent=False)
        inverse = torch.from_numpy((1.0 / np.maximum(degree, 1)).astype(np.float32))
        self.register_buffer("inverse_degree", inverse, persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """Mean (V, …) of the neighbours' rows of x (V, …)."""
        inverse = self.inverse_degree.to(x.dtype)
        return _RingMean.apply(x, self.crow, self.rows, self.columns, inverse)


def ring_sum(x: Tensor, crow: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """Sum over the one-ring, y_i = Σ_j x_j (V, m), of rows x (V, m).

    Args:
        x: (V, m) floating point.
        crow: (V + 1,) int64 row starts of the one-rings.
        rows: (2E,) int64 vertex of every entry of `columns`.
        columns: (2E,) int64 neighbours.
    """
    if x.device.type == "mps":  # it has no sparse products
        return torch.zeros_like(x).index_add_(0, rows, x[columns])
    ones = torch.ones(len(columns), dtype=x.dtype, device=x.device)
    size = (len(x), len(x))
    with warnings.catch_warnings():
        # torch (2.6 to 2.13) warns once a process that CSR tensors are in beta; the product used
        # here is stable.
        warnings.filterwarnings("ignore", message="Sparse CSR tensor support is in beta")
        return torch.sparse_csr_tensor(crow, columns, ones, size, check_invariants=False) @ x


class _RingMean(torch.autograd.Function):
    """D⁻¹ A x, with the gradient A D⁻¹ g: A is symmetric, so both need the same product."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, *graph: Tensor) -> Tensor:
        ctx.save_for_backward(*graph)
        crow, rows, columns, inverse = graph
        flat = x.reshape(len(x), -1)
        return (inverse[:, None] * ring_sum(flat, crow, rows, columns)).reshape(x.shape)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        crow, rows, columns, inverse = ctx.saved_tensors
        flat = inverse[:, None] * gradients[0].reshape(len(gradients[0]), -1)
        total = ring_sum(flat, crow, rows, columns).reshape(gradients[0].shape)
        return total, None, None, None, None


class GraphConv(nn.Module):
    """Graph convolution y_i = W_point x_i + W_neighbour mean_{j∈N(i)} x_j + b.

    Tan et al. 2018, equation 1.

    Args:
        inputs: d, width of x.
        outputs: d', width of y.
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        """Draw the weights from a normal distribution; the biases are zero."""
        super().__init__()
        self.point = nn.Parameter(_DEVIATION * torch.randn(outputs, inputs))
        self.neighbour = nn.Parameter(_DEVIATION * torch.randn(outputs, inputs))
        self.bias = nn.Parameter(torch.zeros(outputs))
        self.bias_back = nn.Parameter(torch.zeros(inputs))

    def forward(self, x: Tensor, mean: Tensor) -> Tensor:
        """Encoder direction.

        Args:
            x: (…, d), d features a vertex.
            mean: (…, d) its mean over each one-ring.

        Returns:
            (…, d').
        """
        return x @ self.point.T + mean @ self.neighbour.T + self.bias

    def back(self, y: Tensor, mean: Tensor) -> Tensor:
        """Decoder direction, with the transposed weights.

        Args:
            y: (…, d') what the encoder direction puts out.
            mean: (…, d') its mean over each one-ring.

        Returns:
            (…, d).
        """
        return y @ self.point + mean @ self.neighbour + self.bias_back


class MeshAutoencoder(nn.Module):
    """The autoencoder of scaled features: z = C f and f̂ = Cᵀ z, with tied weights.

    A tanh follows every convolution, except the encoder's last one if there are several. The first
    dimension of arrays is the vertex, (V, N, ·), so that the ring mean is one sparse product.

    Args:
        indptr, rings: one-rings of the mesh, as `deformer.geometry.one_rings` returns them.
        components: K.
        layers: widths of the encoder's convolutions.
    """

    def __init__(
        self, indptr: IntArray, rings: IntArray, components: int, layers: tuple[int, ...]
    ) -> None:
        """Draw all weights from a normal distribution; the biases are zero."""
        super().__init__()
        V = len(indptr) - 1
        self.mean = MeanOverRing(indptr, rings)
        widths = [FEATURES, *layers]
        self.convs = nn.ModuleList(GraphConv(a, b) for a, b in pairwise(widths))
        self.C = nn.Parameter(_DEVIATION * torch.randn(V, widths[-1], components))

    @classmethod
    def from_weights(
        cls, weights: NetworkWeights, indptr: IntArray, rings: IntArray
    ) -> MeshAutoencoder:
        """The network with copies of `weights`, on a mesh with the one-rings (indptr, rings)."""
        network = cls(indptr, rings, weights.C.shape[2], weights.layers)
        network.load_state_dict(
            {name: torch.from_numpy(array.copy()) for name, array in weights.arrays.items()}
        )
        return network.eval()

    @property
    def weights(self) -> NetworkWeights:
        """Copies of the weights as they are now."""
        return NetworkWeights.from_arrays(
            {name: value.detach().cpu().numpy().copy() for name, value in self.state_dict().items()}
        )

    @property
    def layers(self) -> list[GraphConv]:
        """The convolutions, in the encoder's order."""
        return cast(list[GraphConv], list(self.convs))

    @torch.no_grad()
    def start_from_components(self, x: Tensor) -> None:
        """Initialise near the best linear autoencoder of scaled features x (V, N, 9), N ≥ 1.

        The convolutions start close to the identity, as far as their widths allow, and C with the
        leading right singular vectors of the convolved features. Components that exceed the number
        of singular vectors keep their random start, scaled to a length of 0.1.
        """
        for conv in self.layers:
            conv.point.add_(1.1 * torch.eye(*conv.point.shape, device=x.device))
        f = self._convolve(x)
        # From the Gram matrix (N, N), which needs little memory beside f.
        values, vectors = torch.linalg.eigh(f @ f.T)
        count = min(self.C.shape[2], int((values > 1e-6 * values[-1]).sum()))
        leading = vectors[:, -count:].flip(1) / values[-count:].flip(0).sqrt()
        self.C.mul_(0.1 / self.C.square().sum(dim=(0, 1)).sqrt())
        self.C[:, :, :count] = (f.T @ leading).reshape(*self.C.shape[:2], count)

    def _convolve(self, x: Tensor, mean: Tensor | None = None) -> Tensor:
        """Output f (N, μV) of the encoder's convolutions."""
        for depth, conv in enumerate(self.layers):
            x = conv(x, self.mean(x) if depth or mean is None else mean)
            if depth < len(self.convs) - 1 or len(self.convs) == 1:
                x = torch.tanh(x)
        V, N, width = x.shape
        return x.transpose(0, 1).reshape(N, V * width)

    def encode(self, x: Tensor, mean: Tensor | None = None) -> Tensor:
        """Latent codes z (N, K) of scaled features x (V, N, 9); `mean` is their ring mean."""
        # z = C f (Tan et al. 2018, equation 2)
        return self._convolve(x, mean) @ self.C.reshape(-1, self.C.shape[2])

    def decode(self, z: Tensor) -> Tensor:
        """Scaled features (V, N, 9) of latent codes z (N, K)."""
        V, width, K = self.C.shape
        # f̂ = Cᵀ z (Tan et al. 2018, equation 3)
        x = (self.C.reshape(V * width, K) @ z.T).reshape(V, width, len(z)).transpose(1, 2)
        for conv in reversed(self.layers):
            x = torch.tanh(conv.back(x, self.mean(x)))
        return x

    def forward(self, x: Tensor, mean: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Reconstruction (V, N, 9) and latent codes (N, K) of scaled features x (V, N, 9).

        Args:
            x: (V, N, 9) scaled features, float32 as the weights are.
            mean: (V, N, 9) their ring mean; None computes it.
        """
        z = self.encode(x, mean)
        return self.decode(z), z
