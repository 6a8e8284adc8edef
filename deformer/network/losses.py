"""The three terms of the paper's loss."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from deformer.geometry import Geodesics
from deformer.network.locality import locality_row


def reconstruction(x: Tensor, estimate: Tensor) -> Tensor:
    """Squared error summed over a shape, mean over shapes; both (V, N, 9)."""
    return (estimate - x).square().sum() / x.shape[1]


def sparsity(C: Tensor, locality: Tensor) -> Tensor:
    """Ω(C) = (1/K) Σ_k Σ_i Λ_ik ‖C_k^i‖₂ for C (V, μ, K) and Λ (V, K)."""
    # Written out: torch's norm along an inner axis takes ten times as long. The floor is for the
    # gradient, 0 where C_k^i is.
    lengths = C.square().sum(dim=1).clamp(min=torch.finfo(C.dtype).tiny).sqrt()
    return (locality * lengths).sum() / C.shape[2]


def latent_range(z: Tensor, limit: float) -> Tensor:
    """V(Z) = (1/K) Σ_k max(0, max_m |Z_km| − θ) for z (N, K) and θ = `limit`."""
    return (z.abs().amax(dim=0) - limit).clamp(min=0).sum() / z.shape[1]


def centres(C: Tensor) -> Tensor:
    """Centre c_k = argmax_i ‖C_k^i‖₂ (K,) of every component of C (V, μ, K)."""
    return C.square().sum(dim=1).argmax(dim=0)


class Locality:
    """Λ (V, K) that follows the centres of the components, K geodesic rows at a time.

    Args:
        geodesics: distances of the reference.
        d_min, d_max: as in `ModelConfig`.
    """

    def __init__(self, geodesics: Geodesics, d_min: float, d_max: float) -> None:
        """Start without centres."""
        self._geodesics = geodesics
        self._range = d_min, d_max
        self._centres: np.ndarray | None = None
        self._matrix: Tensor | None = None

    def update(self, C: Tensor) -> Tensor:
        """Λ (V, K) for the present centres of C (V, μ, K); only moved columns are renewed."""
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
