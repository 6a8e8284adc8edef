"""Errors of handles: those of targets are independent, the model's own are alike at near handles.

The model misses a shape by a smooth field, of standard deviation τ and with the correlations K of a
thin plate (`HandleBasis.misfit_rows`): a limb that no example bends so far is off as a whole. Many
handles on it tell that once, not many times, and the code is not bent out of shape for them.
"""

from __future__ import annotations

import numpy as np

from deformer.geometry import FloatArray


def whitening(
    weights: FloatArray, noise: float, misfit: float, correlation: FloatArray
) -> FloatArray:
    """W (..., H, H) with Wᵀ W = Σ⁻¹, the covariance of errors Σ = σ² diag(1/w) + τ² K.

    Args:
        weights: w (..., H) of the handles; one of weight 0 has an error without bound.
        noise: σ.
        misfit: τ, in the unit of the noise.
        correlation: K (H, H).
    """
    scale = np.sqrt(weights) / noise
    inner = misfit**2 * scale[..., :, None] * correlation * scale[..., None, :]
    factor = np.linalg.cholesky(inner + np.eye(len(correlation)))
    scaled = np.eye(len(correlation)) * scale[..., None, :]
    return np.asarray(np.linalg.solve(factor, scaled), dtype=np.float64)


class ModelErrors:
    """The errors of a model at its handles: their size and their correlations.

    The matrices of one set of weights and one noise are kept, for the frames of a drag share them.

    Args:
        misfit: τ, standard deviation at a handle, in bounding diagonals; positive.
        correlation: K (H, H).
    """

    def __init__(self, misfit: float, correlation: FloatArray) -> None:
        """Store the arguments."""
        self.misfit, self.correlation = misfit, correlation
        self._kept: tuple[float, FloatArray, FloatArray] | None = None
        self._expected: FloatArray | None = None

    def whitening(self, weights: FloatArray, noise: float) -> FloatArray:
        """`whitening` (..., H, H) of weights (..., H) and a noise in bounding diagonals."""
        kept = self._kept
        if kept is None or kept[0] != noise or not np.array_equal(kept[1], weights):
            W = whitening(weights, noise, self.misfit, self.correlation)
            self._kept, self._expected = (noise, weights.copy(), W), None
            return W
        return kept[2]

    def expected(self, weights: FloatArray, noise: float) -> FloatArray:
        """τ² K Σ⁻¹ (..., H, H): the expected error of the model, given the whole error.

        Args:
            weights, noise: as in `whitening`.
        """
        W = self.whitening(weights, noise)
        if self._expected is None:
            self._expected = self.misfit**2 * self.correlation @ np.swapaxes(W, -1, -2) @ W
        return self._expected
