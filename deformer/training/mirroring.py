"""Mirror images of example shapes: a symmetric body can do with its left what its right does."""

from __future__ import annotations

import igl
import numpy as np
from scipy import sparse

from deformer.acap import (
    STRETCH_COLUMNS,
    STRETCH_ROWS,
    FeatureExtractor,
    PoissonSystem,
    extract_all,
)
from deformer.geometry import FloatArray, IntArray, Mesh, MeshSequence, Symmetry, most_symmetric

# Shapes mirrored at once: bounds memory.
_BATCH = 40
# Number of evenly spread shapes, of which the most symmetric one is chosen.
_SYMMETRY_CANDIDATES = 16
# The trial of mirror images: number of evenly spread examples, the share by which images must lower
# the residual of ridge regression, and the ridge as a share of the mean squared length.
_TRIAL_EXAMPLES = 64
_LEAST_GAIN = 0.1
_RIDGE = 0.01


def mirror_images(shapes: MeshSequence) -> tuple[FloatArray, Symmetry]:
    """Mirror images of shapes, in the same connectivity.

    Bodies are never quite symmetric. Mirrored is therefore not the surface but its deformation
    against the most symmetric shape s: the image's gradient at a vertex is the reflected gradient
    at the opposite point of s. Differences between the two halves of s remain on their sides.

    Args:
        shapes: N shapes.

    Returns:
        The images (N, V, 3), and the symmetry of s.
    """
    V = shapes.vertices
    candidates = _evenly_spread(len(V), _SYMMETRY_CANDIDATES)
    plane, n = most_symmetric([shapes.mesh(candidate) for candidate in candidates])
    rest = shapes.mesh(candidates[n])
    opposite = _opposite_points(rest, plane)
    extractor, poisson = FeatureExtractor(rest), PoissonSystem(rest)
    images = np.empty_like(V)
    for start in range(0, len(V), _BATCH):
        batch = slice(start, start + _BATCH)
        opposite_q = np.array([opposite @ q for q in extract_all(extractor, V[batch])])
        images[batch] = poisson.reconstruct(reflected(opposite_q, plane.normal))
    if len(poisson.reference.links) > 0:
        # Where the components are: moved from s as the reflected opposite points move.
        points = np.stack([plane.mirror(opposite @ p) for p in (*V, rest.vertices)])
        images = poisson.placed(images, rest.vertices + points[:-1] - points[-1])
    images += (plane.mirror(V.mean(axis=1)) - images.mean(axis=1))[:, None]
    return images, plane


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


def images_explain(x: FloatArray, images: FloatArray) -> bool:
    """True if mirror images explain examples better than the other examples alone.

    Ridge regression predicts each example from all others, without and with the images (its own
    image is left out, too). If body or motion are not symmetric, images are of no more use than
    noise, and the residual does not shrink.

    Args:
        x: (N, V, 9) scaled features of the examples.
        images: (N, V, 9) scaled features of their mirror images.
    """
    indices = _evenly_spread(len(x), _TRIAL_EXAMPLES)
    plain, mirrored = (a[indices].reshape(len(indices), -1) for a in (x, images))
    own = np.arange(len(indices))
    without = leave_one_out_residual(plain, plain, own)
    both = leave_one_out_residual(
        plain, np.concatenate([plain, mirrored]), np.concatenate([own, own])
    )
    return bool(both < (1.0 - _LEAST_GAIN) * without)


def leave_one_out_residual(x: FloatArray, basis: FloatArray, own: IntArray) -> float:
    """Squared residual of examples after ridge regression on the rows of a basis, summed.

    The regression of an example leaves out the basis rows that belong to it.

    Args:
        x: (n, m) examples.
        basis: (b, m) rows.
        own: (b,) index of the example that each row belongs to.
    """
    G, g, squares = basis @ basis.T, x @ basis.T, (x**2).sum(axis=1)
    total = 0.0
    for n in range(len(x)):
        k = np.flatnonzero(own != n)
        # About the mean of the rows in k, by inner products alone.
        centred = G[np.ix_(k, k)]
        means, mean = centred.mean(axis=0), centred.mean()
        centred = centred - means - means[:, None] + mean
        cross = g[n, k] - means - g[n, k].mean() + mean
        length = squares[n] - 2.0 * g[n, k].mean() + mean
        ridge = _RIDGE * np.trace(centred) / len(k)
        weights = np.linalg.solve(centred + max(ridge, 1e-12) * np.eye(len(k)), cross)
        total += float(length - 2.0 * weights @ cross + weights @ centred @ weights)
    return total


def _evenly_spread(count: int, most: int) -> list[int]:
    """At most `most` of the indices below `count`, evenly spread."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int)).tolist()


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
