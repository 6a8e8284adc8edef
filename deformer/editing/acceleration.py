"""Squared accelerations of a sequence, and the banded systems that they lead to."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from deformer.geometry import FloatArray

# A row of D: the second difference.
_SECOND = (1.0, -2.0, 1.0)


class Roughness:
    """Σ_f ‖x_{f−1} − 2 x_f + x_{f+1}‖² over m frames, with up to two fixed ones before them.

    Args:
        fixed: number of frames before.
        count: m.
        weight: factor.
    """

    def __init__(self, fixed: int, count: int, weight: float) -> None:
        """Assemble the matrix DᵀD of second differences."""
        total = fixed + count
        rows = max(total - 2, 0)
        # Diagonals 0, 1 and 2 of DᵀD, weight included.
        self._diagonals = np.zeros((3, total))
        for a, left in enumerate(_SECOND):
            for b, right in enumerate(_SECOND[a:]):
                self._diagonals[b, a : a + rows] += weight * left * right
        self._fixed, self._weight = fixed, weight

    def energy(self, before: FloatArray, X: FloatArray, scale: FloatArray) -> float:
        """Value for rows X (m, n) after `before`, columns weighted by scale (n,)."""
        second = np.diff(np.concatenate([before, X]), 2, axis=0)
        return float(self._weight * (second**2 @ scale).sum())

    def half_gradient(self, before: FloatArray, X: FloatArray) -> FloatArray:
        """Half the gradient (m, n) for scales of one."""
        Y = np.concatenate([before, X])
        d = self._diagonals
        out = d[0][:, None] * Y
        for k in (1, 2):
            out[:-k] += d[k, : len(Y) - k, None] * Y[k:]
            out[k:] += d[k, : len(Y) - k, None] * Y[:-k]
        return out[self._fixed :]

    def solve(
        self, A: FloatArray, gradient: FloatArray, scale: FloatArray, damping: float
    ) -> FloatArray:
        """Step (m, n): (blocks A (m, n, n), damped, plus this matrix)⁻¹ gradient (m, n)."""
        m, n = gradient.shape
        d = self._diagonals[:, self._fixed :]
        # Lower band: row k holds the k-th subdiagonal; unknowns run frame by frame.
        width = 2 * n if self._weight > 0 else n - 1
        band = np.zeros((width + 1, m, n))
        for k in range(n):
            band[k, :, : n - k] = A[:, np.arange(k, n), np.arange(n - k)]
        band[0] += d[0][:, None] * scale
        band[0] *= 1.0 + damping
        if self._weight > 0:
            band[n, :-1] += d[1, : m - 1, None] * scale
            band[2 * n, :-2] += d[2, : max(m - 2, 0), None] * scale
        step = solveh_banded(
            band.reshape(width + 1, m * n),
            gradient.ravel(),
            overwrite_ab=True,
            lower=True,
            check_finite=False,
        )
        return step.reshape(m, n)
