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

    After Huang et al., "Sparse Localized Decomposition of Deformation Gradients" (2014): gradients
    are split by polar decomposition, T = R S, and components are linear in the rotation's
    logarithm and the stretch; vertices come from the gradients by least squares. The logarithm is
    the principal one, at most π long, taken vertex by vertex: where a rotation passes π it jumps
    to the other side, and nothing makes neighbours or shapes agree. That is the method's limit,
    and left as it is.

    Gradients are those of vertices as in `FeatureExtractor`, which hold a shape exactly; rotation
    and stretch share one weight a component, so that K counts the same as for other methods. The
    paper leaves open how a few points pose a mesh: that is `DataDrivenDeformation`.
    """

    name: ClassVar[str] = "SPLOCS gradients"
    space: ClassVar[Space] = "gradients"

    def _extract(self, vertices: FloatArray) -> FloatArray:
        extractor = self._extractor_in_use()
        q = np.empty((*vertices.shape[:2], 9))
        for n, shape in enumerate(vertices):
            R, S = polar(extractor.gradients(shape))
            q[n, :, :3] = rotation_to_log(R)
            q[n, :, 3:] = S[:, STRETCH_ROWS, STRETCH_COLUMNS]
        return q
