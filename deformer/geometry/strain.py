"""Principal stretches of the faces of a deformed mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import checked_array, checked_instance
from deformer.errors import InputError
from deformer.geometry.mesh import FloatArray, Mesh


class FaceStrain:
    """Principal stretches of every face against a reference.

    Args:
        reference: the undeformed mesh. The stretch of a face without area is 1.
    """

    def __init__(self, reference: Mesh) -> None:
        """Invert each face's edges in a frame of its own plane."""
        checked_instance(reference, "reference", Mesh, remedy="make one of vertices and faces")
        self._faces, self._shape = reference.faces, reference.vertices.shape
        a, b = self._edges(reference.vertices)
        length = np.linalg.norm(a, axis=1)
        height = np.linalg.norm(np.cross(a, b), axis=1)
        longest = np.maximum(length, np.linalg.norm(b, axis=1))
        self._flat = height <= 1e-12 * longest**2
        length, height = np.where(self._flat, 1.0, length), np.where(self._flat, 1.0, height)
        # Edges (a, b) are the columns [[l, c], [0, h]] of the plane's frame.
        self._inverse = np.zeros((len(a), 2, 2))
        self._inverse[:, 0, 0] = 1.0 / length
        self._inverse[:, 0, 1] = -(a * b).sum(axis=1) / (length * height)
        self._inverse[:, 1, 1] = length / height

    def principal(self, vertices: ArrayLike) -> FloatArray:
        """Largest and smallest stretch (F, 2) of the faces at `vertices` (V, 3); 1 is unchanged.

        They are the singular values of the linear map from the reference's face to the deformed
        one.

        Raises:
            InputError: the shape of the array is not the reference's.
        """
        p = checked_array(vertices, "vertices", finite=False)
        if p.shape != self._shape:
            raise InputError(
                f"vertices: expected {self._shape} as the reference has, got {p.shape}"
            )
        gradient = np.stack(self._edges(p), axis=2) @ self._inverse
        E, G = (gradient**2).sum(axis=1).T
        F = (gradient[:, :, 0] * gradient[:, :, 1]).sum(axis=1)
        # Eigenvalues of [[E, F], [F, G]].
        middle, spread = 0.5 * (E + G), np.hypot(0.5 * (E - G), F)
        stretches = np.sqrt(np.maximum(np.stack([middle + spread, middle - spread], axis=1), 0.0))
        stretches[self._flat] = 1.0
        return stretches

    def signed(self, vertices: ArrayLike) -> FloatArray:
        """Logarithm to base 2 of the principal stretch (F,) farthest from 1.

        1 is twice as long, −1 half as long, 0 unchanged.

        Args:
            vertices: (V, 3) of the deformed mesh.

        Raises:
            InputError: the shape of the array is not the reference's.
        """
        logs = np.log2(np.maximum(self.principal(vertices), 1e-6))
        return np.where(np.abs(logs[:, 0]) >= np.abs(logs[:, 1]), logs[:, 0], logs[:, 1])

    def _edges(self, vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
        corner = vertices[self._faces[:, 0]]
        return vertices[self._faces[:, 1]] - corner, vertices[self._faces[:, 2]] - corner
