"""What training sees of a turn of the whole: the rotations of all faces from one shape to another.

Shapes are compared by the mean C of these rotations. The distance 1 − tr(C) / 3 is 0 if no face
turns. Where the distance 1 − tr(Rᵀ C) / 3 after the rotation R nearest to C is small, the shapes
differ by the turn R of the whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.geometry import FloatArray, IntArray, closest_rotations
from deformer.workspace import Rows, blocks


@dataclass(frozen=True, eq=False)
class LocalRotations:
    """Rotations of faces between N shapes.

    Args:
        frames: (N, 3, 3f) frames of f faces.
        count: (N,) numbers of faces whose frames are not zero, at least 1.
    """

    frames: FloatArray
    count: FloatArray

    @classmethod
    def of(cls, vertices: Rows, faces: IntArray) -> LocalRotations:
        """Of shapes (N, V, 3) with faces (f, 3)."""
        frames = np.concatenate([face_frames(vertices[part], faces) for part in blocks(vertices)])
        return cls(frames, np.maximum((frames != 0).any(axis=1).sum(axis=1) / 3.0, 1.0))

    def between(self, one: IntArray | int, other: IntArray | int) -> tuple[FloatArray, FloatArray]:
        """Means C (n, 3, 3) of the rotations from shapes `other` to `one`, and the nearest R.

        Args:
            one, other: (n,) shapes, or one shape.
        """
        one, other = np.broadcast_arrays(one, other)
        C = np.array([self.frames[n] @ self.frames[m].T for n, m in zip(one, other, strict=True)])
        C /= np.minimum(self.count[one], self.count[other])[:, None, None]
        return C, closest_rotations(C)

    def angles(self, one: IntArray | int, other: IntArray | int) -> FloatArray:
        """Angles (n,) of the turns from shapes `other` to `one`, in radians."""
        return rotation_angles(self.between(one, other)[1])


def distances(C: FloatArray, R: FloatArray | None = None) -> FloatArray:
    """Distances (n,) of shapes with mean rotations C (n, 3, 3), after turns R (n, 3, 3) if any."""
    trace = np.trace(C, axis1=1, axis2=2) if R is None else np.einsum("nij,nij->n", R, C)
    return 1.0 - trace / 3.0


def rotation_angles(R: FloatArray) -> FloatArray:
    """Angles (n,) of rotations (n, 3, 3), in radians."""
    # ‖R − I‖_F = 2√2 sin(θ/2), exact for small angles where the trace is not.
    chord = np.linalg.norm(R - np.eye(3), axis=(1, 2)) / np.sqrt(8.0)
    return 2.0 * np.arcsin(np.minimum(chord, 1.0))


def face_frames(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Orthonormal frames (N, 3, 3f) of faces (f, 3): edge, normal × edge, normal as columns.

    A face without area has zero columns. For shapes n and m, frames[n] @ frames[m].T is the sum
    over faces of the rotations from m to n.

    Args:
        vertices: (N, V, 3).
        faces: (f, 3).
    """
    a, b, c = (vertices[:, faces[:, corner]] for corner in range(3))
    edge = _unit(b - a)
    normal = _unit(np.cross(edge, c - a))
    frames = np.concatenate([edge, np.cross(normal, edge), normal], axis=1)
    return np.ascontiguousarray(frames.transpose(0, 2, 1))


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
