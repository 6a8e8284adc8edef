"""Handles of the model of a tube, their noise and what its codes miss at them."""

import numpy as np

HANDLES = np.arange(4, 120, 12)
NOISE, MISFIT = 0.01, 0.03  # in bounding diagonals
