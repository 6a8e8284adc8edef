"""From features back to vertices: a Poisson system factored once and solved many times."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from deformer.acap.features import features_to_gradients
from deformer.checks import checked_array, checked_instance
from deformer.errors import InputError
from deformer.geometry import (
    FloatArray,
    IntArray,
    Mesh,
    MeshSequence,
    connected_components,
    cotan_weights,
    graph_laplacian,
    rhs_,
    rhs_adjoint_,
)
from deformer.linalg import SparseCholesky, over_ranges

# Tension α of the thin plate, times the reference's area: bends decay within a tenth of its size.
_TENSION = 100.0
# Shapes reconstructed at once: bounds memory.
_BATCH = 40


def _bridge_edges(v: FloatArray, count: int, labels: np.ndarray) -> np.ndarray:
    """One edge (i, j) from every smaller component to the nearest vertex of the largest."""
    main = int(np.bincount(labels, minlength=count).argmax())
    others = np.flatnonzero(labels != main)
    if len(others) == 0:
        return np.empty((0, 2), dtype=np.int64)
    base: IntArray = np.flatnonzero(labels == main)
    # Most meshes have one component and never need this import.
    from scipy.spatial import KDTree

    distance, nearest = KDTree(v[base]).query(v[others])
    order = np.lexsort((distance, labels[others]))
    start: IntArray = np.unique(labels[others][order], return_index=True)[1]
    first = order[start]
    return np.column_stack([others[first], base[np.asarray(nearest)[first]]])


class PoissonSystem:
    """Vertices from deformation gradients: p = argmin Σ c_ij ‖(p_i − p_j) − T_i (v_i − v_j)‖².

    Gao et al. 2019, reconstruction.

    The normal equations are L p = b(T), b_i = Σ_j ½ c_ij (T_i + T_j)(v_i − v_j). The Laplacian L
    depends on the reference alone and is factored once, here.

    The equations leave the translation free: one vertex, the `anchor`, is fixed for the solve, and
    solutions are moved so that their centroid is the reference's. A mesh of several connected
    components gets one extra edge from each smaller component to the nearest vertex of the largest
    one. The edge does not change the component's shape; it makes the component move with the
    largest one, as an eye with its head.

    Args:
        reference: the undeformed mesh.
    """

    def __init__(self, reference: Mesh) -> None:
        """Assemble the Laplacian of the reference and factor it."""
        v = reference.vertices
        V = len(v)
        self.reference = reference
        weights = cotan_weights(reference)
        self.component_count, self.labels = connected_components(reference.faces, V)
        bridges = _bridge_edges(v, self.component_count, self.labels)
        if len(bridges):
            i, j = bridges.T
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

    def back_substitute(self, b: ArrayLike) -> FloatArray:
        """Solutions (V, m) of the grounded system for right-hand sides b (V, m), not centred."""
        return self.factor.solve(np.asarray(b, dtype=np.float64))

    def rhs(self, T: ArrayLike) -> FloatArray:
        """Right-hand side b_i = Σ_j ½ c_ij (T_i + T_j)(v_i − v_j).

        Args:
            T: (V, 3, 3) deformation gradients against the reference.

        Returns:
            (V, 3) float64, in the reference's units (cotangent weights have none).
        """
        gradients = np.ascontiguousarray(T, dtype=np.float64)
        b = np.empty((len(gradients), 3))
        mesh = self.indptr, self.rings, self.c, self.reference.vertices
        over_ranges(rhs_, len(gradients), *mesh, gradients, b)
        return b

    def solve(self, T: ArrayLike) -> FloatArray:
        """Vertices (V, 3) of deformation gradients T (V, 3, 3), centroid at the reference's."""
        return self.solve_rhs(self.rhs(T))

    def solve_rhs(self, b: FloatArray) -> FloatArray:
        """Vertices (V, 3) of a right-hand side b (V, 3), centroid at the reference's."""
        p = self.back_substitute(b)
        return p + (self.centroid - p.mean(axis=0))

    def reconstruct(self, q: ArrayLike) -> FloatArray:
        """Vertices (..., V, 3) of features q (..., V, 9), centroids at the reference's.

        Raises:
            InputError: another shape of the array.
        """
        features = checked_array(q, "features")
        V = len(self.reference.vertices)
        if features.shape[-2:] != (V, 9):
            raise InputError(f"features: expected (..., {V}, 9), got {features.shape}")
        flat = features.reshape(-1, V, 9)
        p = np.empty((len(flat), V, 3))
        for start in range(0, len(flat), _BATCH):
            chunk = flat[start : start + _BATCH]
            b = np.concatenate([self.rhs(features_to_gradients(f)) for f in chunk], axis=1)
            x = self.back_substitute(b).reshape(V, len(chunk), 3).transpose(1, 0, 2)
            p[start : start + _BATCH] = x + (self.centroid - x.mean(axis=1))[:, None]
        return p.reshape(*features.shape[:-1], 3)

    def green_rows(self, vertices: ArrayLike) -> FloatArray:
        """Green's functions (H, V) of vertices (H,): p_h = centroid + G_h · b(T).

        p is the solution with the centroid at the reference's; G_h solves L G = e_h − 1/V.
        """
        index = np.asarray(vertices, dtype=np.int64)
        b = np.zeros((len(self.reference.vertices), len(index)))
        b[index, np.arange(len(index))] = 1.0
        G = self.back_substitute(b).T - self._constant_solution
        G -= G.mean(axis=1, keepdims=True)
        return np.ascontiguousarray(G)

    @cached_property
    def screened_factor(self) -> SparseCholesky:
        """Factor of L + α A, where A is the diagonal matrix of the vertices' areas."""
        v, faces = self.reference.vertices, self.reference.faces
        a, b, c = (v[faces[:, k]] for k in range(3))
        thirds = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
        areas = np.bincount(faces.ravel(), np.repeat(thirds, 3), len(v))
        total = float(areas.sum())
        # A vertex of slivers alone needs a positive weight, too.
        areas = np.maximum(areas, 1e-6 * (total or 1.0) / len(v))
        screen = sparse.diags_array(_TENSION * areas / (total or 1.0))
        return SparseCholesky(self.laplacian + screen, v, self.factor.plan)

    def bending_rows(self, vertices: ArrayLike, green: FloatArray) -> FloatArray:
        """Green's functions (H, V) of a thin plate under tension, K = L A⁻¹ L / α + L.

        K⁻¹ = L⁻¹ − (L + α A)⁻¹: each term has a spike at its vertex, the difference is smooth.

        Args:
            vertices: (H,) int64.
            green: (H, V) the vertices' `green_rows`.
        """
        index = np.asarray(vertices, dtype=np.int64)
        unit = np.zeros((len(self.reference.vertices), len(index)))
        unit[index, np.arange(len(index))] = 1.0
        return np.ascontiguousarray(green - self.screened_factor.solve(unit).T)

    def position_coefficients(self, green: FloatArray) -> FloatArray:
        """Coefficients a (H, V, 3) with G_h · b(T) = Σ_i T_i a_h,i, of `green` (H, V)."""
        out = np.empty((*green.shape, 3))
        mesh = self.indptr, self.rings, self.c, self.reference.vertices
        for row, coefficients in zip(green, out, strict=True):
            over_ranges(rhs_adjoint_, len(row), *mesh, row, coefficients)
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
    if p.shape != shapes.vertices.shape:
        return p
    counts = np.bincount(system.labels, minlength=system.component_count)
    membership = sparse.csr_array(
        (1.0 / counts[system.labels], (system.labels, np.arange(len(system.labels))))
    )
    offset = shapes.vertices - p
    for n in range(len(p)):
        p[n] += (membership @ offset[n])[system.labels]
    return p
