"""Tolerances by dtype: what rounding alone may cost, relative to the size of the numbers."""

import numpy as np
import torch

_ROUNDING = {np.dtype(np.float64): 1e-12, np.dtype(np.float32): 2e-5}


def tolerance(dtype, factor=1.0):
    """Keywords for numpy's and torch's assert_allclose/assert_close."""
    if isinstance(dtype, torch.dtype):
        dtype = torch.empty(0, dtype=dtype).numpy().dtype
    bound = factor * _ROUNDING[np.dtype(dtype)]
    return {"rtol": bound, "atol": bound}
