"""Features at the angles where formulas of exp(r) change: near 0, π, 2π, and anywhere."""

import numpy as np
import pytest

# Name: angles in radians of the rotation vectors.
ANGLES = {
    "0": [0.0, 1e-12, 1e-7, 1e-4, 9.99e-4, 1.001e-3, 9.9e-3, 1.01e-2],
    "any": np.random.default_rng(5).uniform(0.1, 12.0, 40),
    "0.7": [0.699, 0.7, 0.701],
    "pi": np.pi + np.array([-1e-3, -1e-6, 0.0, 1e-6, 1e-3]),
    "2 pi": 2 * np.pi + np.array([-1e-2, -1e-4, 0.0, 1e-4, 1e-2]),
}
NEAR = pytest.mark.parametrize("near", ANGLES)


def features_near(near, seed=0):
    """Features (n, 9) whose rotation vectors have these angles, about random axes; any stretch."""
    rng = np.random.default_rng(seed)
    angles = np.repeat(ANGLES[near], 4)
    axes = rng.normal(size=(len(angles), 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    return np.hstack([angles[:, None] * axes, rng.normal(size=(len(angles), 6))])
