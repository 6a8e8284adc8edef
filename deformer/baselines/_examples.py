"""Methods without components: they bend one of the training shapes to the control points."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from deformer.baselines.method import Space
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, MeshSequence, connected_components, procrustes


class Bending(ABC):
    """Keeps the training shapes, picks one, moves it rigidly to the control points and bends it.

    The pick is the reference, or, where `nearest` is set, the shape whose control points come
    closest to the targets after the rigid motion that is best for them.
    """

    name: ClassVar[str]
    space: ClassVar[Space] = "none"
    nearest: ClassVar[bool] = False

    def fit(self, shapes: MeshSequence, components: int, seed: int = 0) -> Self:
        """Keep the training shapes; there is nothing to learn, `components` and `seed` are idle."""
        self._shapes = shapes
        self._labels = connected_components(shapes.faces, shapes.vertices.shape[1])[1]
        self._vertices = np.empty(0, dtype=np.int64)
        self._prepared: dict[int, object] = {}
        return self

    def fit_handles(self, vertices: ArrayLike, targets: ArrayLike) -> FloatArray:
        """The mesh (V, 3) that meets vertices (H,) at targets (H, 3) exactly.

        What depends on the control vertices alone is kept until others are given.

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
        """Which shape to bend, and that shape (V, 3) moved rigidly to the targets."""
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
        """Factor what bending the shape `rest` (V, 3) by these control vertices needs."""

    @abstractmethod
    def _bend(
        self, prepared: object, start: FloatArray, vertices: IntArray, targets: FloatArray
    ) -> FloatArray:
        """Vertices (V, 3) from `start` with the control vertices at the targets."""
