"""Linear shape spaces (an origin plus codes times components), and their fit to a few vertices."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from deformer.geometry import FloatArray, IntArray

# Candidates for handle fits. Ridges are in units of the mean variance of a known coordinate under
# the prior; the largest comes first, because the first of equals wins.
_RIDGES = np.logspace(2, -10, 25)
_SHRINKAGES = (0.01, 0.1, 0.3, 1.0)
_SEAMS = (0.0, 0.01, 0.1, 1.0)


@dataclass(frozen=True, eq=False)
class LinearBasis:
    """Shapes origin + Σ_k z_k components_k.

    Args:
        origin: (V, 3) mean of the training shapes, so that their codes have the mean 0.
        components: (K, V, 3); a component may be 0, and its codes are then 0.
        seams: (S, K) matrix S with S z ≈ 0 where neighbouring regions agree, in the unit of the
            positions; S may be 0.
    """

    origin: FloatArray
    components: FloatArray
    seams: FloatArray

    @cached_property
    def matrix(self) -> FloatArray:
        """Components (K, 3V)."""
        return self.components.reshape(len(self.components), -1)

    @cached_property
    def inverse(self) -> FloatArray:
        """Pseudo-inverse (3V, K); singular values below 1e-10 of the largest count as 0."""
        return np.asarray(np.linalg.pinv(self.matrix, rcond=1e-10), dtype=np.float64)

    def encode(self, vertices: FloatArray) -> FloatArray:
        """Codes (N, K) of shapes (N, V, 3); a method may override this least-squares fit."""
        return self.project(vertices)

    def decode(self, codes: FloatArray) -> FloatArray:
        """Shapes (N, V, 3) of codes (N, K)."""
        return self.origin + (codes @ self.matrix).reshape(len(codes), *self.origin.shape)

    def project(self, vertices: FloatArray) -> FloatArray:
        """Codes (N, K) of the shapes nearest to (N, V, 3); of several codes the shortest."""
        return (vertices - self.origin).reshape(len(vertices), -1) @ self.inverse


@dataclass(frozen=True)
class Penalty:
    """Regularisation of a handle fit.

    Args:
        shrinkage: from 0, the full covariance of the codes, to 1, its diagonal alone.
        seam: weight of ‖S z‖², S the seams.
        ridge: weight of the squared Mahalanobis length of the code.
    """

    shrinkage: float
    seam: float
    ridge: float


class HandleRegression:
    """Codes from a few known positions, under the Gaussian of the training codes.

    Args:
        basis: the shape space.
        training: (N, V, 3) shapes from which the basis was learned.
        unseen: (n, V, 3) other shapes, on which penalties are compared.
    """

    def __init__(self, basis: LinearBasis, training: FloatArray, unseen: FloatArray) -> None:
        """Compute the covariance of the training codes."""
        codes = basis.project(training)
        self._basis = basis
        self._unseen = unseen
        self._covariance = codes.T @ codes / len(codes)

    def codes(
        self,
        handles: IntArray,
        targets: FloatArray,
        shrinkage: float,
        seam: float,
        ridges: FloatArray,
    ) -> FloatArray:
        """Codes (R, n, K) for n sets of targets (n, H, 3) of handles (H,), for all ridges (R,).

        z = L y, L Lᵀ the shrunk covariance, y = argmin ‖p(z) − q‖² + seam ‖S z‖² + ridge u ‖y‖²
        with u the mean variance of a known coordinate.
        """
        C = self._covariance
        values, vectors = np.linalg.eigh((1 - shrinkage) * C + shrinkage * np.diag(np.diag(C)))
        L = vectors * np.sqrt(np.maximum(values, 0.0))
        known = self._basis.components[:, handles].reshape(len(L), -1).T
        seams = np.sqrt(seam) * self._basis.seams
        A = np.vstack([known, seams])
        residual = (targets - self._basis.origin[handles]).reshape(len(targets), -1)
        wanted = np.hstack([residual, np.zeros((len(targets), len(seams)))])
        U, s, Vt = np.linalg.svd(A @ L, full_matrices=False)
        unit = ((known @ L) ** 2).sum() / len(known) or 1.0
        filtered = (wanted @ U) * (s / (s**2 + unit * ridges[:, None]))[:, None]
        return filtered @ Vt @ L.T

    def penalties(self) -> Iterator[tuple[float, float]]:
        """Candidate pairs of shrinkage and weight of the seams."""
        return product(_SHRINKAGES, _SEAMS if len(self._basis.seams) else _SEAMS[:1])

    def errors(self, handles: IntArray, shrinkage: float, seam: float) -> FloatArray:
        """Σ ‖p(z) − p‖² over all vertices of the unseen shapes, for all ridges (R,)."""
        codes = self.codes(handles, self._unseen[:, handles], shrinkage, seam, _RIDGES)
        fixed, against, gram = self._products
        return fixed - 2 * (codes * against).sum((1, 2)) + ((codes @ gram) * codes).sum((1, 2))

    @cached_property
    def _products(self) -> tuple[float, FloatArray, FloatArray]:
        difference = (self._unseen - self._basis.origin).reshape(len(self._unseen), -1)
        C = self._basis.matrix
        return float((difference**2).sum()), difference @ C.T, C @ C.T


def choose_penalty(folds: list[HandleRegression], handles: IntArray) -> Penalty:
    """The penalty with the least error over the unseen shapes of all regressions together."""
    best, lowest = None, np.inf
    for shrinkage, seam in folds[0].penalties():
        errors = np.sum([fold.errors(handles, shrinkage, seam) for fold in folds], axis=0)
        first = int(errors.argmin())
        if best is None or errors[first] < lowest:
            best, lowest = Penalty(shrinkage, seam, float(_RIDGES[first])), errors[first]
    assert best is not None
    return best
