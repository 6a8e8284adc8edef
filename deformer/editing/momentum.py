"""Nesterov's momentum: a fixed-point iteration in fewer rounds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Momentum:
    """Moves the results of an iteration x ← f(x) on along their last change.

    The share of the change grows from round to round towards 1. It starts anew where the iteration
    turns back, as after going too far (O'Donoghue and Candès, Adaptive Restart for Accelerated
    Gradient Schemes, 2015, section 3.2). Linear iterations converge if the eigenvalues of f are
    between −1/3 and 1.

    Source: Nesterov, A Method of Solving a Convex Programming Problem with Convergence Rate
    O(1/k²), 1983.
    """

    def __init__(self) -> None:
        """Begin an iteration."""
        self._round = 1.0
        self._last: NDArray | None = None
        self._start: NDArray | None = None

    def moved_on(self, x: NDArray) -> NDArray:
        """Where the next round starts, of the same shape as x.

        Args:
            x: result of the last round, or the start of the first one; it is copied.
        """
        start = x.copy()
        if self._last is not None and self._start is not None:
            change = x - self._last
            if np.vdot(self._start - x, change) > 0:
                self._round = 1.0
            following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * self._round**2))
            start += x.dtype.type((self._round - 1.0) / following) * change
            self._round = following
        self._last, self._start = x.copy(), start
        return start
