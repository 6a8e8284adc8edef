"""Mirror images of shapes: deformations reflected to the opposite side of a body."""

from __future__ import annotations

import igl
import numpy as np
from scipy import sparse

from deformer.acap.features import FeatureExtractor, extract_all
from deformer.acap.gradients import STRETCH_COLUMNS, STRETCH_ROWS
from deformer.acap.poisson import PoissonSystem
from deformer.geometry import FloatArray, Mesh, Symmetry

# Shapes mirrored at once: bounds memory.
_BATCH = 40


class MirrorMap:
    """Mirrors shapes of a body that is nearly its own mirror image, in the same connectivity.

    Bodies are never quite symmetric. Mirrored is therefore not the surface but its deformation
    against a symmetric shape, the rest: the image's gradient at a vertex is the reflected gradient
    at the opposite point of the rest. Differences between the two halves of the rest remain on
    their sides.

    Args:
        extractor, poisson: of the rest.
        plane: the plane of symmetry of the rest.
    """

    def __init__(
        self, extractor: FeatureExtractor, poisson: PoissonSystem, plane: Symmetry
    ) -> None:
        """Find the point of the rest opposite to each vertex."""
        self._extractor, self._poisson, self._plane = extractor, poisson, plane
        self._opposite = _opposite_points(poisson.reference, plane)

    def images(self, vertices: FloatArray) -> FloatArray:
        """Mirror images (N, V, 3) of shapes (N, V, 3), their centroids mirrored, too."""
        plane, poisson, rest = self._plane, self._poisson, self._poisson.reference
        images = np.empty_like(vertices)
        for start in range(0, len(vertices), _BATCH):
            batch = slice(start, start + _BATCH)
            features = extract_all(self._extractor, vertices[batch])
            opposite_q = np.array([self._opposite @ q for q in features])
            images[batch] = poisson.reconstruct(reflected(opposite_q, plane.normal))
        if len(rest.links) > 0:
            # Where the components are: moved from the rest as the reflected opposite points move.
            shapes = (*vertices, rest.vertices)
            points = np.stack([plane.mirror(self._opposite @ p) for p in shapes])
            images = poisson.placed(images, rest.vertices + points[:-1] - points[-1])
        images += (plane.mirror(vertices.mean(axis=1)) - images.mean(axis=1))[:, None]
        return images


def reflected(q: FloatArray, normal: FloatArray) -> FloatArray:
    """Features (..., 9) of gradients reflected in a plane: M T M, M = I − 2 n nᵀ.

    The rotation vector r is axial and becomes −M r; the stretch S becomes M S M.

    Args:
        q: (..., 9) features.
        normal: (3,) unit normal n of the plane.
    """
    M = np.eye(3) - 2.0 * np.outer(normal, normal)
    S = np.empty((*q.shape[:-1], 3, 3))
    S[..., STRETCH_ROWS, STRETCH_COLUMNS] = S[..., STRETCH_COLUMNS, STRETCH_ROWS] = q[..., 3:]
    stretch = (M @ S @ M)[..., STRETCH_ROWS, STRETCH_COLUMNS]
    return np.concatenate([-(q[..., :3] @ M), stretch], axis=-1)


def _opposite_points(mesh: Mesh, plane: Symmetry) -> sparse.csr_array:
    """Interpolation (V, V) to the point of the surface nearest to each vertex's mirror image."""
    image = plane.mirror(mesh.vertices)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
    _, face, point = igl.point_mesh_squared_distance(image, mesh.vertices, faces)
    corners = faces[np.asarray(face)]
    weights = igl.barycentric_coordinates(
        np.asarray(point), *(mesh.vertices[corners[:, c]] for c in range(3))
    )
    weights = np.clip(np.nan_to_num(weights, nan=1.0 / 3.0), 0.0, 1.0)
    V = len(corners)
    return sparse.csr_array((weights.ravel(), corners.ravel(), 3 * np.arange(V + 1)), shape=(V, V))
