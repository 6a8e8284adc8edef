"""The weight Λ of sparsity by distance (Tan et al. 2018, equation 5)."""

from __future__ import annotations

import numpy as np

from deformer.geometry import FloatArray


def locality_row(distance: FloatArray, d_min: float, d_max: float) -> FloatArray:
    """Λ: 0 below d_min, 1 above d_max, linear between (Tan et al. 2018, equation 5).

    Args:
        distance: (...,) geodesic distances from a component's centre, in units of the largest.
        d_min, d_max: in the same unit.
    """
    return np.clip((distance - d_min) / (d_max - d_min), 0.0, 1.0)
