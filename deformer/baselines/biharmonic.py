"""Biharmonic (Laplacian) editing with exact handles."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from scipy import sparse

from deformer.baselines._examples import Bending
from deformer.geometry import FloatArray, IntArray, Mesh, cotan_weights
from deformer.linalg import SparseCholesky

# Lower bound of a vertex area, relative to the mean.
_SMALLEST_AREA = 1e-3


class Biharmonic(Bending):
    """Adds the smoothest displacement to the rigidly moved reference.

    The displacement d minimises Σ_i ‖(L d)_i‖² / A_i, the thin-plate energy ∫ ‖Δd‖², subject to
    control points at their targets (Botsch and Sorkine, "On Linear Variational Surface Deformation
    Methods", TVCG 2008). L is the cotangent Laplacian and A the vertex areas of the rest shape.
    """

    name: ClassVar[str] = "biharmonic"

    def _prepare(self, rest: FloatArray, vertices: IntArray) -> tuple[Any, ...]:
        mesh = Mesh(rest, self._shapes.faces)
        weights = cotan_weights(mesh)
        L = sparse.diags_array(np.asarray(weights.sum(axis=1)).ravel()) - weights
        area = _vertex_areas(mesh)
        inverse = sparse.diags_array(1.0 / np.maximum(area, _SMALLEST_AREA * area.mean()))
        Q = sparse.csr_array(L @ inverse @ L)
        free = np.setdiff1d(np.arange(len(rest)), vertices)
        return free, Q[free][:, vertices], SparseCholesky(Q[free][:, free], rest[free])

    def _bend(
        self, prepared: Any, start: FloatArray, vertices: IntArray, targets: FloatArray
    ) -> FloatArray:
        free, coupling, factor = prepared
        pose = start.copy()
        pose[free] -= factor.solve(np.asarray(coupling @ (targets - start[vertices])))
        return pose


class NearestBiharmonic(Biharmonic):
    """Deforms the training shape whose control points are nearest to the targets."""

    name: ClassVar[str] = "biharmonic-nearest"
    nearest: ClassVar[bool] = True


def _vertex_areas(mesh: Mesh) -> FloatArray:
    """A third of the area (V,) of the triangles about each vertex."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
    total = np.zeros(len(mesh.vertices))
    np.add.at(total, mesh.faces, area[:, None])
    return total
