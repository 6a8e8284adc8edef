"""Mirror images of example shapes: a symmetric body can also do on the left what it did right."""

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
from deformer.geometry import FloatArray, IntArray, Mesh, MeshSequence, Symmetry, find_symmetry

# Shapes mirrored at once: bounded memory.
_BATCH = 40
# Evenly spread shapes among which the most symmetric one is sought.
_SYMMETRY_CANDIDATES = 16
# Evenly spread examples on which mirror images are tried; by which share their images must lower
# the residual of ridge regression; and its ridge, as a share of the mean squared length.
_TRIAL_EXAMPLES = 64
_LEAST_GAIN = 0.1
_RIDGE = 0.01


def mirror_images(shapes: MeshSequence) -> tuple[FloatArray, Symmetry]:
    """Every shape (N, V, 3) mirrored, with the vertices where the connectivity has them.

    Example shapes hold poses in which left and right differ, of bodies that are never quite
    symmetric. So the deformation against the most symmetric shape s is mirrored and not the
    surface: its gradient at a vertex is that at the point of s opposite to it, reflected. What
    differs between the two halves of s stays where it is.

    Args:
        shapes: N shapes.

    Returns:
        The images, and the symmetry of s.
    """
    V = shapes.vertices
    candidates = _evenly_spread(len(V), _SYMMETRY_CANDIDATES)
    planes = [(find_symmetry(shapes.mesh(n)), n) for n in candidates]
    # Of shapes that are as symmetric, the first, whatever the rounding.
    limit = 1.01 * min(plane.error for plane, _ in planes) + 1e-6
    plane, n = next(entry for entry in planes if entry[0].error <= limit)
    rest = shapes.mesh(n)
    opposite = _opposite_points(rest, plane)
    extractor, poisson = FeatureExtractor(rest), PoissonSystem(rest)
    images = np.empty_like(V)
    for start in range(0, len(V), _BATCH):
        batch = slice(start, start + _BATCH)
        opposite_q = np.array([opposite @ q for q in extract_all(extractor, V[batch])])
        images[batch] = poisson.reconstruct(reflected(opposite_q, plane.normal))
    images += (plane.mirror(V.mean(axis=1)) - images.mean(axis=1))[:, None]
    return images, plane


def reflected(q: FloatArray, normal: FloatArray) -> FloatArray:
    """Features (..., 9) of gradients reflected in a plane: M T M, M = I − 2 n nᵀ.

    The rotation vector is axial, r to −M r; the stretch goes to M S M.

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

    Each example is rebuilt by ridge regression from all others, and from those and their images;
    its own image counts as itself. Images of a body that has no symmetry, or whose motion has none,
    are of no more use than noise: the residual does not shrink.

    Args:
        x: (N, V, 9) scaled features of the examples.
        images: (N, V, 9) scaled features of their mirror images.
    """
    indices = _evenly_spread(len(x), _TRIAL_EXAMPLES)
    plain, mirrored = (a[indices].reshape(len(indices), -1) for a in (x, images))
    own = np.arange(len(indices))
    without = _residual(plain, plain, own)
    both = _residual(plain, np.concatenate([plain, mirrored]), np.concatenate([own, own]))
    return bool(both < (1.0 - _LEAST_GAIN) * without)


def _residual(x: FloatArray, basis: FloatArray, own: IntArray) -> float:
    """Squared residual of all x (n, m) after ridge regression on the rows of a basis (b, m).

    Row r of the basis belongs to example own[r], whose own regression leaves it out.
    """
    G, g, squares = basis @ basis.T, x @ basis.T, (x**2).sum(axis=1)
    total = 0.0
    for n in range(len(x)):
        k = np.flatnonzero(own != n)
        # About the mean of the rows that count, through inner products alone.
        centred = G[np.ix_(k, k)]
        means, mean = centred.mean(axis=0), centred.mean()
        centred = centred - means - means[:, None] + mean
        goal = g[n, k] - means - g[n, k].mean() + mean
        length = squares[n] - 2.0 * g[n, k].mean() + mean
        ridge = _RIDGE * np.trace(centred) / len(k)
        weights = np.linalg.solve(centred + max(ridge, 1e-12) * np.eye(len(k)), goal)
        total += float(length - 2.0 * weights @ goal + weights @ centred @ weights)
    return total


def _evenly_spread(count: int, most: int) -> list[int]:
    """At most `most` of the indices below `count`, evenly spread."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int)).tolist()


def _opposite_points(mesh: Mesh, plane: Symmetry) -> sparse.csr_array:
    """Values at the point of the surface nearest to each vertex's mirror image: (V, V) weights."""
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
