"""From features back to vertices: a Poisson system factored once and solved many times."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from deformer.acap.displacements import link_lever
from deformer.acap.gradients import features_to_gradients
from deformer.checks import checked_array, checked_instance
from deformer.errors import InputError
from deformer.geometry import (
    FloatArray,
    Mesh,
    MeshSequence,
    cotan_weights,
    graph_laplacian,
    rhs_,
    rhs_adjoint_,
)
from deformer.linalg import SparseCholesky, over_ranges

# Tension α of the thin plate, times the reference's area: bends decay within a tenth of its size.
_TENSION = 100.0
# Foundation β of `foundation_rows`, times the reference's area.
_FOUNDATION = 30.0
# Shapes reconstructed at once: bounds memory.
_BATCH = 40


class PoissonSystem:
    """Vertices from deformation gradients: p = argmin Σ c_ij ‖(p_i − p_j) − T_i (v_i − v_j)‖².

    Gao et al. 2019, reconstruction.

    The normal equations are L p = b(T), b_i = Σ_j ½ c_ij (T_i + T_j)(v_i − v_j). The Laplacian L
    depends on the reference alone and is factored once, here.

    The equations leave the translation free: one vertex, the `anchor`, is fixed for the solve, and
    solutions are moved so that their centroid is the reference's. The B links of a mesh of several
    connected components (`Mesh.links`) are edges of weight 1. They form a tree: none changes the
    shape of a component, and each makes a component move with its neighbour, as an eye with its
    head. Gradients of the links, if they are given after those of the V vertices, say where the
    components are besides (`acap.displacements`).

    Args:
        reference: the undeformed mesh.
    """

    def __init__(self, reference: Mesh) -> None:
        """Assemble the Laplacian of the reference and factor it."""
        checked_instance(reference, "reference", Mesh, remedy="make one of vertices and faces")
        v = reference.vertices
        V = len(v)
        self.reference = reference
        weights = cotan_weights(reference)
        self.lever = link_lever(reference)
        if len(reference.links):
            i, j = reference.links.T
            extra = sparse.csr_array((np.ones(len(i)), (i, j)), shape=(V, V))
            weights = sparse.csr_array(weights + extra + extra.T)
            weights.sort_indices()
        self.weights = weights
        self.indptr = weights.indptr.astype(np.int64)
        self.rings = weights.indices.astype(np.int64)
        self.c = weights.data
        self.laplacian = graph_laplacian(weights)
        # A stiffness at the anchor keeps all V rows. Since every b sums to zero, the solution does
        # not depend on its value; a value of L's scale keeps the matrix well conditioned.
        self.anchor = 0
        stiffness = self.laplacian.diagonal().mean()
        ground = sparse.coo_array(([stiffness], ([self.anchor], [self.anchor])), shape=(V, V))
        self.factor = SparseCholesky(self.laplacian + ground, v)
        self.centroid = v.mean(axis=0)
        # Solution of the grounded system for 1/V everywhere, a part of every Green's function.
        self._constant_solution = self.back_substitute(np.full((V, 1), 1.0 / V))[:, 0]

    def __reduce__(self) -> tuple[type[PoissonSystem], tuple[Mesh]]:
        """Pickle the reference: another process factors the system itself."""
        return PoissonSystem, (self.reference,)

    def back_substitute(self, b: ArrayLike) -> FloatArray:
        """Solutions (V, m) of the grounded system for right-hand sides b (V, m), not centred."""
        return self.factor.solve(np.asarray(b, dtype=np.float64))

    def rhs(self, T: ArrayLike) -> FloatArray:
        """Right-hand side b_i = Σ_j ½ c_ij (T_i + T_j)(v_i − v_j), with the links' displacements.

        Args:
            T: (V, 3, 3) deformation gradients against the reference, or (V+B, 3, 3) with those of
                the links.

        Returns:
            (V, 3) float64, in the reference's units (cotangent weights have none).
        """
        gradients = np.ascontiguousarray(T, dtype=np.float64)
        V = len(self.reference.vertices)
        b = np.empty((V, 3))
        mesh = self.indptr, self.rings, self.c, self.reference.vertices
        over_ranges(rhs_, V, *mesh, gradients, b)
        if len(gradients) > V:
            i, j = self.reference.links.T
            displacement = (gradients[V:] - gradients[j]) @ self.lever
            np.add.at(b, i, displacement)
            np.subtract.at(b, j, displacement)
        return b

    def solve(self, T: ArrayLike) -> FloatArray:
        """Vertices (V, 3) of deformation gradients T, as in `rhs`, centroid at the reference's."""
        return self.solve_rhs(self.rhs(T))

    def solve_rhs(self, b: FloatArray) -> FloatArray:
        """Vertices (V, 3) of a right-hand side b (V, 3), centroid at the reference's."""
        p = self.back_substitute(b)
        return p + (self.centroid - p.mean(axis=0))

    def reconstruct(self, q: ArrayLike) -> FloatArray:
        """Vertices (..., V, 3) of features, centroids at the reference's.

        Args:
            q: (..., V, 9) features of the vertices, or (..., V+B, 9) with those of the links.

        Raises:
            InputError: another shape of the array.
        """
        features = checked_array(q, "features")
        V = len(self.reference.vertices)
        sites = V + len(self.reference.links)
        if features.shape[-2:] not in ((V, 9), (sites, 9)):
            raise InputError(f"features: expected (..., {V}, 9), got {features.shape}")
        flat = features.reshape(-1, *features.shape[-2:])
        p = np.empty((len(flat), V, 3))
        for start in range(0, len(flat), _BATCH):
            chunk = flat[start : start + _BATCH]
            b = np.concatenate([self.rhs(features_to_gradients(f)) for f in chunk], axis=1)
            x = self.back_substitute(b).reshape(V, len(chunk), 3).transpose(1, 0, 2)
            p[start : start + _BATCH] = x + (self.centroid - x.mean(axis=1))[:, None]
        return p.reshape(*features.shape[:-2], V, 3)

    def green_rows(self, vertices: ArrayLike, weights: ArrayLike | None = None) -> FloatArray:
        """Green's functions (H, V) of points: p_h = centroid + G_h · b(T).

        p is the solution with the centroid at the reference's; G_h solves L G = e_h − 1/V.

        Args:
            vertices: (H,) the points; or (H, m) vertices whose weighted means they are.
            weights: (H, m) with sums of 1.
        """
        b = self._loads(vertices, weights)
        G = self.back_substitute(b).T - self._constant_solution
        G -= G.mean(axis=1, keepdims=True)
        return np.ascontiguousarray(G)

    def _loads(self, vertices: ArrayLike, weights: ArrayLike | None) -> FloatArray:
        """Unit loads e_h (V, H) at points, as in `green_rows`."""
        index = np.asarray(vertices, dtype=np.int64)
        rows = index.reshape(len(index), -1 if index.size else 1)
        loads = np.zeros((len(self.reference.vertices), len(rows)))
        share = 1.0 if weights is None else np.asarray(weights, dtype=np.float64)
        np.add.at(loads, (rows, np.arange(len(rows))[:, None]), share)
        return loads

    def placed(self, p: FloatArray, like: FloatArray) -> FloatArray:
        """Shapes p (N, V, 3) with every connected component's centroid moved to that in `like`."""
        labels = self.reference.labels
        counts = np.bincount(labels)
        membership = sparse.csr_array((1.0 / counts[labels], (labels, np.arange(len(labels)))))
        return np.stack([a + (membership @ (b - a))[labels] for a, b in zip(p, like, strict=True)])

    @cached_property
    def screened_factor(self) -> SparseCholesky:
        """Factor of L + α A, where A is the diagonal matrix of the vertices' areas."""
        return self._screened(_TENSION)

    @cached_property
    def _foundation_factor(self) -> SparseCholesky:
        return self._screened(_FOUNDATION)

    def _screened(self, screen: float) -> SparseCholesky:
        """Factor of L + `screen` A, with areas A whose sum is 1."""
        v, faces = self.reference.vertices, self.reference.faces
        a, b, c = (v[faces[:, k]] for k in range(3))
        thirds = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
        areas = np.bincount(faces.ravel(), np.repeat(thirds, 3), len(v))
        total = float(areas.sum())
        # A vertex of slivers alone needs a positive weight, too.
        areas = np.maximum(areas, 1e-6 * (total or 1.0) / len(v))
        shares = sparse.diags_array(screen * areas / (total or 1.0))
        return SparseCholesky(self.laplacian + shares, v, self.factor.plan)

    def bending_rows(
        self, vertices: ArrayLike, green: FloatArray, weights: ArrayLike | None = None
    ) -> FloatArray:
        """Green's functions (H, V) of a thin plate under tension, K = L A⁻¹ L / α + L.

        K⁻¹ = L⁻¹ − (L + α A)⁻¹: each term has a spike at its vertex, the difference is smooth.

        Args:
            vertices: as in `green_rows`.
            weights: as in `green_rows`.
            green: (H, V) the points' `green_rows`.
        """
        loads = self._loads(vertices, weights)
        return np.ascontiguousarray(green - self.screened_factor.solve(loads).T)

    def foundation_rows(self, vertices: ArrayLike, weights: ArrayLike | None = None) -> FloatArray:
        """Green's functions (H, V) of a thin plate under tension on an elastic foundation.

        K⁻¹ = (L A⁻¹ L + (α + β) L + α β A) / (α − β), and K = (L + β A)⁻¹ − (L + α A)⁻¹: positive
        definite, as the covariance of a smooth field is.

        Args:
            vertices: as in `green_rows`.
            weights: as in `green_rows`.
        """
        loads = self._loads(vertices, weights)
        near, far = self._foundation_factor.solve(loads), self.screened_factor.solve(loads)
        return np.ascontiguousarray((near - far).T)

    def position_coefficients(self, green: FloatArray) -> FloatArray:
        """Coefficients a (H, V+B, 3) with G_h · b(T) = Σ_i T_i a_h,i, of `green` (H, V)."""
        V, links = len(self.reference.vertices), self.reference.links
        out = np.empty((len(green), V + len(links), 3))
        mesh = self.indptr, self.rings, self.c, self.reference.vertices
        for row, coefficients in zip(green, out, strict=True):
            over_ranges(rhs_adjoint_, V, *mesh, row, coefficients)
        i, j = links.T
        out[:, V:] = (green[:, i] - green[:, j])[:, :, None] * self.lever
        for a in out:
            np.subtract.at(a, j, a[V:])
        return out


def reconstruct(shapes: MeshSequence, q: ArrayLike, reference: int = 0) -> FloatArray:
    """Vertices (N, V, 3) of features against one of the shapes.

    Features contain no translation. If q has as many entries as there are shapes, every connected
    component is moved so that its centroid is that of the input shape; otherwise the centroid of
    the whole shape is the reference's.

    Args:
        shapes: shapes of V vertices.
        q: (N, V, 9) features.
        reference: index of the undeformed shape, against which the features were extracted.

    Raises:
        InputError: another shape of the array, or no shape `reference`.
    """
    remedy = "load shapes with load_shapes"
    checked_instance(shapes, "shapes", MeshSequence, remedy=remedy)
    system = PoissonSystem(shapes.mesh(reference))
    p = system.reconstruct(q)
    return system.placed(p, shapes.vertices) if p.shape == shapes.vertices.shape else p
