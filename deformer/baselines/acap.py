"""Sparse localised components of as-consistent-as-possible features."""

from __future__ import annotations

from typing import ClassVar

from deformer.acap import extract_all
from deformer.baselines._gradient_method import GradientSplocsMethod
from deformer.baselines.method import Space
from deformer.geometry import FloatArray


class AcapSplocs(GradientSplocsMethod):
    """Sparse localised components of the features that the autoencoder learns from.

    After Gao et al., "Sparse Data Driven Mesh Deformation" (arXiv 1709.01250). Features are
    stretches and rotation vectors that are consistent over the mesh, so that turns beyond π stay
    continuous. `DataDrivenDeformation` fits handles; its docstring lists the departures from that
    paper. The decomposition and its constants are those of `LocalisedSettings`.
    """

    name: ClassVar[str] = "SPLOCS ACAP"
    space: ClassVar[Space] = "acap"

    def extract(self, vertices: FloatArray) -> FloatArray:
        """Features (N, V, 9) of shapes (N, V, 3), with consistent rotation vectors."""
        return extract_all(self._learned_extractor(), vertices)
