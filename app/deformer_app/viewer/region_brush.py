"""The brush that paints a region of vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deformer import DeformationModel

_SMALLEST, _LARGEST = 0.005, 0.5  # bounding diagonals
_EDGES = 3.2  # edges in the first radius: a disc of about 36 vertices
_FIRST = (0.015, 0.06)  # limits of the first radius, in bounding diagonals


class RegionBrush:
    """A disc along the surface, and the vertices that it has painted.

    Attributes:
        radius: geodesic, in bounding diagonals of the reference.
    """

    def __init__(self) -> None:
        """Start with nothing painted."""
        self.radius = _FIRST[1]
        self._region: set[int] = set()
        self._centre: tuple[DeformationModel, int] | None = None
        self._distances = np.zeros(0)

    @property
    def region(self) -> list[int]:
        """The painted vertices, in order."""
        return sorted(self._region)

    def fit(self, model: DeformationModel) -> None:
        """Choose a size for a model, for a few dozen vertices of a limb, and paint nothing."""
        mesh = model.reference
        corners = mesh.vertices[mesh.faces]
        edges = np.sqrt(((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2))
        edge = float(np.median(edges)) / mesh.bounding_diagonal
        low, high = _FIRST
        self.radius = max(min(max(_EDGES * edge, low), high), 1.5 * edge)
        self.clear()

    def resize(self, factor: float) -> None:
        """Make the brush larger or smaller within its limits."""
        self.radius = min(max(factor * self.radius, _SMALLEST), _LARGEST)

    def distances(self, model: DeformationModel, vertex: int) -> NDArray[np.float64]:
        """Return the distances (V,) from a vertex along the reference, in radii of the brush."""
        if self._centre is None or self._centre[0] is not model or self._centre[1] != vertex:
            self._centre, self._distances = (model, vertex), model.distances(vertex)
        return self._distances / (self.radius * model.reference.bounding_diagonal)

    def disc(self, model: DeformationModel, vertex: int) -> list[int]:
        """Return the vertices that would be painted around a vertex."""
        return np.flatnonzero(self.distances(model, vertex) <= 1.0).tolist()

    def outline(
        self, model: DeformationModel, vertex: int, shown: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        """Return the disc's border around a vertex: lines (2, 3) on the shown surface (V, 3)."""
        faces, values = model.reference.faces, self.distances(model, vertex)
        inside = values[faces] <= 1.0
        crossed = inside != np.roll(inside, -1, axis=1)  # edges from a corner to the next one
        face, corner = np.nonzero(crossed)  # two of a face, or none
        a, b = faces[face, corner], faces[face, (corner + 1) % 3]
        share = ((1.0 - values[a]) / (values[b] - values[a]))[:, None]
        return list(((1.0 - share) * shown[a] + share * shown[b]).reshape(-1, 2, 3))

    def paint(self, model: DeformationModel, vertex: int) -> None:
        """Paint the disc around a vertex of a model's reference."""
        self._region.update(self.disc(model, vertex))

    def clear(self) -> None:
        """Paint nothing."""
        self._region.clear()
