"""ACAP features: rotation and stretch of each vertex's neighbourhood against the reference.

The deformation gradient of a vertex is split into rotation and stretch, T = R S; the feature is
the rotation vector (continuous over the mesh, see `consistent_rotations`) and the upper triangle
of S, after Gao et al., "Sparse Data Driven Mesh Deformation" (arXiv 1709.01250).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from deformer.acap.consistent_rotations import continuous_logs, join_components
from deformer.acap.displacements import link_features
from deformer.acap.gradients import STRETCH_COLUMNS, STRETCH_ROWS, features_to_gradients
from deformer.checks import checked_array, checked_instance
from deformer.compilation import njit
from deformer.errors import InputError
from deformer.geometry import (
    FloatArray,
    IntArray,
    Mesh,
    MeshSequence,
    checked_faces,
    closest_rotation_,
    closest_rotations,
    cotan_weights,
    graph_laplacian,
    log_to_rotation,
    one_rings,
    rhs_matrix,
)
from deformer.linalg import SparseCholesky, in_parallel

Progress = Callable[[int, int], None]

# Weight of the equation T n = n' for the vertex normals, relative to the edges of a one-ring. Flat
# rings need it, and it keeps noise from the stretch of nearly flat ones along the normal.
_NORMAL_WEIGHT = 0.05
# Relative difference of b(T) and L p that counts as zero.
_TOLERANCE = 1e-10


@njit(nogil=True, error_model="numpy")
def _vertex_normals(p, faces, out):
    """Area-weighted unit normals; zero if the normals of a vertex's faces cancel."""
    for i in range(len(p)):
        for d in range(3):
            out[i, d] = 0.0
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ux, uy, uz = p[j, 0] - p[i, 0], p[j, 1] - p[i, 1], p[j, 2] - p[i, 2]
        wx, wy, wz = p[k, 0] - p[i, 0], p[k, 1] - p[i, 1], p[k, 2] - p[i, 2]
        for corner in range(3):
            v = faces[f, corner]
            out[v, 0] += uy * wz - uz * wy
            out[v, 1] += uz * wx - ux * wz
            out[v, 2] += ux * wy - uy * wx
    for i in range(len(p)):
        length = np.sqrt(out[i, 0] ** 2 + out[i, 1] ** 2 + out[i, 2] ** 2)
        if length > 0.0:
            for d in range(3):
                out[i, d] /= length


def vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Area-weighted unit normals (V, 3) of a mesh; zero for a vertex without faces with area.

    Args:
        vertices: (V, 3).
        faces: (F, 3) vertex indices.

    Raises:
        InputError: other shapes, or an index out of range.
    """
    p = np.ascontiguousarray(checked_array(vertices, "vertices", ("V", 3)))
    normals = np.empty_like(p)
    _vertex_normals(p, checked_faces(faces, len(p)), normals)
    return normals


@njit(nogil=True, error_model="numpy")
def _gradients(v, p, indptr, rings, c, normals, new_normals, inverse, ridge, weight, T):
    """T_i = argmin Σ_j c_ij ‖(p_i − p_j) − T (v_i − v_j)‖² (Tan et al. 2018, section 3).

    Normal equations T M = Σ c p_e v_eᵀ + weight n' nᵀ + ridge R, one 3×3 system a vertex.

    R is the rotation closest to the right-hand side without the ridge, so that a rigid motion of
    any ring, even one that is flat or collapsed to a line, gives exactly its rotation.
    """
    B = np.empty((3, 3))
    R = np.empty((3, 3))
    for i in range(len(v)):
        for a in range(3):
            for b in range(3):
                B[a, b] = 0.0
        for k in range(indptr[i], indptr[i + 1]):
            j = rings[k]
            for a in range(3):
                pa = c[k] * (p[i, a] - p[j, a])
                for b in range(3):
                    B[a, b] += pa * (v[i, b] - v[j, b])
        for a in range(3):
            for b in range(3):
                B[a, b] += weight[i] * new_normals[i, a] * normals[i, b]
        closest_rotation_(B, R)
        for a in range(3):
            for b in range(3):
                B[a, b] += ridge[i] * R[a, b]
        for a in range(3):
            for b in range(3):
                T[i, a, b] = (
                    B[a, 0] * inverse[i, 0, b]
                    + B[a, 1] * inverse[i, 1, b]
                    + B[a, 2] * inverse[i, 2, b]
                )


@njit(nogil=True, error_model="numpy")
def _stretches(T, R, s):
    """Upper triangle of the symmetric part of Rᵀ T."""
    for i in range(len(T)):
        n = 0
        for a in range(3):
            for b in range(a, 3):
                total = 0.0
                for d in range(3):
                    total += R[i, d, a] * T[i, d, b] + R[i, d, b] * T[i, d, a]
                s[i, n] = 0.5 * total
                n += 1


class FeatureExtractor:
    """Extracts features of shapes against one reference.

    Args:
        reference: the undeformed mesh. Its cotangent weights (clamped, see
            `geometry.cotan_weights`) and normals are prepared here.
    """

    def __init__(self, reference: Mesh) -> None:
        """Prepare one-rings, weights and the inverse normal matrices of the reference."""
        checked_instance(reference, "reference", Mesh, remedy="load one with load_mesh")
        v = reference.vertices
        V = len(v)
        self.reference = reference
        self.indptr, self.rings = one_rings(reference.faces, V)
        self.weights = cotan_weights(reference)
        self._normals = np.empty((V, 3))
        _vertex_normals(v, reference.faces, self._normals)
        rows = np.repeat(np.arange(V), np.diff(self.indptr))
        e = v[rows] - v[self.rings]
        M = np.zeros((V, 3, 3))
        np.add.at(M, rows, self.weights.data[:, None, None] * e[:, :, None] * e[:, None, :])
        trace = np.trace(M, axis1=1, axis2=2)
        # A vertex whose edges have no length gets the identity as T.
        scale = np.where(trace > 0, trace, 1.0)
        self._normal_weight = _NORMAL_WEIGHT * scale
        self._ridge = 1e-9 * scale
        M += self._normal_weight[:, None, None] * self._normals[:, :, None] * self._normals[:, None]
        # A larger ridge only where neither edges nor normal determine a direction.
        smallest = np.linalg.eigvalsh(M)[:, 0]
        self._ridge = np.where(smallest > 1e-6 * scale, self._ridge, 1e-3 * scale)
        M += self._ridge[:, None, None] * np.eye(3)
        self._inverse = np.linalg.inv(M)
        self._laplacian = graph_laplacian(self.weights)
        self._rhs_matrix = rhs_matrix(self.weights, v)
        gram = self._rhs_matrix @ self._rhs_matrix.T
        # Constants are in the null space (b sums to zero): a tiny ridge makes it definite.
        ridge = 1e-9 * gram.diagonal().mean() * sparse.eye_array(V)
        self._gram = SparseCholesky(gram + ridge, v)

    def __reduce__(self) -> tuple[type[FeatureExtractor], tuple[Mesh]]:
        """Pickle the reference: another process prepares the rest itself."""
        return FeatureExtractor, (self.reference,)

    def gradients(self, vertices: ArrayLike) -> FloatArray:
        """Deformation gradients T (V, 3, 3) from the reference to `vertices` (V, 3).

        T_i = argmin Σ_j c_ij ‖(p_i − p_j) − T (v_i − v_j)‖² over the one-ring (Tan et al. 2018,
        deformation gradient). A flat ring does not determine T along the normal; T then maps the
        reference's unit normal to the shape's. For a ring collapsed to a line or a point T is the
        closest rotation.

        Reconstruction depends on T only through b(T) (see `poisson`), and for the fitted T b(T)
        differs slightly from L p. The least-squares change of T that makes b(T) = L p is added, so
        that features represent the shape exactly.

        Raises:
            InputError: the shape of the array is not the reference's.
        """
        p = np.ascontiguousarray(checked_array(vertices, "vertices"))
        v = self.reference.vertices
        if p.shape != v.shape:
            raise InputError(
                f"vertices: expected {v.shape} as the reference has, got {p.shape}; "
                "all shapes must share one connectivity"
            )
        new_normals = np.empty_like(p)
        _vertex_normals(p, self.reference.faces, new_normals)
        T = np.empty((len(p), 3, 3))
        _gradients(
            v,
            p,
            self.indptr,
            self.rings,
            self.weights.data,
            self._normals,
            new_normals,
            self._inverse,
            self._ridge,
            self._normal_weight,
            T,
        )
        Lp = self._laplacian @ p
        # A second time only if the solve was not exact: the Gram matrix may be nearly singular.
        for _ in range(2):
            misfit = Lp - self._rhs_matrix @ _columns(T)
            if np.abs(misfit).max() <= _TOLERANCE * np.abs(Lp).max():
                break
            T += _from_columns(self._rhs_matrix.T @ self._gram.solve(misfit))
        return T

    def extract(self, vertices: ArrayLike) -> FloatArray:
        """Features (V, 9) of `vertices` (V, 3): rotation vector, then xx xy xz yy yz zz of S.

        A vertex without a face has no stretch, and the rotation of the vertex that it is linked to.

        Raises:
            InputError: the shape of the array is not the reference's.
        """
        T = self.gradients(vertices)
        # T = R S by polar decomposition (Tan et al. 2018, section 3).
        R = closest_rotations(T)
        q = np.empty((len(T), 9))
        # log R, one of its values a vertex (Gao et al. 2019, ACAP).
        r, bridged = continuous_logs(R, self.indptr, self.rings, self.reference.labels)
        q[:, :3] = r
        if bridged.any():
            R[bridged] = log_to_rotation(r[bridged])
        _stretches(T, R, q[:, 3:])
        if bridged.any():
            self._compensate(q, T, np.flatnonzero(bridged))
        join_components(q[:, :3], self.reference.links, self.reference.labels)
        return q

    def extract_sites(self, vertices: ArrayLike) -> FloatArray:
        """Features (V+B, 9) of the vertices of a shape (V, 3), then of the reference's B links.

        Raises:
            InputError: the shape of the array is not the reference's.
        """
        q = self.extract(vertices)
        p = np.asarray(vertices, dtype=np.float64)
        return np.concatenate([q, link_features(self.reference, p, q)])

    def _compensate(self, q: FloatArray, T: FloatArray, vertices: np.ndarray) -> None:
        """Change the stretch in q around `vertices`, by least squares, until b(T) is that of T."""
        # Two rings of neighbours change, too: the stretches of `vertices` alone are fewer than the
        # rows of b(T) that depend on them.
        changed = np.zeros(len(q), dtype=bool)
        changed[vertices] = True
        for _ in range(2):
            neighbours = np.repeat(changed, np.diff(self.indptr))
            changed |= np.bincount(self.rings, neighbours, len(q)) > 0
        vertices = np.flatnonzero(changed)
        R = log_to_rotation(q[vertices, :3])
        misfit = self._rhs_matrix @ _columns(T - features_to_gradients(q))
        basis = np.zeros((6, 3, 3))
        basis[np.arange(6), STRETCH_ROWS, STRETCH_COLUMNS] = 1.0
        basis[np.arange(6), STRETCH_COLUMNS, STRETCH_ROWS] = 1.0
        near = self._rhs_matrix[:, (3 * vertices[:, None] + np.arange(3)).ravel()]
        rows = np.flatnonzero(np.diff(near.indptr))
        near = near[rows]
        # Row a of ∂T/∂s at each vertex, as blocks (3, 6) on the diagonal.
        A = sparse.vstack(
            [
                near @ sparse.block_diag(list(np.einsum("nd,sdc->ncs", R[:, a], basis)))
                for a in range(3)
            ]
        ).tocsr()
        gram = A @ A.T
        ridge = 1e-10 * gram.diagonal().mean() * sparse.eye_array(gram.shape[0])
        points = np.tile(self.reference.vertices[rows], (3, 1))
        dual = SparseCholesky(gram + ridge, points).solve(misfit[rows].T.reshape(-1, 1))
        q[vertices, 3:] += (A.T @ dual).reshape(-1, 6)


def _columns(T: FloatArray) -> FloatArray:
    """T (V, 3, 3) as (3V, 3): row 3i + c is column c of T_i."""
    return T.transpose(0, 2, 1).reshape(-1, 3)


def _from_columns(columns: FloatArray) -> FloatArray:
    """Inverse of `_columns`."""
    return columns.reshape(-1, 3, 3).transpose(0, 2, 1)


def extract_features(
    shapes: MeshSequence, reference: int = 0, progress: Progress | None = None
) -> FloatArray:
    """Features (N, V, 9) of every shape against shape `reference` of the same sequence.

    Args:
        shapes: N shapes.
        reference: index of the undeformed shape.
        progress: called with (done, total) after each shape.

    Returns:
        q (N, V, 9), a rotation vector in radians (3), then stretch xx xy xz yy yz zz (6). Memory
        beside the result is that of a few shapes.

    Raises:
        InputError: no shape `reference`.
    """
    remedy = "load shapes with load_shapes"
    checked_instance(shapes, "shapes", MeshSequence, remedy=remedy)
    extractor = FeatureExtractor(shapes.mesh(reference))
    return extract_all(extractor, shapes.vertices, progress)


def extract_each(
    extractor: FeatureExtractor, vertices: FloatArray, *, links: bool = False
) -> Iterator[FloatArray]:
    """Features (V, 9) of one shape after the other, extracted in parallel on all cores.

    Args:
        extractor, vertices, links: as of `extract_all`.
    """
    extract = extractor.extract_sites if links else extractor.extract
    yield from in_parallel(extract, list(vertices))


def extract_all(
    extractor: FeatureExtractor,
    vertices: FloatArray,
    progress: Progress | None = None,
    *,
    links: bool = False,
) -> FloatArray:
    """Features (N, V, 9) of shapes, in parallel on all cores.

    Args:
        extractor: of features against the reference.
        vertices: (N, V, 3) the shapes.
        progress: called with (done, total) after each shape.
        links: true for the features of all sites, (N, V+B, 9): of the vertices and of the links.
    """
    N, V, _ = vertices.shape
    q = np.empty((N, V + len(extractor.reference.links) if links else V, 9))
    for n, found in enumerate(extract_each(extractor, vertices, links=links)):
        q[n] = found
        if progress is not None:
            progress(n + 1, N)
    return q
