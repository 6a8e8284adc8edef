"""Orientations of handles, by three points that turn with the surface around each handle.

An orientation asks for R, the rotation of the surface around the handle relative to the reference.
Let A (3, 2) be the least-squares derivative of the positions of vertices around the handle, on the
surface, with respect to their places in the plane of largest extent on the reference, which two
unit vectors B (3, 2) span. A is linear in the positions, and B itself on the reference. A local
frame is the three points p + l A u of the handle's position p, with unit vectors u at 120°. With
targets q + l R B u and a third of the handle's weight each, their squared distances are those of
the handle's and of its derivative: Σ ‖p + l A u − q − l R B u‖² / 3 = ‖p − q‖² + ½ l² ‖A − R B‖².

The points are handles like any other, so that everything that is known of the positions of handles
serves their orientations.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from deformer.checks import LARGEST, checked_array, checked_instance, checked_number
from deformer.editing.handles import Point, check_points, closed_point
from deformer.errors import InputError
from deformer.geometry import (
    MOST_ORIENTATION_WEIGHT,
    FloatArray,
    FramePoint,
    IntArray,
    SurfacePoint,
    checked_rotations,
    closest_rotations,
    edges,
    rotation_to_log,
    spread,
)
from deformer.model import DeformationModel

# Radius, in bounding diagonals along the edges, within which vertices determine a rotation, beside
# the neighbours of the handle, and the most vertices that do.
_RADIUS, _MOST = 0.03, 24
# Least ratio of the two larger extents of these vertices.
_THINNEST = 1e-3
_ANGLES = 2.0 * np.pi / 3.0 * np.arange(3)
# The unit vectors u (3, 2).
_DIRECTIONS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)


class LocalFrame:
    """The three points of a handle's local frame.

    Args:
        point: the handle's vertex, or its point of the surface.
        vertices: (n,) the vertices around it.
        reference: (V, 3) vertices of the reference.
        length: l, in the data's units.

    Attributes:
        points: the three points.
        offsets: (3, 3) their offsets l B u from the handle on the reference, one a row.

    Raises:
        InputError: the vertices are on a line, so that no rotation can be told from them.
    """

    def __init__(
        self, point: Point, vertices: IntArray, reference: FloatArray, length: float
    ) -> None:
        """Compute the weights of the points."""
        own = SurfacePoint((point,)) if isinstance(point, int) else point
        around = reference[vertices] - reference[vertices].mean(axis=0)
        _, extents, axes = np.linalg.svd(around, full_matrices=False)
        if len(extents) < 2 or not extents[1] > _THINNEST * extents[0]:
            raise InputError(
                f"{_named(point)} has no surface around it that could turn; leave out its "
                "orientation"
            )
        B = axes[:2].T
        derivative = around @ B / extents[:2] ** 2
        self.offsets: FloatArray = length * _DIRECTIONS @ B.T
        index = np.append(own.vertices, vertices)
        self._index, place = np.unique(index, return_inverse=True)
        self._weights = np.zeros((3, len(self._index)))
        for row, u in zip(self._weights, _DIRECTIONS, strict=True):
            np.add.at(row, place, np.append(own.weights, length * derivative @ u))
        names = tuple(self._index.tolist())
        self.points = tuple(
            FramePoint((point, length), n, names, tuple(row.tolist()))
            for n, row in enumerate(self._weights)
        )

    def targets(self, position: FloatArray, rotation: FloatArray) -> FloatArray:
        """Targets (..., 3, 3) of the points, for (..., 3) positions and (..., 3, 3) rotations."""
        return position[..., None, :] + self.offsets @ np.swapaxes(rotation, -1, -2)

    def rotation(self, vertices: FloatArray) -> FloatArray:
        """Rotations (..., 3, 3) of the surface around the handle, of shapes (..., V, 3)."""
        here = self._weights @ vertices[..., self._index, :]
        here = here - here.mean(axis=-2, keepdims=True)
        return closest_rotations(np.swapaxes(here, -1, -2) @ self.offsets)


class LocalFrames:
    """Local frames of a model's handles; each is computed once.

    Args:
        model: the model whose vertices they are.

    Attributes:
        noise: σ, standard deviation of handle positions, in bounding diagonals. That of
            orientations is then √σ, in radians: lengths are √σ bounding diagonals.
    """

    def __init__(self, model: DeformationModel) -> None:
        """Start without frames."""
        self._model, self.noise = model, model.handle_noise
        self._neighbourhoods: dict[Point, IntArray] = {}
        self._frames: dict[tuple[Point, float], LocalFrame] = {}

    def of(self, point: Point, weight: float = 1.0) -> LocalFrame:
        """The local frame of a handle.

        Args:
            point: the handle's vertex, or its point of the surface.
            weight: factor on the squared error of the orientation.

        Raises:
            InputError: there is no surface around the point, or the point is off the surface.
        """
        reference = self._model.reference
        length = (weight * self.noise) ** 0.5 * reference.bounding_diagonal
        frame = self._frames.get((point, length))
        if frame is None:
            if point not in self._neighbourhoods:
                self._neighbourhoods[point] = self._around(point)
            frame = LocalFrame(point, self._neighbourhoods[point], reference.vertices, length)
            self._frames[point, length] = frame
        return frame

    def _around(self, point: Point) -> IntArray:
        """Vertices (n,) near a point along the surface, and its neighbours."""
        if isinstance(point, SurfacePoint) and point.offset:
            raise InputError(
                f"{_named(point)} is off the surface and has no orientation; give it the offset 0, "
                "or leave out its orientation"
            )
        own = [point] if isinstance(point, int) else list(point.vertices)
        reference = self._model.reference
        radius = _RADIUS * reference.bounding_diagonal
        near = np.isfinite(dijkstra(self._graph, indices=own, limit=radius)).any(axis=0)
        near[self._graph[own].indices] = True
        vertices = np.flatnonzero(near)
        centre = reference.vertices[own].mean(axis=0)
        return vertices[spread(reference.vertices[vertices] - centre, _MOST)]

    @cached_property
    def _graph(self) -> sparse.csr_array:
        """Lengths of the mesh's edges (V, V)."""
        v = self._model.reference.vertices
        i, j = edges(self._model.reference.faces).T
        # An edge of no length is none to `dijkstra`.
        length = np.maximum(np.linalg.norm(v[i] - v[j], axis=1), np.finfo(float).tiny)
        half = sparse.coo_array((length, (i, j)), shape=(len(v), len(v)))
        return sparse.csr_array(half + half.T)


