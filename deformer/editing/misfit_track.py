"""What the codes of a sequence miss at its handles: a smooth field in space and in time.

A model of few examples is off by an error of its own (`handle_errors`). In a motion it changes no
faster than the pose does: where a marker is not seen, the error is that of the frames around in
which it is, and of the markers near it.
"""

from __future__ import annotations

import numpy as np

from deformer.editing.acceleration import Roughness
from deformer.editing.handle_errors import ModelErrors
from deformer.geometry import FloatArray

# ℓ for a smoothness of 1: frames over which the error is alike.
_LENGTH = 3.0
# Share of the correlations' largest eigenvalue below which a mode is left out.
_LEAST = 1e-4
# Frequencies ω at which the spectrum is added up.
_FREQUENCIES = 4096


class MisfitTrack:
    """Expected errors of a model at H handles, given handles' errors in all frames of a window.

    The errors are B c_f in frame f, with B Bᵀ = τ² K and K of `ModelErrors`. The coefficients c are
    independent of each other, and each has the energy a Σ_f (c_f² + ℓ⁴ (c_{f−1} − 2 c_f +
    c_{f+1})²), with the factor a that makes its variance 1. Given all errors, their mean is the
    minimum of this and of the squared errors left, in deviations of the targets. As the unknowns'
    accelerations are, ℓ⁴ is in proportion to the smoothness.

    Args:
        errors: the model's.
        noise: σ, of the targets, in bounding diagonals.
        smoothness: weight of squared accelerations in the sequence; 0 is frames on their own.
    """

    def __init__(self, errors: ModelErrors, noise: float, smoothness: float) -> None:
        """Find the modes of the correlations, and the factor a."""
        values, vectors = np.linalg.eigh(errors.correlation)
        kept = values > _LEAST * values[-1]
        self._modes = errors.misfit * vectors[:, kept] * np.sqrt(values[kept])
        self._noise = noise
        self._roughness = _LENGTH**4 * smoothness
        # The variance is the mean of the spectrum 1 / (a (1 + ℓ⁴ (2 − 2 cos ω)²)).
        squared = (2.0 - 2.0 * np.cos(np.pi * (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES)) ** 2
        self._stiffness = float(np.mean(1.0 / (1.0 + self._roughness * squared)))
        self._last = np.zeros((0, self._modes.shape[1], 3))

    def expected(self, count: int, weights: FloatArray, errors: FloatArray) -> FloatArray:
        """Expected errors (m, H, 3) of the model in the m frames of a window.

        The windows follow each other: up to two frames before, as they were found, are fixed.

        Args:
            count: m.
            weights: (n, H) of the handles in these frames, and in some after them that also count;
                0 is a handle that is not seen.
            errors: (n, H, 3) of the handles in the same frames: targets less positions. Those of
                handles that are not seen do not count.
        """
        B, n, m = self._modes, len(errors), count
        precision, r = weights / self._noise**2, B.shape[1]
        before = self._last.reshape(len(self._last), 3 * r)
        roughness = Roughness(len(before), n, self._stiffness * self._roughness)
        A = np.einsum("hr,mh,hs->mrs", B, precision, B, optimize=True)
        np.einsum("mrr->mr", A)[:] += self._stiffness
        seen = np.where(precision[..., None] > 0, errors, 0.0)
        right = np.einsum("hr,mh,mhc->mrc", B, precision, seen, optimize=True)
        right -= roughness.half_gradient(before, np.zeros((n, 3 * r))).reshape(n, r, 3)
        c = roughness.solve(A, right, np.ones(r), 0.0)[:m]
        self._last = np.concatenate([self._last, c])[-2:]
        return np.asarray(np.einsum("hr,mrc->mhc", B, c), dtype=np.float64)
