"""Turbulent wind: a mean flow that carries a random, divergence-free field along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Wind:
    """u(x, t) = U + Σ_m a_m cos(k_m · (x − U t) + φ_m + ω_m t) with a_m ⟂ k_m, hence div u = 0.

    Args:
        mean: (3,) U in metres a second.
        waves: (M, 3) wave vectors k in radians a metre.
        amplitudes: (M, 3) a in metres a second.
        phases: (M,) φ.
        rates: (M,) ω in radians a second: how fast an eddy changes while it is carried along.
    """

    mean: NDArray
    waves: NDArray
    amplitudes: NDArray
    phases: NDArray
    rates: NDArray

    def velocity(self, points: NDArray, time: float) -> NDArray:
        """Velocity (V, 3) at points (V, 3) in metres, at a time in seconds."""
        angle = (points - time * self.mean) @ self.waves.T + self.phases + time * self.rates
        return self.mean + np.cos(angle) @ self.amplitudes


def still_air() -> Wind:
    """No wind at all."""
    none = np.zeros((0, 3))
    return Wind(np.zeros(3), none, none, np.zeros(0), np.zeros(0))


def turbulent_wind(
    rng: np.random.Generator,
    speed: float = 8.0,
    intensity: float = 0.3,
    longest: float = 30.0,
    shortest: float = 3.0,
    modes: int = 40,
) -> Wind:
    """A wind along +x with eddies of all sizes between two wavelengths.

    Wavelengths are spaced evenly in logarithm; the velocity of an eddy grows with the cube root of
    its size, as in the inertial range of turbulence (Kolmogorov), and it turns over in the time
    that this takes.

    Args:
        rng: draws directions and phases.
        speed: of the mean flow, metres a second.
        intensity: root mean square of one component of the fluctuation over `speed`.
        longest, shortest: wavelengths in metres.
        modes: M.
    """
    wavelength = np.geomspace(longest, shortest, modes)
    direction = rng.normal(size=(modes, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    across = np.cross(direction, rng.normal(size=(modes, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    size = np.cbrt(wavelength)
    # A cosine of amplitude a has the mean square a²/2, shared by three components.
    size *= intensity * speed * np.sqrt(6.0 / (size**2).sum())
    wavenumber = 2.0 * np.pi / wavelength
    return Wind(
        np.array([speed, 0.0, 0.0]),
        wavenumber[:, None] * direction,
        size[:, None] * across,
        rng.uniform(0.0, 2.0 * np.pi, modes),
        rng.choice([-1.0, 1.0], modes) * wavenumber * size,
    )