def checked_weights(weights: Any, count: int) -> FloatArray:
    """Weights (H,) of orientations; ones for None.

    Raises:
        InputError: another number of them, or one that is not positive or too large.
    """
    if weights is None:
        return np.ones(count)
    name = "orientation_weights"
    factors = checked_array(weights, name, (count,), remedy="give one a handle")
    bad = ~((factors > 0) & (factors <= MOST_ORIENTATION_WEIGHT))
    if bad.any():
        h = int(bad.argmax())
        raise InputError(
            f"{name}[{h}]: expected a number above 0 and up to {MOST_ORIENTATION_WEIGHT:g}, got "
            f"{factors[h]:g}; correct it"
        )
    return factors


def checked_orientations(
    orientations: Any, weights: Any, shape: tuple[int, ...]
) -> tuple[FloatArray, FloatArray]:
    """Check the orientations of handles and their weights.

    Args:
        orientations: as of `checked_rotations`; None is none at all.
        weights: (H,), or None for ones.
        shape: (..., H).

    Returns:
        Rotations (..., H, 3, 3), NaN where there is none, and weights (H,).

    Raises:
        InputError: other shapes, what is no rotation, or a weight that is not positive or too
            large.
    """
    name = "orientation_weights"
    if orientations is None:
        R = np.full((*shape, 3, 3), np.nan)
    else:
        R = checked_rotations(orientations, "orientations", shape)
    if weights is None:
        return R, np.ones(shape[-1])
    factors = checked_array(weights, name, shape[-1:], remedy="give one a handle")
    for h, factor in enumerate(factors.tolist()):
        checked_number(factor, f"{name}[{h}]", above=0, most=MOST_ORIENTATION_WEIGHT)
    return R, factors


def turned_by(R: FloatArray, goal: FloatArray) -> FloatArray:
    """Angles (...), in radians, of the rotations that take R (..., 3, 3) to `goal` (..., 3, 3)."""
    return np.linalg.norm(rotation_to_log(np.swapaxes(R, -1, -2) @ goal), axis=-1)


def local_rotations(
    model: DeformationModel, points: ArrayLike | Sequence[Point], vertices: ArrayLike
) -> FloatArray:
    """Rotations of a shape's surface around points, relative to the model's reference.

    They are what the `orientations` of handles ask for: a shape's own ones are met by that shape.

    Args:
        model: the model with the reference.
        points: (H,) vertex indices, `SurfacePoint`s without an offset, or both.
        vertices: (..., V, 3) positions of the shape's vertices.

    Returns:
        (..., H, 3, 3) rotation matrices.

    Raises:
        InputError: another number of vertices, a point that does not exist, is off the surface, or
            has no surface around it.
    """
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    V = len(model.reference.vertices)
    shape = checked_array(vertices, "vertices", ("...", V, 3), largest=LARGEST)
    frames, shape = LocalFrames(model.closed), model.seams.close(shape)
    closed = [closed_point(model, point) for point in check_points(model, points)]
    found = [frames.of(point).rotation(shape) for point in closed]
    return np.stack(found, axis=-3) if found else np.empty((*shape.shape[:-2], 0, 3, 3))


def _named(point: Point) -> str:
    return f"vertex {point}" if isinstance(point, int) else f"{point}"
