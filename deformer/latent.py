"""Statistics of latent codes: the Gaussian prior that handle fits lean on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.mesh import FloatArray


@dataclass(frozen=True, eq=False)
class LatentPrior:
    """Gaussian with `mean` (K,) and full `covariance` (K, K), positive definite."""

    mean: FloatArray
    covariance: FloatArray

    @property
    def factor(self) -> FloatArray:
        """Lower Cholesky factor (K, K): z = mean + factor y has this distribution for white y."""
        return np.asarray(np.linalg.cholesky(self.covariance), dtype=np.float64)


def fit_prior(codes: FloatArray) -> LatentPrior:
    """Mean and shrunk covariance of latent codes (N, K).

    The sample covariance S of few codes is singular; Σ = (1−α) S + α diag(S) + tiny I with the α
    that gives held-out codes the highest likelihood (leave-out in up to ten groups).
    """
    N, K = codes.shape
    mean = codes.mean(axis=0)
    floor = 1e-6 * max(float(codes.var(axis=0).mean()), 1e-12)

    def shrunk(rows: FloatArray, alpha: float) -> FloatArray:
        S = np.cov(rows, rowvar=False, bias=True).reshape(K, K)
        variance = np.diag(S) + max(1e-2 * float(np.diag(S).mean()), floor)
        return (1.0 - alpha) * S + alpha * np.diag(variance)

    alphas = np.array([0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9])
    if N < 4:
        return LatentPrior(mean, shrunk(codes, 0.5) if N > 1 else np.eye(K))
    groups = np.arange(N) % min(N, 10)
    score = np.zeros(len(alphas))
    for group in range(groups.max() + 1):
        kept, left = codes[groups != group], codes[groups == group]
        for a, alpha in enumerate(alphas):
            L = np.linalg.cholesky(shrunk(kept, alpha))
            y = np.linalg.solve(L, (left - kept.mean(axis=0)).T)
            score[a] += 0.5 * (y**2).sum() + len(left) * np.log(np.diag(L)).sum()
    return LatentPrior(mean, shrunk(codes, float(alphas[score.argmin()])))
