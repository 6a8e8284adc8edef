"""Base class of methods whose shapes are an origin plus codes times components."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from deformer.baselines._checks import checked_codes, checked_handles, checked_shapes
from deformer.baselines._linear_basis import (
    HandleRegression,
    LinearBasis,
    Penalty,
    choose_penalty,
)
from deformer.baselines.method import Space
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, Mesh, MeshSequence

# Largest number of folds of the cross-validation.
_FOLDS = 4


class LinearMethod(ABC):
    """A method on vertex positions with a linear decoder; a subclass implements `fit_basis`.

    `fit_handles` minimises the squared distance to the targets plus a ridge times the squared
    Mahalanobis length of the code under the training codes, whose covariance is shrunk towards its
    diagonal. Cross-validation chooses ridge and shrinkage: bases learned without a fold of the
    training shapes, the same handles, least error over all vertices. Targets fix the frame, so that
    nothing is aligned. The first handle fit learns the bases of the folds (4, or N if less), which
    takes about as long as `fit` for each.
    """

    name: ClassVar[str]
    space: ClassVar[Space] = "vertices"

    _basis: LinearBasis | None = None

    @abstractmethod
    def fit_basis(
        self, vertices: FloatArray, reference: Mesh, components: int, seed: int
    ) -> LinearBasis:
        """Basis of K = `components` for shapes (N, V, 3); the reference need not be one of them."""

    def fit(self, shapes: MeshSequence, components: int, seed: int = 0) -> Self:
        """Learn K = `components` components from at least 2 shapes; shape 0 is the reference.

        Raises:
            InputError: fewer than two shapes, or no component.
        """
        if components < 1:
            raise InputError(f"components: expected at least 1, got {components}")
        if len(shapes) < 2:
            raise InputError(f"shapes: expected at least 2 to learn from, got {len(shapes)}")
        self._shapes, self._seed = shapes, seed
        self._basis = self.fit_basis(shapes.vertices, shapes.mesh(0), components, seed)
        self._regression: HandleRegression | None = None
        self._folds: list[HandleRegression] = []
        self._penalties: dict[tuple[int, ...], Penalty] = {}
        return self

    @property
    def basis(self) -> LinearBasis:
        """The learned basis; InputError before `fit`."""
        if self._basis is None:
            raise InputError(f"{self.name}: nothing is learned yet; call fit first")
        return self._basis

    def encode(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) of shapes (N, V, 3); least squares, where the basis has no other way."""
        return self.basis.encode(checked_shapes(vertices, len(self.basis.origin)))

    def fit_codes(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) whose decoded vertices come closest to shapes (N, V, 3): least squares."""
        return self.basis.project(checked_shapes(vertices, len(self.basis.origin)))

    def decode(self, codes: ArrayLike) -> FloatArray:
        """Shapes (N, V, 3) of codes (N, K)."""
        return self.basis.decode(checked_codes(codes, len(self.basis.components)))

    def fit_handles(self, vertices: ArrayLike, targets: ArrayLike) -> FloatArray:
        """Most likely mesh (V, 3) when vertices (H,) are known to be at targets (H, 3).

        Raises:
            InputError: no vertices, repeated or unknown ones, or targets of another shape.
        """
        handles, positions = checked_handles(vertices, targets, len(self.basis.origin))
        penalty = self.penalty(handles)
        if self._regression is None:
            V = self._shapes.vertices
            self._regression = HandleRegression(self.basis, V, V[:0])
        codes = self._regression.codes(
            handles, positions[None], penalty.shrinkage, penalty.seam, np.array([penalty.ridge])
        )
        return self.basis.decode(codes[0])[0]

    def penalty(self, handles: IntArray) -> Penalty:
        """Penalty for handles (H,), chosen once for each set of them."""
        key = tuple(handles.tolist())
        if key not in self._penalties:
            if not self._folds:
                self._folds = self._make_folds()
            self._penalties[key] = choose_penalty(self._folds, handles)
        return self._penalties[key]

    def _make_folds(self) -> list[HandleRegression]:
        V, reference = self._shapes.vertices, self._shapes.mesh(0)
        group = np.arange(len(V)) % min(_FOLDS, len(V))
        regressions = []
        for g in range(group.max() + 1):
            training, held_out = V[group != g], V[group == g]
            basis = self.fit_basis(training, reference, len(self.basis.components), self._seed)
            regressions.append(HandleRegression(basis, training, held_out))
        return regressions
