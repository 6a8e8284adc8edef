"""Matrices of bones: to the world, to their parents, and to units of another size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.geometry import FloatArray, IntArray, Mesh


@dataclass(frozen=True, eq=False)
class Frame:
    """Units in which a mesh has the size 1 and lies about the origin.

    Args:
        centre: (3,) the origin, in the data's own units.
        size: the unit of length.
    """

    centre: FloatArray
    size: float

    @classmethod
    def of(cls, mesh: Mesh) -> Frame:
        """The frame of a mesh's bounding box."""
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        return cls(0.5 * (low + high), mesh.bounding_diagonal or 1.0)

    def inward(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) in these units."""
        return (points - self.centre) / self.size

    def outward(self, T: FloatArray) -> FloatArray:
        """Transforms (..., 3, 4) of points in these units, for points in the data's own."""
        R = T[..., :3]
        t = self.size * T[..., 3] + self.centre - R @ self.centre
        return np.concatenate([R, t[..., None]], axis=-1)


def translations(points: FloatArray) -> FloatArray:
    """Matrices (n, 4, 4) that move the origin to points (n, 3)."""
    matrices = np.tile(np.eye(4), (len(points), 1, 1))
    matrices[:, :3, 3] = points
    return matrices


def world_matrices(T: FloatArray, rest: FloatArray) -> FloatArray:
    """Matrices (..., B, 4, 4) of bones from their rest matrices and transforms (..., B, 3, 4)."""
    M = np.zeros((*T.shape[:-2], 4, 4))
    M[..., :3, :] = T
    M[..., 3, 3] = 1.0
    return M @ rest


def local_matrices(M: FloatArray, parents: IntArray) -> FloatArray:
    """Matrices (..., B, 4, 4) relative to the parents' (B,), where −1 is the world.

    Args:
        M: (..., B, 4, 4) rigid motions to the world.
        parents: (B,).
    """
    local = np.array(M)
    for b, parent in enumerate(parents):
        if parent >= 0:
            # (R, t)⁻¹ = (Rᵀ, −Rᵀ t)
            back = np.swapaxes(M[..., parent, :3, :3], -1, -2)
            local[..., b, :3, :3] = back @ M[..., b, :3, :3]
            away = M[..., b, :3, 3] - M[..., parent, :3, 3]
            local[..., b, :3, 3] = (back @ away[..., None])[..., 0]
    return local
