"""Sparse localised components of deformation gradients."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from deformer.acap import STRETCH_COLUMNS, STRETCH_ROWS
from deformer.baselines._gradient_method import GradientSplocsMethod
from deformer.baselines.method import Space
from deformer.geometry import FloatArray, polar, rotation_to_log


class GradientSplocs(GradientSplocsMethod):
    """Sparse localised components of rotations and stretches of deformation gradients.

    After Huang et al., "Sparse Localized Decomposition of Deformation Gradients" (2014): polar
    decomposition splits gradients, T = R S; components are linear in the logarithm of R and in S;
    least squares computes vertices from gradients. The logarithm is the principal one of each
    vertex, at most π long. It jumps where a rotation passes π, and neighbours or shapes may
    disagree: this is a limit of the method.

    Gradients are those of `FeatureExtractor`, which describe a shape exactly. Rotation and stretch
    share one weight a component, so that K means the same as for other methods. The paper has no
    handle fit: `DataDrivenDeformation` is used.
    """

    name: ClassVar[str] = "SPLOCS gradients"
    space: ClassVar[Space] = "gradients"

    def extract(self, vertices: FloatArray) -> FloatArray:
        """Features (N, V, 9) of shapes (N, V, 3), with principal rotation vectors."""
        extractor = self._learned_extractor()
        q = np.empty((*vertices.shape[:2], 9))
        for n, shape in enumerate(vertices):
            R, S = polar(extractor.gradients(shape))
            q[n, :, :3] = rotation_to_log(R)
            q[n, :, 3:] = S[:, STRETCH_ROWS, STRETCH_COLUMNS]
        return q
