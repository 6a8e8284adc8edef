"""Deformation gradients T = R S of features, and the layout of a feature's numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import checked_array
from deformer.compilation import njit
from deformer.errors import InputError
from deformer.geometry import FloatArray, exp_
from deformer.linalg import over_ranges

# Upper triangle of a symmetric 3×3 matrix in the order of the features: xx xy xz yy yz zz.
STRETCH_ROWS = np.array([0, 0, 0, 1, 1, 2])
STRETCH_COLUMNS = np.array([0, 1, 2, 1, 2, 2])


@njit(nogil=True, error_model="numpy")
def gradient_(q, R, T):
    """T (3, 3) = exp(r) S and R (3, 3) = exp(r) of a feature q (9,) = (r, S).

    The one double-precision version of T = R S (Tan et al. 2018, section 3).
    """
    exp_(q, R)
    for a in range(3):
        x, y, z = R[a, 0], R[a, 1], R[a, 2]
        T[a, 0] = x * q[3] + y * q[4] + z * q[5]
        T[a, 1] = x * q[4] + y * q[6] + z * q[7]
        T[a, 2] = x * q[5] + y * q[7] + z * q[8]


@njit(nogil=True, error_model="numpy")
def _to_gradients(start, stop, q, T):
    R = np.empty((3, 3))
    for i in range(start, stop):
        gradient_(q[i], R, T[i])


def features_to_gradients(q: ArrayLike) -> FloatArray:
    """Deformation gradients T = exp(r) S, (..., 3, 3), of features q (..., 9).

    Raises:
        InputError: the last dimension is not 9.
    """
    features = np.ascontiguousarray(checked_array(q, "features", finite=False))
    if features.shape[-1] != 9:
        raise InputError(f"features: expected (..., 9), got {features.shape}")
    T = np.empty((*features.shape[:-1], 3, 3))
    flat = features.reshape(-1, 9)
    over_ranges(_to_gradients, len(flat), flat, T.reshape(-1, 3, 3))
    return T
