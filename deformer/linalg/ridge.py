"""Ridge regression with several ridges at once, and the leave-one-out residuals of each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def ridge_regressions(
    x: FloatArray,
    y: FloatArray,
    ridges: Iterable[float],
    *,
    centred: bool,
    least: float,
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Regressions of y on x, one a ridge: min ‖y − x B‖² + ridge σ² ‖B‖², σ the norm of x.

    Args:
        x: (n, K) regressors.
        y: (n, m) values.
        ridges: relative to the largest squared singular value of x; infinite gives B = 0.
        centred: true if the means of x and y were taken off: the mean is then left out, too.
        least: least value of 1 − (influence of a row on its own fit), by which residuals grow.

    Yields:
        B (K, m), and the residuals (n, m) of each row if it is left out.
    """
    U, s, Vt = np.linalg.svd(x, full_matrices=False)
    projected = U.T @ y
    for ridge in ridges:
        share = np.divide(s**2, s**2 + ridge * s[0] ** 2, out=np.zeros_like(s), where=s > 0)
        slope = np.divide(share, s, out=np.zeros_like(s), where=s > 0)
        residual = y - U @ (share[:, None] * projected)
        influence = (1.0 / len(x) if centred else 0.0) + (U**2) @ share
        yield (Vt.T * slope) @ projected, residual / np.maximum(1.0 - influence, least)[:, None]
