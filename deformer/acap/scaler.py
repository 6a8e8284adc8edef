"""The linear scaling of features that the network is trained on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.checks import LARGEST, checked_number
from deformer.errors import InputError
from deformer.geometry import FloatArray


@dataclass(frozen=True)
class FeatureScaler:
    """Linear map of features to [−0.95, 0.95], one range for r and one for s.

    Tan et al. 2018, feature scaling.

    Args:
        r_min: least entry of the rotation vectors, radians.
        r_max: greatest entry of the rotation vectors, radians.
        s_min: least entry of the stretches.
        s_max: greatest entry of the stretches.

    Raises:
        InputError: a bound that is not finite, or an empty range.
    """

    r_min: float
    r_max: float
    s_min: float
    s_max: float

    LIMIT = 0.95

    def __post_init__(self) -> None:
        """Check both ranges."""
        for kind, low, high in (("r", self.r_min, self.r_max), ("s", self.s_min, self.s_max)):
            for name, bound in ((f"{kind}_min", low), (f"{kind}_max", high)):
                checked_number(bound, f"scaler: {name}", largest=LARGEST)
            if not low < high:
                raise InputError(
                    f"scaler: expected {kind}_min < {kind}_max, got {low:g} and {high:g}; retrain"
                )

    @classmethod
    def fit(cls, q: FloatArray) -> FeatureScaler:
        """Scaler for the range of features q (..., 9); if all are equal, they are scaled to 0."""
        r_min, r_max = float(q[..., :3].min()), float(q[..., :3].max())
        s_min, s_max = float(q[..., 3:].min()), float(q[..., 3:].max())
        if r_max - r_min < 1e-9:
            r_min, r_max = r_min - 1.0, r_max + 1.0
        if s_max - s_min < 1e-9:
            s_min, s_max = s_min - 1.0, s_max + 1.0
        return cls(r_min, r_max, s_min, s_max)

    @property
    def gain(self) -> FloatArray:
        """Derivative (9,) of features with respect to scaled features."""
        r = (self.r_max - self.r_min) / (2 * self.LIMIT)
        s = (self.s_max - self.s_min) / (2 * self.LIMIT)
        return np.array([r] * 3 + [s] * 6)

    @property
    def offset(self) -> FloatArray:
        """Features (9,) that are scaled to zero."""
        r = 0.5 * (self.r_max + self.r_min)
        s = 0.5 * (self.s_max + self.s_min)
        return np.array([r] * 3 + [s] * 6)

    def scale(self, q: FloatArray) -> FloatArray:
        """Scaled features of q (..., 9), in [−0.95, 0.95] for values in the fitted range."""
        return (q - self.offset) / self.gain

    def unscale(self, x: FloatArray) -> FloatArray:
        """Features of scaled features x (..., 9), the inverse of `scale`."""
        return x * self.gain + self.offset
