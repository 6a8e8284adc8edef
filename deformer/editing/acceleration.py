"""Squared accelerations of a sequence of unknowns, and the banded systems of their minimum."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from deformer.geometry import FloatArray

# Coefficients of a second difference: a row of D.
_SECOND = (1.0, -2.0, 1.0)


class Roughness:
    """Weighted sum Σ_f ‖x_{f−1} − 2 x_f + x_{f+1}‖² over m frames of n unknowns.

    Up to two frames before the m are fixed; the second differences reach them, too.

    Args:
        fixed: number of fixed frames before, 0 to 2.
        count: number of frames m.
        weight: factor on the sum.
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
        """The weighted sum, each unknown's accelerations multiplied by its scale.

        Args:
            before: (fixed, n) unknowns of the fixed frames.
            X: (m, n) unknowns of the frames.
            scale: (n,) factors on the squared accelerations.
        """
        second = np.diff(np.concatenate([before, X]), 2, axis=0)
        return float(self._weight * (second**2 @ scale).sum())

    def half_gradient(self, before: FloatArray, X: FloatArray) -> FloatArray:
        """Half the gradient (m, n) of the energy by X, for a scale of ones."""
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
        """Solve (A + weight DᵀD, damped) x = gradient for all frames at once.

        Args:
            A: (m, n, n) symmetric blocks of the frames on the diagonal.
            gradient: (m, n) right-hand side, or several (m, n, k).
            scale: (n,) factors on the squared accelerations.
            damping: factor on the diagonal, which is multiplied by 1 + damping.

        Returns:
            x of the shape of `gradient`, by one banded Cholesky factorisation.

        Raises:
            numpy.linalg.LinAlgError: the matrix is not positive definite.
        """
        m, n = gradient.shape[:2]
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
            gradient.reshape(m * n, *gradient.shape[2:]),
            overwrite_ab=True,
            lower=True,
            check_finite=False,
        )
        return step.reshape(gradient.shape)
