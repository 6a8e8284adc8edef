"""How far vertices are apart."""

import numpy as np


def largest(difference):
    """The greatest length of vectors (..., 3)."""
    return np.linalg.norm(difference, axis=-1).max()
