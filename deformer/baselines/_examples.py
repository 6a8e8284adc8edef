"""Methods without components: each deforms one training shape to the control points."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from deformer.baselines.method import Space
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, MeshSequence, connected_components, procrustes


class Bending(ABC):
    """Moves one training shape rigidly to the control points, then deforms it to reach them.

    The shape is the reference or, if `nearest` is true, the training shape whose control points are
    closest to the targets after the best rigid motion.
    """

    name: ClassVar[str]
    space: ClassVar[Space] = "none"
    nearest: ClassVar[bool] = False

    def fit(self, shapes: MeshSequence, components: int, seed: int = 0) -> Self:
        """Store the training shapes; nothing is learned, `components` and `seed` are ignored."""
        self._shapes = shapes
        self._labels = connected_components(shapes.faces, shapes.vertices.shape[1])[1]
        self._vertices = np.empty(0, dtype=np.int64)
        self._prepared: dict[int, object] = {}
        return self

    def fit_handles(
        self, vertices: ArrayLike, targets: ArrayLike, noise: float = 0.0
    ) -> FloatArray:
        """Vertices (V, 3) of the deformed mesh, with vertices (H,) exactly at targets (H, 3).

        `noise` is ignored: the method has no prior that it could be weighed against. Factors of the
        last control vertices are cached.

        Raises:
            InputError: a connected component of the mesh has no control vertex.
        """
        index = np.asarray(vertices, dtype=np.int64)
        goals = np.asarray(targets, dtype=np.float64)
        if not np.array_equal(index, self._vertices):
            self._check(index)
            self._vertices, self._prepared = index, {}
        pick, start = self._start(index, goals)
        if pick not in self._prepared:
            self._prepared[pick] = self._prepare(self._shapes.vertices[pick], index)
        pose = self._bend(self._prepared[pick], start, index, goals)
        pose[index] = goals
        return pose

    def _check(self, vertices: IntArray) -> None:
        free = np.setdiff1d(self._labels, self._labels[vertices])
        if len(free):
            lost = int(np.flatnonzero(self._labels == free[0])[0])
            raise InputError(
                f"{self.name}: the connected component of vertex {lost} has no control point; "
                "add one there"
            )

    def _start(self, vertices: IntArray, targets: FloatArray) -> tuple[int, FloatArray]:
        """Index of the shape to deform, and this shape (V, 3) moved rigidly to the targets."""
        best, pick, start = np.inf, -1, self._shapes.vertices[0]
        for n in range(len(self._shapes) if self.nearest else 1):
            shape = self._shapes.vertices[n]
            R, t = procrustes(shape[vertices], targets)
            misfit = float(((shape[vertices] @ R.T + t - targets) ** 2).sum())
            if misfit < best:
                best, pick, start = misfit, n, shape @ R.T + t
        return pick, start

    @abstractmethod
    def _prepare(self, rest: FloatArray, vertices: IntArray) -> object:
        """Factors for deforming the rest shape (V, 3) by control vertices (H,)."""

    @abstractmethod
    def _bend(
        self, prepared: object, start: FloatArray, vertices: IntArray, targets: FloatArray
    ) -> FloatArray:
        """Vertices (V, 3) from `start` with the control vertices at the targets."""
