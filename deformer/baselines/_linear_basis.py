"""Shapes that are an origin plus codes times components, and their fit to a few positions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from deformer.geometry import FloatArray, IntArray

# What is tried for handles. Ridges, in units of the mean variance of a known coordinate under the
# prior, the largest first: the first of equals is taken.
_RIDGES = np.logspace(2, -10, 25)
_SHRINKAGES = (0.01, 0.1, 0.3, 1.0)
_SEAMS = (0.0, 0.01, 0.1, 1.0)


@dataclass(frozen=True, eq=False)
class LinearBasis:
    """Shapes are origin + Σ_k z_k components_k.

    Args:
        origin: (V, 3), the mean of the training shapes: the mean of their codes is 0.
        components: (K, V, 3); some may be 0, their codes stay 0.
        seams: (S, K) rows whose product with good codes is about 0, in the unit of the positions;
            S may be 0.
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
        """Pseudo-inverse (3V, K); what is this much weaker than the strongest is rounding."""
        return np.asarray(np.linalg.pinv(self.matrix, rcond=1e-10), dtype=np.float64)

    def encode(self, vertices: FloatArray) -> FloatArray:
        """Codes (N, K) of shapes (N, V, 3), the method's own way."""
        return self.project(vertices)

    def decode(self, codes: FloatArray) -> FloatArray:
        """Shapes (N, V, 3) of codes (N, K)."""
        return self.origin + (codes @ self.matrix).reshape(len(codes), *self.origin.shape)

    def project(self, vertices: FloatArray) -> FloatArray:
        """Codes (N, K) of the shapes nearest to (N, V, 3); the shortest ones where several are."""
        return (vertices - self.origin).reshape(len(vertices), -1) @ self.inverse


@dataclass(frozen=True)
class Penalty:
    """What a handle fit charges besides the distance to the targets.

    Args:
        shrinkage: share of the codes' covariance that is taken from its diagonal alone.
        seam: charge for the squared products of seams and codes.
        ridge: charge for the squared length of the codes under the prior.
    """

    shrinkage: float
    seam: float
    ridge: float


class HandleRegression:
    """Codes from a few known positions, under the Gaussian of the training codes.

    Args:
        basis: the shapes.
        training: (N, V, 3) what it was learned from.
        unseen: (n, V, 3) shapes to judge penalties by.
    """

    def __init__(self, basis: LinearBasis, training: FloatArray, unseen: FloatArray) -> None:
        """Take the statistics of the training codes."""
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
        """Shrinkages and charges of seams to try."""
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
