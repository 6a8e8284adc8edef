"""Principal components of the vertex positions."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from deformer.baselines._linear import LinearMethod
from deformer.baselines._linear_basis import LinearBasis
from deformer.geometry import FloatArray, Mesh


class PCA(LinearMethod):
    """Principal components: Alexa and Müller, "Representing Animations by Principal Components".

    Eurographics 2000. Shapes are the mean of the training shapes plus orthonormal components, the
    largest variance first; `encode` projects on them. The paper first removes each frame's affine
    motion and stores it beside the codes; this is left out here, because a code should determine
    the position of the shape. N shapes have N − 1 components: further ones are 0.
    """

    name: ClassVar[str] = "PCA"

    def fit_basis(
        self, vertices: FloatArray, reference: Mesh, components: int, seed: int
    ) -> LinearBasis:
        """Basis of shapes (N, V, 3); `reference` and `seed` are ignored."""
        mean = vertices.mean(0)
        right = principal_components((vertices - mean).reshape(len(vertices), -1), components)[1]
        return LinearBasis(mean, right.reshape(-1, *mean.shape), np.empty((0, components)))


def principal_components(centred: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Singular values (K,) and orthonormal components (K, D) of centred rows (N, D).

    Both are 0 beyond the rank of the data: values below 1e-10 of the largest count as rounding.
    """
    _, found, right = np.linalg.svd(centred, full_matrices=False)
    kept = min(count, int((found > 1e-10 * found[0]).sum()))
    values, components = np.zeros(count), np.zeros((count, centred.shape[1]))
    values[:kept], components[:kept] = found[:kept], right[:kept]
    return values, components
