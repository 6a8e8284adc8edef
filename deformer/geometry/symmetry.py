"""The plane of symmetry of a body, and the vertex opposite to each vertex."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from deformer.checks import checked_array, checked_instance
from deformer.errors import InputError
from deformer.geometry.mesh import FloatArray, IntArray, Mesh
from deformer.geometry.rotations import log_to_rotation, rotation_to_log

_SAMPLE_COUNT = 1500
# Each plane is first refined with this many points. Those whose mean squared misfit is then at most
# so many times the least one are refined with all; of several meshes, those whose least one is.
_FEW, _PROMISING, _HOPEFUL = 200, 1.3, 2.0
_ITERATIONS = 30
# Misfits that differ by less than this, in bounding diagonals, count as equal.
_TOLERANCE = 1e-6

# Point, normal and mean squared misfit of a plane.
_Plane = tuple[FloatArray, FloatArray, float]


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A mirror plane of a mesh.

    Args:
        point: (3,) on the plane.
        normal: (3,) unit normal.
        opposite: (V,) int64 the vertex nearest to each vertex's mirror image.
        error: root mean square distance between mirror images and their opposite vertices, in
            bounding diagonals; 0 for a perfectly symmetric body.
    """

    point: FloatArray
    normal: FloatArray
    opposite: IntArray
    error: float

    def mirror(self, points: ArrayLike) -> FloatArray:
        """Mirror images of points (..., 3)."""
        p = checked_array(points, "points", ("...", 3))
        return p - 2.0 * ((p - self.point) @ self.normal)[..., None] * self.normal

    def mirror_directions(self, directions: ArrayLike) -> FloatArray:
        """Mirror images of directions (..., 3), such as displacements or normals."""
        d = checked_array(directions, "directions", ("...", 3))
        return d - 2.0 * (d @ self.normal)[..., None] * self.normal

    def mirror_rotations(self, rotations: ArrayLike) -> FloatArray:
        """Mirror images M R M of rotations R (..., 3, 3), M = I − 2 n nᵀ."""
        R = checked_array(rotations, "rotations", ("...", 3, 3))
        M = np.eye(3) - 2.0 * np.outer(self.normal, self.normal)
        return M @ R @ M

    def symmetric_rotations(self, rotations: ArrayLike) -> FloatArray:
        """The part of rotations (..., 3, 3) that is its own mirror image: turns about the normal.

        Of a rotation vector r it is n (n · r), for r = −M r holds for multiples of n alone.
        """
        r = rotation_to_log(checked_array(rotations, "rotations", ("...", 3, 3)))
        return log_to_rotation((r @ self.normal)[..., None] * self.normal)


def find_symmetry(mesh: Mesh) -> Symmetry:
    """The mirror plane that fits a mesh best.

    The principal axes and the coordinate axes are tried as normals. Each plane is refined by
    pairing mirror images with their nearest vertices and solving for the plane, until the misfit
    stops falling; those that fit poorly with few points, with those alone. A mesh without symmetry
    gets the plane of the least misfit, which is `Symmetry.error`.

    Args:
        mesh: V vertices, in any pose.
    """
    checked_instance(mesh, "mesh", Mesh, remedy="make one of vertices and faces")
    return _fitted(mesh, _rough_planes(mesh))


def most_symmetric(shapes: Sequence[Mesh]) -> tuple[Symmetry, int]:
    """The symmetry of the most symmetric of several meshes, and its index.

    Args:
        shapes: the meshes, for example poses of one body.
    """
    rough = [_rough_planes(shape) for shape in shapes]
    least = [min(plane[2] for plane in planes) for planes in rough]
    # The others' symmetries are much worse even as roughly as they are known.
    limit = _HOPEFUL * min(least) + _TOLERANCE**2
    some = [n for n, misfit in enumerate(least) if misfit <= limit]
    found = [_fitted(shapes[n], rough[n]) for n in some]
    # The first of the equally symmetric shapes, with a tolerance: rounding must not decide.
    limit = 1.01 * min(plane.error for plane in found) + _TOLERANCE
    index = next(n for n, plane in enumerate(found) if plane.error <= limit)
    return found[index], some[index]


def symmetry_about(mesh: Mesh, point: ArrayLike, normal: ArrayLike) -> Symmetry:
    """The mirror plane through a point, and the vertices of a mesh that it pairs.

    Args:
        mesh: V vertices.
        point: (3,) on the plane.
        normal: (3,) of any length.

    Raises:
        InputError: `normal` is zero, or a number is not finite.
    """
    checked_instance(mesh, "mesh", Mesh, remedy="make one of vertices and faces")
    origin = checked_array(point, "mirror plane: point", (3,))
    direction = checked_array(normal, "mirror plane: normal", (3,))
    length = float(np.linalg.norm(direction))
    if not (np.isfinite(origin).all() and np.isfinite(length) and length > 0):
        raise InputError(
            f"mirror plane: expected finite numbers and a normal other than zero, got point "
            f"{origin.tolist()} and normal {direction.tolist()}"
        )
    return _paired(mesh, KDTree(mesh.vertices), origin, direction / length)


def _rough_planes(mesh: Mesh) -> list[_Plane]:
    """Planes refined with few points, which are paired with not many; misfits by (diagonal)²."""
    v = mesh.vertices
    centre, unit = v.mean(axis=0), mesh.bounding_diagonal or 1.0
    axes = np.linalg.eigh(np.cov((v - centre).T))[1].T
    sample = v[_sample(mesh)]
    tree = KDTree(sample)
    planes = [_refined(tree, sample[:_FEW], normal, centre) for normal in (*axes, *np.eye(3))]
    return [(point, normal, misfit / unit**2) for point, normal, misfit in planes]


def _fitted(mesh: Mesh, rough: list[_Plane]) -> Symmetry:
    """The best of the promising planes, refined with all points of the sample."""
    tree, points = KDTree(mesh.vertices), mesh.vertices[_sample(mesh)]
    rounding = (_TOLERANCE * mesh.bounding_diagonal) ** 2
    limit = _PROMISING * min(plane[2] for plane in rough) + _TOLERANCE**2
    planes = [_refined(tree, points, normal, point) for point, normal, far in rough if far <= limit]
    # The first of the planes that fit equally well, with a tolerance: rounding must not decide.
    limit = 1.01 * min(plane[2] for plane in planes) + rounding
    point, normal, _ = next(plane for plane in planes if plane[2] <= limit)
    return _paired(mesh, tree, point, normal)


def _sample(mesh: Mesh) -> IntArray:
    """Indices of some vertices; a fixed draw: the same mesh has the same plane every time."""
    return np.random.default_rng(0).permutation(len(mesh.vertices))[:_SAMPLE_COUNT]


def _refined(tree: KDTree, points: FloatArray, normal: FloatArray, point: FloatArray) -> _Plane:
    """Point, normal and mean squared misfit of the best plane near the given one."""
    best = point, normal, np.inf
    for _ in range(_ITERATIONS):
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
