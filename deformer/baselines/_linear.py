"""What all methods share whose shapes are an origin plus codes times components."""

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

# Groups of training shapes that are left out in turn, at most.
_GROUPS = 4


class LinearMethod(ABC):
    """A method on positions whose decoder is linear; a subclass has `fit_basis`.

    Handles: codes minimise the squared distance to the targets plus a ridge times their squared
    length under the Gaussian of the training codes, whose covariance is shrunk towards its
    diagonal. Ridge and shrinkage are those with the least error over all vertices of training
    shapes that are left out in turn (the basis learned again without them), with the same handle
    vertices. Targets fix the frame: nothing is aligned. The bases for that are learned once, when
    handles are first fitted, and each of them (4, or N if less) takes about as long as `fit`.
    """

    name: ClassVar[str]
    space: ClassVar[Space] = "vertices"

    _basis: LinearBasis | None = None

    @abstractmethod
    def fit_basis(
        self, vertices: FloatArray, reference: Mesh, components: int, seed: int
    ) -> LinearBasis:
        """Basis with K = `components` of shapes (N, V, 3); `reference` need not be among them."""

    def fit(self, shapes: MeshSequence, components: int, seed: int = 0) -> Self:
        """Learn from the training shapes, of which at least two are needed; 0 is the reference.

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
        """What was learned."""
        if self._basis is None:
            raise InputError(f"{self.name}: nothing is learned yet; call fit first")
        return self._basis

    def encode(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) of shapes (N, V, 3): those of `fit_codes` if it says no other."""
        return self.basis.encode(checked_shapes(vertices, len(self.basis.origin)))

    def fit_codes(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) whose decoded vertices come closest to shapes (N, V, 3): least squares."""
        return self.basis.project(checked_shapes(vertices, len(self.basis.origin)))

    def decode(self, codes: ArrayLike) -> FloatArray:
        """Shapes (N, V, 3) of codes (N, K)."""
        return self.basis.decode(checked_codes(codes, len(self.basis.components)))

    def fit_handles(self, vertices: ArrayLike, targets: ArrayLike) -> FloatArray:
        """The mesh (V, 3) when only vertices (H,) are known to lie at targets (H, 3).

        Raises:
            InputError: no, repeated or unknown vertices, or targets of another shape.
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
        """What is charged with these handle vertices (H,); chosen once for each set of them."""
        key = tuple(handles.tolist())
        if key not in self._penalties:
            if not self._folds:
                self._folds = self._make_folds()
            self._penalties[key] = choose_penalty(self._folds, handles)
        return self._penalties[key]

    def _make_folds(self) -> list[HandleRegression]:
        V, reference = self._shapes.vertices, self._shapes.mesh(0)
        group = np.arange(len(V)) % min(_GROUPS, len(V))
        regressions = []
        for g in range(group.max() + 1):
            training, held_out = V[group != g], V[group == g]
            basis = self.fit_basis(training, reference, len(self.basis.components), self._seed)
            regressions.append(HandleRegression(basis, training, held_out))
        return regressions
