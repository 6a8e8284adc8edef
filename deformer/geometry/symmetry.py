"""The plane that a body is symmetric about, and the vertex opposite to each vertex."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from deformer.errors import InputError
from deformer.geometry.mesh import FloatArray, IntArray, Mesh

_SAMPLES = 1500
_ROUNDS = 30
# Misfits below this, in bounding diagonals, are alike.
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A mirror plane of a mesh.

    Args:
        point: (3,) on the plane.
        normal: (3,) unit normal.
        opposite: (V,) the vertex nearest to each vertex's mirror image.
        error: root mean square distance from mirror image to that vertex, in bounding diagonals;
            0 for a body that is perfectly symmetric.
    """

    point: FloatArray
    normal: FloatArray
    opposite: IntArray
    error: float

    def mirror(self, points: ArrayLike) -> FloatArray:
        """Mirror images of points (..., 3)."""
        p = np.asarray(points, dtype=np.float64)
        return p - 2.0 * ((p - self.point) @ self.normal)[..., None] * self.normal


def find_symmetry(mesh: Mesh) -> Symmetry:
    """The mirror plane that fits a mesh best, in whatever pose it is.

    The principal axes and the coordinate axes are tried as normals; each is refined by pairing
    mirror images with their nearest vertices and solving for the plane, until the pairs stand
    still. A mesh without symmetry gets the least bad plane; `Symmetry.error` tells.
    """
    v = mesh.vertices
    centre = v.mean(axis=0)
    axes = np.linalg.eigh(np.cov((v - centre).T))[1].T
    tree = KDTree(v)
    # A fixed draw: the same mesh has the same plane every time.
    some = np.random.default_rng(0).permutation(len(v))[:_SAMPLES]
    found = [_refined(tree, v[some], normal, centre) for normal in (*axes, *np.eye(3))]
    # Of planes that fit alike, the first: which one that is must not hang on rounding.
    limit = 1.01 * min(plane[2] for plane in found) + (_ROUNDING * mesh.bounding_diagonal) ** 2
    point, normal, _ = next(plane for plane in found if plane[2] <= limit)
    return _paired(mesh, tree, point, normal)


def symmetry_about(mesh: Mesh, point: ArrayLike, normal: ArrayLike) -> Symmetry:
    """The mirror plane through `point` (3,) with `normal` (3,) of any length.

    Raises:
        InputError: `normal` is zero, or a number is not finite.
    """
    place, direction = np.asarray(point, dtype=np.float64), np.asarray(normal, dtype=np.float64)
    length = float(np.linalg.norm(direction))
    if not (np.isfinite(place).all() and np.isfinite(length) and length > 0):
        raise InputError(
            f"mirror plane: expected finite numbers and a normal other than zero, got point "
            f"{place.tolist()} and normal {direction.tolist()}"
        )
    return _paired(mesh, KDTree(mesh.vertices), place, direction / length)


def _refined(
    tree: KDTree, points: FloatArray, normal: FloatArray, point: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Point, normal and mean squared misfit of the best plane near the given one."""
    best = point, normal, np.inf
    for _ in range(_ROUNDS):
        image = points - 2.0 * ((points - point) @ normal)[:, None] * normal
        distance, nearest = tree.query(image)
        misfit = float((np.asarray(distance) ** 2).mean())
        if misfit >= best[2] * (1.0 - 1e-6):
            break
        best = point, normal, misfit
        # Σ ‖(I − 2 n nᵀ) p − q‖² over pairs p, q about their common centroid is least for the n of
        # the smallest eigenvalue of Σ (p qᵀ + q pᵀ).
        p, q = points, tree.data[nearest]
        point = 0.5 * (p.mean(axis=0) + q.mean(axis=0))
        cross = (p - point).T @ (q - point)
        normal = np.linalg.eigh(cross + cross.T)[1][:, 0]
    return best


def _paired(mesh: Mesh, tree: KDTree, point: FloatArray, normal: FloatArray) -> Symmetry:
    image = mesh.vertices - 2.0 * ((mesh.vertices - point) @ normal)[:, None] * normal
    distance, opposite = tree.query(image)
    error = float(np.sqrt((np.asarray(distance) ** 2).mean())) / (mesh.bounding_diagonal or 1.0)
    return Symmetry(point, normal, np.asarray(opposite, dtype=np.int64), error)
