"""The Gaussian prior of latent codes: mean and shrunk covariance of the training codes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deformer.checks import LARGEST, checked_array
from deformer.errors import InputError
from deformer.geometry import FloatArray

# Candidates of `fit_prior`: shrinkage α, inflation β, and weight γ of mirror images.
_ALPHAS = np.array([0.001, 0.003, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9])
_BETAS = np.array([1.0, 1.25, 1.5, 2.0])
_GAMMAS = (0.0, 0.25, 0.5, 1.0)


@dataclass(frozen=True, eq=False)
class LatentPrior:
    """Gaussian with `mean` (K,) and full `covariance` (K, K), positive definite."""

    mean: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        """Check the arrays.

        Raises:
            InputError: other shapes, numbers that are not finite, or a covariance that is not
                symmetric and positive definite.
        """
        mean = checked_array(self.mean, "latent_mean", ("K",), largest=LARGEST)
        K = len(mean)
        S = checked_array(self.covariance, "latent_covariance", (K, K), largest=LARGEST)
        # Products of matrices are symmetric up to rounding of their largest entries.
        definite = np.allclose(S, S.T, rtol=0.0, atol=1e-6 * np.abs(S).max(initial=0.0))
        try:
            np.linalg.cholesky(S)
        except np.linalg.LinAlgError:
            definite = False
        if not definite:
            raise InputError(
                "latent_covariance: expected a symmetric and positive definite matrix; retrain"
            )

    @property
    def factor(self) -> FloatArray:
        """Lower Cholesky factor (K, K): z = mean + factor y has this distribution for white y."""
        return np.asarray(np.linalg.cholesky(self.covariance), dtype=np.float64)


def fit_prior(codes: FloatArray, images: FloatArray | None = None) -> LatentPrior:
    """Mean and shrunk covariance of latent codes (N, K).

    The sample covariance S of few codes is singular, and too narrow for codes that it was not made
    from. Σ = β ((1−α) S + α diag(S) + tiny I), with the α and β that give held-out codes the
    highest likelihood (cross-validation with up to ten groups).

    Args:
        codes: (N, K).
        images: (N, K) codes of the shapes' mirror images, or None. Each weighs γ times as much as a
            shape's code in the mean and in S, with γ chosen together with α and β. An image is held
            out with its shape, and the likelihood is that of shapes alone.
    """
    N, K = codes.shape
    floor = 1e-6 * max(float(codes.var(axis=0).mean()), 1e-12)

    def moments(kept: NDArray, gamma: float) -> tuple[FloatArray, FloatArray]:
        rows, weights = codes[kept], np.ones(int(kept.sum()))
        if images is not None and gamma:
            rows = np.concatenate([rows, images[kept]])
            weights = np.concatenate([weights, gamma * weights])
        weights /= weights.sum()
        mean = weights @ rows
        deviation = rows - mean
        return mean, (deviation * weights[:, None]).T @ deviation

    def shrunk(S: FloatArray, alpha: float) -> FloatArray:
        variance = np.diag(S) + max(1e-2 * float(np.diag(S).mean()), floor)
        return (1.0 - alpha) * S + alpha * np.diag(variance)

    all_rows = np.ones(N, dtype=bool)
    if N < 4:
        mean, S = moments(all_rows, 0.0)
        return LatentPrior(mean, shrunk(S, 0.5) if N > 1 else np.eye(K))
    gammas = _GAMMAS if images is not None else _GAMMAS[:1]
    group = np.arange(N) % min(N, 10)
    score = np.zeros((len(gammas), len(_ALPHAS), len(_BETAS)))
    for g in range(group.max() + 1):
        held_out = codes[group == g]
        for s, gamma in enumerate(gammas):
            mean, S = moments(group != g, gamma)
            for a, alpha in enumerate(_ALPHAS):
                L = np.linalg.cholesky(shrunk(S, alpha))
                y = np.linalg.solve(L, (held_out - mean).T)
                log_volume = np.log(np.diag(L)).sum() + 0.5 * K * np.log(_BETAS)
                score[s, a] += 0.5 * (y**2).sum() / _BETAS + len(held_out) * log_volume
    s, a, b = np.unravel_index(score.argmin(), score.shape)
    mean, S = moments(all_rows, gammas[s])
    return LatentPrior(mean, _BETAS[b] * shrunk(S, float(_ALPHAS[a])))
