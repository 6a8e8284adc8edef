"""Skinning of a mesh by bones: dual-quaternion blending and delta mush."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from decimation import adjacency, vertex_normals
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial.transform import Rotation


def blend(
    points: NDArray,
    weights: NDArray,
    parents: Sequence[int],
    rotations: NDArray,
    translations: NDArray,
) -> NDArray:
    """Points (V, 3) moved by dual-quaternion blending, which keeps the volume of bent joints.

    Args:
        points: (V, 3) positions at rest.
        weights: (V, B) skinning weights; rows sum to 1.
        parents: B parent indices, −1 for a root; a parent comes before its children.
        rotations: (B, 3, 3) of the bones, from rest.
        translations: (B, 3), so that bone b takes a point p to `rotations[b] @ p +
            translations[b]`.

    Source: Kavan et al., Skinning with Dual Quaternions, 2007.
    """
    real = Rotation.from_matrix(rotations).as_quat()  # x y z w
    # A bone's quaternion takes the sign nearest its parent's: no vertex blends q with −q.
    for bone, parent in enumerate(parents):
        if parent >= 0 and real[bone] @ real[parent] < 0:
            real[bone] = -real[bone]
    w, xyz = real[:, 3:], real[:, :3]
    dual_xyz = 0.5 * (w * translations + np.cross(translations, xyz))
    dual_w = -0.5 * (translations * xyz).sum(1, keepdims=True)
    q, d = weights @ real, weights @ np.concatenate([dual_xyz, dual_w], 1)
    norm = np.linalg.norm(q, axis=1, keepdims=True)
    q, d = q / norm, d / norm
    v, s = q[:, :3], q[:, 3:]
    move = 2 * (s * d[:, :3] - d[:, 3:] * v + np.cross(v, d[:, :3]))
    return points + 2 * np.cross(v, np.cross(v, points) + s * points) + move


class DeltaMush:
    """Spreads the creases of a skinned mesh and keeps the details of its rest shape.

    Source: Mancewicz et al., Delta Mush, DigiPro 2014.
    """

    def __init__(self, rest: NDArray, faces: NDArray, rounds: int) -> None:
        """Store what smoothing takes from the rest shape, in local frames of the smooth surface.

        Args:
            rest: (V, 3) rest shape.
            faces: (F, 3) triangles.
            rounds: how often every vertex moves halfway to the mean of its neighbours.
        """
        self._faces, self._rounds = faces, rounds
        matrix = adjacency(faces, len(rest))
        self._mean = sparse.csr_array(sparse.diags_array(1 / matrix.sum(axis=1)) @ matrix)
        # One neighbour of every vertex, the first tangent of its local frame.
        self._partner = self._mean.indices[self._mean.indptr[:-1]]
        smooth, frames = self._smoothed(rest)
        self._detail = np.einsum("vji,vj->vi", frames, rest - smooth)

    def apply(self, points: NDArray) -> NDArray:
        """Skinned points (V, 3), smoothed, with the details of the rest shape."""
        smooth, frames = self._smoothed(points)
        return smooth + np.einsum("vij,vj->vi", frames, self._detail)

    def _smoothed(self, points: NDArray) -> tuple[NDArray, NDArray]:
        """Smoothed points (V, 3) and an orthonormal frame (V, 3, 3), as columns, at each."""
        for _ in range(self._rounds):
            points = 0.5 * (points + self._mean @ points)
        normal = vertex_normals(points, self._faces)
        first = points[self._partner] - points
        first -= (first * normal).sum(1, keepdims=True) * normal
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        return points, np.stack([first, np.cross(normal, first), normal], 2)
