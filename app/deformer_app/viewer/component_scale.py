"""The scale of a component: 0 is the reference's value, 1 its extreme among the examples."""

from __future__ import annotations

from dataclasses import dataclass

from deformer import Activations


@dataclass(frozen=True)
class ComponentScale:
    """Conversion between entries of latent codes and weights, as `deformer synthesize` takes them.

    Args:
        zero: activation of the reference, the weight 0.
        unit: activation of the weight 1, less that of 0; its sign may be negative.
        low, high: smallest and largest weight among the examples.
    """

    zero: float
    unit: float
    low: float
    high: float

    @classmethod
    def of(cls, activations: Activations, component: int) -> ComponentScale:
        """Return the scale of a component of a model."""
        zero = float(activations.reference[component])
        unit = float(activations.extreme[component]) - zero
        if unit == 0.0:  # the examples do not differ in it
            unit = 1.0
        ends = [float(a[component]) for a in (activations.low, activations.high)]
        low, high = sorted((end - zero) / unit for end in ends)
        return cls(zero, unit, min(low, 0.0), max(high, 0.0))

    @property
    def reach(self) -> float:
        """Weight at the ends of a slider that has 0 in its middle: that of the farther example."""
        return max(-self.low, self.high) or 1.0

    def weight(self, activation: float) -> float:
        """Return the weight of an entry of a code."""
        return (activation - self.zero) / self.unit

    def activation(self, weight: float) -> float:
        """Return the entry of a code that has a weight."""
        return self.zero + weight * self.unit
