"""Errors of handles: those of targets are independent, the model's own are alike at near handles.

The model misses a shape by a smooth field, of standard deviation τ and with the correlations K of a
thin plate (`HandleBasis.correlation`): a limb that no example bends so far is off as a whole. Many
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


def model_error(
    weights: FloatArray, noise: float, misfit: float, correlation: FloatArray
) -> FloatArray:
    """τ² K Σ⁻¹ (..., H, H): the expected error of the model, given the whole error.

    Args:
        weights, noise, misfit, correlation: as in `whitening`.
    """
    W = whitening(weights, noise, misfit, correlation)
    return misfit**2 * correlation @ np.swapaxes(W, -1, -2) @ W
