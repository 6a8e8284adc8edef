"""Points of a surface, and points that stand off it."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import (
    LARGEST,
    as_array,
    checked_array,
    checked_instance,
    checked_integer,
    checked_number,
    shortened,
)
from deformer.errors import InputError
from deformer.geometry.mesh import FloatArray, IntArray, Mesh

# Barycentric coordinates are rounded in files; they are scaled to a sum of 1.
_SUM_TOLERANCE = 0.01
# Greatest factor on the squared error of a handle's orientation, beside the handle's weight.
MOST_ORIENTATION_WEIGHT = 1e4


@dataclass(frozen=True)
class SurfacePoint:
    """The point Σ_k w_k p_k + offset n of a mesh with vertices p: it moves with the surface.

    n is the unit vector along Σ_k w_k n_k, where n_k are the vertices' normals (area-weighted, as
    of `deformer.vertex_normals`); faces are counter-clockwise seen from outside.

    Args:
        vertices: the vertices it is a mean of, all different.
        weights: w, one a vertex, at least 0; they are scaled to a sum of 1.
        offset: distance from the surface along the normal, in the data's units; negative inside.

    Raises:
        InputError: vertices that are not different whole numbers, weights that are not numbers of
            at least 0 with a sum above 0, as many as vertices, or an offset that is not finite.
    """

    vertices: tuple[int, ...]
    weights: tuple[float, ...] = (1.0,)
    offset: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if isinstance(self.vertices, np.ndarray):
            object.__setattr__(self, "vertices", self.vertices.reshape(-1).tolist())
        checked_instance(self.vertices, "vertices", Iterable, remedy="give a tuple of indices")
        vertices = tuple(checked_integer(v, "vertices", least=0) for v in self.vertices)
        weights = checked_array(self.weights, "weights", (len(vertices),), largest=LARGEST)
        if not len(vertices) or len(set(vertices)) < len(vertices):
            raise InputError(f"vertices: expected different ones, got {vertices}; name each once")
        if (weights < 0).any() or weights.sum() <= 0:
            raise InputError(
                f"weights: expected numbers of at least 0, not all 0, got {weights.tolist()}"
            )
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "weights", tuple((weights / weights.sum()).tolist()))
        offset = checked_number(self.offset, "offset", least=-LARGEST, most=LARGEST)
        object.__setattr__(self, "offset", offset)

    @classmethod
    def on_face(
        cls, faces: IntArray | Mesh, face: int, barycentric: ArrayLike, offset: float = 0.0
    ) -> SurfacePoint:
        """A point of a face.

        Args:
            faces: (F, 3) vertex indices, or the mesh.
            face: index of the face.
            barycentric: (3,) coordinates of at least 0 with a sum of 1, one a corner, in order.
            offset: as in the class.

        Raises:
            InputError: no such face, or other coordinates.
        """
        rows = faces.faces if isinstance(faces, Mesh) else as_array(faces, "faces")
        if rows.shape != (len(rows) if rows.ndim else 0, 3) or rows.dtype.kind not in "iu":
            raise InputError(
                f"faces: expected integers (F, 3) or a Mesh, got {shortened(faces)}; give one"
            )
        corners = rows[checked_integer(face, "face", least=0, most=len(rows) - 1)]
        b = checked_array(barycentric, "barycentric", (3,))
        if (b < -1e-6).any() or abs(b.sum() - 1) > _SUM_TOLERANCE:
            raise InputError(
                f"barycentric: expected 3 numbers of at least 0 with a sum of 1, got {b.tolist()}; "
                "give the coordinates of a point inside the face"
            )
        return cls(tuple(corners.tolist()), tuple(np.maximum(b, 0.0).tolist()), offset)


def plain_point(point: int | SurfacePoint) -> int | SurfacePoint:
    """The vertex, if the point is one; else the point without vertices of weight 0."""
    if isinstance(point, int):
        return point
    kept = [(v, w) for v, w in zip(point.vertices, point.weights, strict=True) if w > 0]
    if len(kept) == 1 and point.offset == 0:
        return kept[0][0]
    vertices, weights = zip(*kept, strict=True)
    return SurfacePoint(vertices, weights, point.offset)


@dataclass(frozen=True)
class FramePoint:
    """One of the three points Σ_k w_k p_k of a local frame, which turn with the surface.

    Args:
        frame: what all three have in common, and no other frame has.
        number: 0, 1 or 2.
        vertices: the vertices that the frame is attached to.
        weights: w, one a vertex, of any sign, with a sum of 1.
    """

    frame: Hashable
    number: int
    vertices: tuple[int, ...] = field(compare=False)
    weights: tuple[float, ...] = field(compare=False)
    offset: ClassVar[float] = 0.0


# A handle's row in the energy: a place on the mesh, or one of the points of its frame.
RowPoint = int | SurfacePoint | FramePoint


class SurfacePoints:
    """Several points as functions of the positions of a mesh's vertices.

    Args:
        points: H vertices, `SurfacePoint`s and `FramePoint`s.
        faces: (F, 3) int64 faces of the mesh.

    Attributes:
        frames: (n, 3) the points, by their index 0…H−1, of each local frame.
        index: (H, m) vertices of each point, the last one repeated where there are fewer than m.
        weights: (H, m) their weights.
        offsets: (H,) distances along the normal.
        ring: (R,) vertices on which the points depend if any has an offset; else empty.
    """

    def __init__(self, points: Sequence[RowPoint], faces: IntArray) -> None:
        """Find the faces around the points that have an offset."""
        full = [SurfacePoint((p,)) if isinstance(p, int) else p for p in points]
        m = max((len(p.vertices) for p in full), default=1)
        self.index = np.zeros((len(full), m), dtype=np.int64)
        self.weights = np.zeros((len(full), m))
        self.offsets = np.array([p.offset for p in full])
        for h, p in enumerate(full):
            self.index[h] = (*p.vertices, *p.vertices[-1:] * (m - len(p.vertices)))
            self.weights[h, : len(p.vertices)] = p.weights
        alone = (self.weights[:, 0] == 1.0) & (np.count_nonzero(self.weights, axis=1) == 1)
        self.is_vertex = alone & (self.offsets == 0.0)
        frames: dict[Hashable, list[int]] = {}
        for h, p in enumerate(points):
            if isinstance(p, FramePoint):
                frames.setdefault(p.frame, [0, 0, 0])[p.number] = h
        self.frames = np.array(list(frames.values()), dtype=np.int64).reshape(-1, 3)
        self._lifted = np.flatnonzero(self.offsets)
        corners = self.index[self._lifted]
        around = faces[np.isin(faces, corners).any(axis=1)] if len(corners) else faces[:0]
        self.ring = np.unique(np.append(around, self.index if len(corners) else corners))
        self._faces = np.searchsorted(self.ring, around)
        self._corners = np.searchsorted(self.ring, corners)

    def at(self, vertices: FloatArray) -> FloatArray:
        """The points (..., H, 3) of a shape with vertices (..., V, 3)."""
        if self.is_vertex.all():
            return vertices[..., self.index[:, 0], :]
        if len(self.ring):
            return self.at_ring(vertices[..., self.ring, :])
        return np.einsum("hm,...hmc->...hc", self.weights, vertices[..., self.index, :])

    def at_ring(self, ring: FloatArray) -> FloatArray:
        """The points (..., H, 3) of a shape whose vertices `ring` are at positions (..., R, 3)."""
        corners = ring[..., np.searchsorted(self.ring, self.index), :]
        feet = np.einsum("hm,...hmc->...hc", self.weights, corners)
        return 2 * feet - self.feet(ring, feet)

    def feet(self, ring: FloatArray, points: FloatArray) -> FloatArray:
        """Points (..., H, 3) less their offsets along the normals of a shape.

        Args:
            ring: (..., R, 3) positions of the shape's vertices `ring`.
            points: (..., H, 3).
        """
        feet = points.copy()
        if len(self._lifted):
            normals = _unit(self._corner_normals(ring).sum(axis=-2))
            feet[..., self._lifted, :] -= self.offsets[self._lifted, None] * normals
        return feet

    def frame_rotations(self, points: FloatArray, targets: FloatArray) -> FloatArray:
        """Rotations (..., n, 3, 3) of local frames onto their targets, without regard to stretch.

        Args:
            points, targets: (..., H, 3) positions of all points.
        """
        # This needs numba's kernels, which reading handles does not.
        from deformer.geometry.rotations import closest_rotations

        here, there = (_centred(p[..., self.frames, :]) for p in (points, targets))
        return closest_rotations(np.swapaxes(there, -1, -2) @ here)

    def stretched(self, points: FloatArray, targets: FloatArray) -> FloatArray:
        """Targets (..., H, 3), those of local frames with the stretch that the surface has there.

        Args:
            points, targets: (..., H, 3) positions of all points.
        """
        if not len(self.frames):
            return targets
        R = self.frame_rotations(points, targets)
        offsets = _centred(points[..., self.frames, :]) @ np.swapaxes(R, -1, -2)
        goals = np.broadcast_to(targets, points.shape).copy()
        goals[..., self.frames, :] = offsets + targets[..., self.frames, :].mean(-2, keepdims=True)
        return goals

    def lifts(self, vertices: FloatArray) -> FloatArray:
        """Vectors a (H, m, 3) such that Σ_k T_k a_k is a point's offset from the surface.

        T_k are deformation gradients at the point's vertices; they map normals to normals.

        Args:
            vertices: (V, 3) of the reference.
        """
        lifts = np.zeros((*self.index.shape, 3))
        if len(self._lifted):
            parts = self._corner_normals(vertices[self.ring])
            length = np.linalg.norm(parts.sum(axis=1), axis=-1)[:, None, None]
            scale = self.offsets[self._lifted, None, None] / np.where(length > 0, length, 1.0)
            lifts[self._lifted] = scale * parts
        return lifts

    def _corner_normals(self, ring: FloatArray) -> FloatArray:
        """w_k n_k (..., L, m, 3) of the vertices of the L points with an offset."""
        a, b, c = (ring[..., self._faces[:, k], :] for k in range(3))
        by_face, normals = np.cross(b - a, c - a), np.zeros(ring.shape)
        for k in range(3):
            np.add.at(np.moveaxis(normals, -2, 0), self._faces[:, k], np.moveaxis(by_face, -2, 0))
        return self.weights[self._lifted, :, None] * _unit(normals)[..., self._corners, :]


def _centred(points: FloatArray) -> FloatArray:
    """Points (..., n, 3) less their mean."""
    return points - points.mean(axis=-2, keepdims=True)


def _unit(x: FloatArray) -> FloatArray:
    """Vectors (..., 3) of length 1; zero for zero."""
    length = np.linalg.norm(x, axis=-1, keepdims=True)
    return x / np.where(length > 0, length, 1.0)
