"""Sparse localised deformation components of the vertex positions."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from deformer.baselines._linear import LinearMethod
from deformer.baselines._linear_basis import LinearBasis
from deformer.geometry import FloatArray, Geodesics, Mesh
from deformer.training import LocalisedSettings, localised_components


class SPLOCS(LinearMethod):
    """Neumann et al., "Sparse Localized Deformation Components", SIGGRAPH Asia 2013.

    Components of displacements from the mean of the training shapes, with geodesic distances on the
    reference in units of the largest one. Least squares encodes unseen shapes, as in the paper.
    Left out: rigid alignment of the input, because a code should determine the position of the
    shape, and the user's editing constraints.

    Args:
        settings: settings of the optimisation; None is their default. λ = 2 is that of the authors'
            program; d_min = 0.2 and d_max = 0.4 are those of Tan et al. (AAAI 2018) for such
            distances; weights are in [−1, 1], one of the paper's two ranges.
    """

    name: ClassVar[str] = "SPLOCS"

    def __init__(self, settings: LocalisedSettings | None = None) -> None:
        """Store the settings."""
        self._settings = settings or LocalisedSettings()

    def fit_basis(
        self, vertices: FloatArray, reference: Mesh, components: int, seed: int
    ) -> LinearBasis:
        """Basis of shapes (N, V, 3); `seed` is ignored."""
        mean = vertices.mean(0)
        distances = Geodesics(reference).normalised_row
        found = localised_components(vertices - mean, distances, components, self._settings)
        return LinearBasis(mean, found.components, np.empty((0, components)))
