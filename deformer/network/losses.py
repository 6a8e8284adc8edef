"""The paper's loss: its three terms and their sum (Tan et al. 2018, equations 4 to 8)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from deformer.geometry import Geodesics, SiteGeodesics
from deformer.network.locality import locality_row


class Loss(NamedTuple):
    """The terms of the loss, each with its weight, as scalar tensors.

    Args:
        reconstruction: mean squared error of a shape's features.
        sparsity: λ₁ Ω(C).
        latent_range: λ₂ V(Z).
    """

    reconstruction: Tensor
    sparsity: Tensor
    latent_range: Tensor

    @property
    def total(self) -> Tensor:
        """The sum of the terms."""
        return self.reconstruction + self.sparsity + self.latent_range


def loss(
    x: Tensor,
    estimate: Tensor,
    z: Tensor,
    C: Tensor,
    locality: Tensor,
    *,
    sparsity_weight: float = 0.5,
    range_weight: float = 0.5,
    range_limit: float = 5.0,
) -> Loss:
    """The total loss (Tan et al. 2018, equation 8): (1/N) Σ_m ‖X̂_m − X_m‖² + λ₁ Ω(C) + λ₂ V(Z).

    Args:
        x: (V, N, 9) scaled features of the shapes.
        estimate: (V, N, 9) the network's reconstruction of them.
        z: (N, K) their latent codes.
        C: (V, μ, K) components.
        locality: Λ (V, K), of `Locality.update`.
        sparsity_weight: λ₁.
        range_weight: λ₂.
        range_limit: θ.
    """
    return Loss(
        reconstruction(x, estimate),
        sparsity_weight * sparsity(C, locality),
        range_weight * latent_range(z, range_limit),
    )


def reconstruction(x: Tensor, estimate: Tensor) -> Tensor:
    """Squared error summed over a shape, mean over shapes; the first term of the total loss.

    Args:
        x, estimate: (V, N, 9) scaled features.
    """
    return (estimate - x).square().sum() / x.shape[1]


def sparsity(C: Tensor, locality: Tensor) -> Tensor:
    """Ω(C) = (1/K) Σ_k Σ_i Λ_ik ‖C_k^i‖₂ (Tan et al. 2018, equation 4).

    Args:
        C: (V, μ, K) components.
        locality: Λ (V, K).
    """
    # Written out, since torch's norm along an inner axis takes ten times as long. The floor makes
    # the gradient 0 where C_k^i is 0.
    lengths = C.square().sum(dim=1).clamp(min=torch.finfo(C.dtype).tiny).sqrt()
    return (locality * lengths).sum() / C.shape[2]


def latent_range(z: Tensor, limit: float) -> Tensor:
    """V(Z) = (1/K) Σ_k max(0, max_m |Z_km| − θ) (Tan et al. 2018, equation 7).

    The paper's equation has no max(0, ·), but its authors' code does: without it small codes would
    be rewarded.

    Args:
        z: (N, K) latent codes.
        limit: θ.
    """
    return (z.abs().amax(dim=0) - limit).clamp(min=0).sum() / z.shape[1]


def centres(C: Tensor) -> Tensor:
    """Centres c_k = argmax_i ‖C_k^i‖₂ (K,) of components (Tan et al. 2018, equation 6).

    Args:
        C: (V, μ, K) components.
    """
    return C.square().sum(dim=1).argmax(dim=0)


class Locality:
    """Λ (V, K) for the current centres of the components, from K rows of geodesic distances.

    Args:
        geodesics: distances over the reference.
        d_min, d_max: distances, as in `ModelConfig`.
    """

    def __init__(self, geodesics: Geodesics | SiteGeodesics, d_min: float, d_max: float) -> None:
        """Start without centres."""
        self._geodesics = geodesics
        self._range = d_min, d_max
        self._centres: np.ndarray | None = None
        self._matrix: Tensor | None = None

    def update(self, C: Tensor) -> Tensor:
        """Λ (V, K) for the centres of C (V, μ, K); recomputes only columns whose centre moved."""
        with torch.no_grad():
            found = centres(C).cpu().numpy()
        if self._centres is None or self._matrix is None:
            self._matrix = torch.zeros(C.shape[0], C.shape[2], dtype=C.dtype, device=C.device)
            self._centres = np.full(len(found), -1)
        for k in np.flatnonzero(found != self._centres):
            row = locality_row(self._geodesics.normalised_row(int(found[k])), *self._range)
            self._matrix[:, k] = torch.as_tensor(row, dtype=C.dtype, device=C.device)
        self._centres = found
        return self._matrix
