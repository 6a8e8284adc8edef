"""The brush that paints a region of vertices."""

from __future__ import annotations

import numpy as np

from deformer import DeformationModel

_SMALLEST, _LARGEST = 0.005, 0.5


class RegionBrush:
    """A disc along the surface, and the vertices that it has painted.

    Attributes:
        radius: geodesic, in bounding diagonals of the reference.
    """

    def __init__(self) -> None:
        """Start with nothing painted."""
        self.radius = 0.08
        self._region: set[int] = set()

    @property
    def region(self) -> list[int]:
        """The painted vertices, in order."""
        return sorted(self._region)

    def resize(self, factor: float) -> None:
        """Make the brush larger or smaller within its limits."""
        self.radius = min(max(factor * self.radius, _SMALLEST), _LARGEST)

    def paint(self, model: DeformationModel, vertex: int) -> None:
        """Paint the disc around a vertex of a model's reference."""
        distance = model.distances(vertex)
        inside = distance <= self.radius * model.reference.bounding_diagonal
        self._region.update(np.flatnonzero(inside).tolist())

    def clear(self) -> None:
        """Paint nothing."""
        self._region.clear()
