"""Linear shape spaces (an origin plus codes times components), and their fit to a few vertices."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from deformer.geometry import FloatArray, IntArray, procrustes

# Candidates for handle fits. Ridges are in units of the mean variance of a known coordinate under
# the prior; the largest comes first, because the first of equals wins.
_RIDGES = np.logspace(2, -10, 25)
_SHRINKAGES = (0.01, 0.1, 0.3, 1.0)
_SEAMS = (0.0, 0.01, 0.1, 1.0)
# Rounds of a free place and the code.
_PLACINGS = 30


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


@dataclass(frozen=True, eq=False)
class Placed:
    """Shapes Q (p(z) − c) + c + t, with c the centroid of the origin of a basis.

    Args:
        codes: z (..., K).
        rotations: Q (..., 3, 3).
        translations: t (..., 3).
    """

    codes: FloatArray
    rotations: FloatArray
    translations: FloatArray

    def first(self) -> Placed:
        """Those of the first ridge."""
        return Placed(self.codes[0], self.rotations[0], self.translations[0])


class HandleRegression:
    """Codes from a few known positions, under the Gaussian of the training codes.

    Args:
        basis: the shape space.
        training: (N, V, 3) shapes from which the basis was learned.
        unseen: (n, V, 3) other shapes, on which penalties are compared.
        free: true if the whole shape is placed freely, by the rigid motion that brings it closest
            to the targets; false if codes tell its place, too.
    """

    def __init__(
        self, basis: LinearBasis, training: FloatArray, unseen: FloatArray, free: bool = False
    ) -> None:
        """Compute the covariance of the training codes."""
        codes = basis.project(training)
        self.basis, self.free = basis, free
        self._unseen = unseen
        self._covariance = codes.T @ codes / len(codes)
        self._centre = basis.origin.mean(axis=0)

    def decode(self, placed: Placed) -> FloatArray:
        """Shapes (N, V, 3) of codes (N, K) in their places."""
        p = self.basis.decode(placed.codes) - self._centre
        moved = p @ np.swapaxes(placed.rotations, -1, -2)
        return moved + (self._centre + placed.translations)[:, None]

    def fit(
        self, handles: IntArray, targets: FloatArray, penalty: Penalty, ridges: FloatArray
    ) -> Placed:
        """Codes and places (R, n, …) for R ridges and n sets of targets (n, H, 3) of handles (H,).

        z = L y, L Lᵀ the shrunk covariance, y = argmin ‖p(z) − q‖² + seam ‖S z‖² + ridge u ‖y‖²
        with u the mean variance of a known coordinate. A free place takes turns with the code.
        The penalty's ridge is not used.
        """
        C, shrinkage = self._covariance, penalty.shrinkage
        values, vectors = np.linalg.eigh((1 - shrinkage) * C + shrinkage * np.diag(np.diag(C)))
        L = vectors * np.sqrt(np.maximum(values, 0.0))
        known = self.basis.components[:, handles].reshape(len(L), -1).T
        A = np.vstack([known, np.sqrt(penalty.seam) * self.basis.seams])
        U, s, Vt = np.linalg.svd(A @ L, full_matrices=False)
        unit = ((known @ L) ** 2).sum() / len(known) or 1.0
        gains = (s / (s**2 + unit * ridges[:, None]))[:, None]
        start, goals = self.basis.origin[handles] - self._centre, targets - self._centre

        def codes(q: FloatArray) -> FloatArray:
            residual = (q - start).reshape(*q.shape[:-2], -1)
            return ((residual @ U[: len(known)]) * gains) @ Vt @ L.T

        R, n = len(ridges), len(targets)
        Q, t = np.broadcast_to(np.eye(3), (R, n, 3, 3)), np.zeros((R, n, 3))
        if not self.free:
            return Placed(codes(goals), Q, t)
        z = np.zeros((R, n, len(L)))
        for _ in range(_PLACINGS):
            Q, t = procrustes(start + (z @ known.T).reshape(R, n, -1, 3), goals)
            z = codes((goals - t[..., None, :]) @ Q)
        return Placed(z, Q, t)

    def penalties(self) -> Iterator[tuple[float, float]]:
        """Candidate pairs of shrinkage and weight of the seams."""
        return product(_SHRINKAGES, _SEAMS if len(self.basis.seams) else _SEAMS[:1])

    def errors(
        self, handles: IntArray, shrinkage: float, seam: float, noise: float = 0.0
    ) -> FloatArray:
        """Σ ‖p − q‖² over all vertices of the unseen shapes q, for all ridges (R,).

        Args:
            handles: (H,) vertices whose positions are known.
            shrinkage, seam: as in `Penalty`.
            noise: standard deviation of the known coordinates.
        """
        targets = self._unseen[:, handles]
        targets = targets + noise * np.random.default_rng(0).normal(size=targets.shape)
        placed = self.fit(handles, targets, Penalty(shrinkage, seam, 0.0), _RIDGES)
        z = np.concatenate([np.ones((*placed.codes.shape[:2], 1)), placed.codes], axis=2)
        gram, means, squares, centroids, cross = self._products
        V, Q, t = self._unseen.shape[1], placed.rotations, placed.translations
        # ‖Q p + t − q‖² = ‖p‖² + ‖q‖² + V ‖t‖² + 2 V t · (Q p̄ − q̄) − 2 tr Q Σ p qᵀ
        apart = np.einsum("rnab,rnb->rna", Q, z @ means) - centroids
        found = ((z @ gram) * z).sum(2) + squares + V * (t * (t + 2.0 * apart)).sum(2)
        found -= 2.0 * np.einsum("rnab,nkba,rnk->rn", Q, cross, z, optimize=True)
        return np.maximum(found, 0.0).sum(1)

    @cached_property
    def _products(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Inner products of all vertices, of the K + 1 rows B of a shape (origin, components).

        Positions of the origin and of the unseen shapes q are relative to the origin's centroid.

        Returns:
            B Bᵀ (K+1, K+1), means (K+1, 3), ‖q‖² (n,), means (n, 3) and Σ B qᵀ (n, K+1, 3, 3).
        """
        rows = np.concatenate([(self.basis.origin - self._centre)[None], self.basis.components])
        q = self._unseen - self._centre
        flat = rows.reshape(len(rows), -1)
        cross = np.einsum("kva,nvb->nkab", rows, q, optimize=True)
        return flat @ flat.T, rows.mean(1), (q**2).sum((1, 2)), q.mean(1), cross


def choose_penalty(
    folds: list[HandleRegression], handles: IntArray, noise: float = 0.0
) -> tuple[Penalty, float]:
    """The penalty with the least error over the unseen shapes of all regressions, and this error.

    Args:
        folds: regressions, each learned without its unseen shapes.
        handles: (H,) vertices whose positions are known.
        noise: standard deviation of the known coordinates.
    """
    found = []
    for shrinkage, seam in folds[0].penalties():
        errors = np.sum([fold.errors(handles, shrinkage, seam, noise) for fold in folds], axis=0)
        first = int(errors.argmin())
        found.append((Penalty(shrinkage, seam, float(_RIDGES[first])), float(errors[first])))
    return min(found, key=lambda entry: entry[1])
