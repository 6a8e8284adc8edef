"""Noise that is independent for each vertex and frame, and largest at the free corners."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CORNER_GAIN = 4.0
CORNER_REACH = 0.15


def noise_profile(rest: NDArray) -> NDArray:
    """Standard deviation (V,) of the noise, divided by that in the middle of the flag.

    It grows to `CORNER_GAIN` at the two corners away from the pole, as exp(−d²/2r²) with the
    distance d and r = `CORNER_REACH` times the width.
    """
    low, high = rest.min(axis=0), rest.max(axis=0)
    corners = np.array([[high[0], 0.0, low[2]], [high[0], 0.0, high[2]]])
    d = np.linalg.norm(rest[:, None] - corners, axis=2).min(axis=1)
    reach = CORNER_REACH * (high[0] - low[0])
    return 1.0 + (CORNER_GAIN - 1.0) * np.exp(-0.5 * (d / reach) ** 2)


def add_noise(vertices: NDArray, deviation: float, rng: np.random.Generator) -> NDArray:
    """Shapes (N, V, 3) with independent normal noise on all but shape 0, the reference.

    Args:
        vertices: (N, V, 3) shapes; shape 0 is the flat flag at rest.
        deviation: standard deviation of a coordinate in the middle of the flag, in metres.
        rng: random generator.
    """
    noise = rng.normal(scale=deviation, size=vertices.shape)
    noise *= noise_profile(vertices[0])[:, None]
    noise[0] = 0.0
    return vertices + noise
