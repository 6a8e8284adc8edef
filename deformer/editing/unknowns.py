"""The unknowns x = (y, ω, t) of a handle fit, as one vector and as its parts."""

from __future__ import annotations

import numpy as np

from deformer.geometry import FloatArray

# Number of unknowns of a rigid motion: a rotation vector and a translation.
MOTION = 6


class Unknowns:
    """Views of the parts of x (..., K+6); writing to a part writes to x.

    Args:
        x: (..., K+6) unknowns, or derivatives with respect to them.
    """

    __slots__ = ("x",)

    def __init__(self, x: FloatArray) -> None:
        """Store x itself, not a copy."""
        self.x = x

    @classmethod
    def join(cls, code: FloatArray, rotation: FloatArray, translation: FloatArray) -> FloatArray:
        """The vector x (..., K+6) of code (..., K), rotation (..., 3) and translation (..., 3)."""
        x = np.concatenate([code, rotation, translation], axis=-1)
        return np.asarray(x, dtype=np.float64)

    @property
    def code(self) -> FloatArray:
        """Whitened latent code y (..., K): z = μ + L y, with Σ = L Lᵀ."""
        return self.x[..., :-MOTION]

    @code.setter
    def code(self, value: FloatArray) -> None:
        self.x[..., :-MOTION] = value

    @property
    def rotation(self) -> FloatArray:
        """Rotation vector ω (..., 3) about the reference's centroid, in radians."""
        return self.x[..., -6:-3]

    @rotation.setter
    def rotation(self, value: FloatArray) -> None:
        self.x[..., -6:-3] = value

    @property
    def translation(self) -> FloatArray:
        """Translation t (..., 3), in bounding diagonals of the reference."""
        return self.x[..., -3:]

    @translation.setter
    def translation(self, value: FloatArray) -> None:
        self.x[..., -3:] = value

    @property
    def motion(self) -> FloatArray:
        """Rotation and translation (..., 6)."""
        return self.x[..., -MOTION:]
