"""Base class of methods whose shapes are an origin plus codes times components."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer.baselines._checks import checked_codes, checked_handles, checked_shapes
from deformer.baselines._linear_basis import (
    HandleRegression,
    LinearBasis,
    Penalty,
    choose_penalty,
)
from deformer.baselines.method import Space
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, Mesh, MeshSequence, align

# Largest number of folds of the cross-validation.
_FOLDS = 4
# Fewer handles do not determine a rigid motion.
_LEAST_FREE = 3


@dataclass(frozen=True)
class HandleChoice:
    """How a linear method fits a set of handles.

    Args:
        free: true if the body may be anywhere; false if its place is learned with the codes.
        penalty: regularisation of the code.
    """

    free: bool
    penalty: Penalty


class LinearMethod(ABC):
    """A method on vertex positions with a linear decoder; a subclass implements `fit_basis`.

    `fit_handles` minimises the squared distance to the targets plus a ridge times the squared
    Mahalanobis length of the code under the training codes, whose covariance is shrunk towards its
    diagonal. Codes tell the place of the body, too; or, from 3 handles on, a second basis is of
    shapes that are rigidly aligned to the reference, and the body may be anywhere.
    Cross-validation chooses place, ridge and shrinkage: bases learned without a fold of the
    training shapes, the same handles with the same noise, least error over all vertices. The first
    handle fit learns the second basis, and both of the folds (4, or N if less), each of which takes
    about as long as `fit`.
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
        self._regressions: dict[bool, tuple[HandleRegression, list[HandleRegression]]] = {}
        self._choices: dict[tuple[float, ...], HandleChoice] = {}
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

    def fit_handles(
        self, vertices: ArrayLike, targets: ArrayLike, noise: float = 0.0
    ) -> FloatArray:
        """Most likely mesh (V, 3) when vertices (H,) are known to be at targets (H, 3).

        Raises:
            InputError: no vertices, repeated or unknown ones, targets of another shape, or a noise
                that is not a number of at least 0.
        """
        V = len(self.basis.origin)
        handles, positions, noise = checked_handles(vertices, targets, V, noise)
        choice = self.choice(handles, noise)
        regression, _ = self._with_folds(choice.free)
        ridge = np.array([choice.penalty.ridge])
        placed = regression.fit(handles, positions[None], choice.penalty, ridge)
        return regression.decode(placed.first())[0]

    def choice(self, handles: IntArray, noise: float = 0.0) -> HandleChoice:
        """Place and penalty for handles (H,), chosen once for each set of them and each noise."""
        key = (noise, *handles.tolist())
        if key not in self._choices:
            found = []
            for free in (False, True) if len(handles) >= _LEAST_FREE else (False,):
                _, folds = self._with_folds(free)
                penalty, error = choose_penalty(folds, handles, noise)
                found.append((HandleChoice(free, penalty), error))
            self._choices[key] = min(found, key=lambda entry: entry[1])[0]
        return self._choices[key]

    def _with_folds(self, free: bool) -> tuple[HandleRegression, list[HandleRegression]]:
        """The regression of all training shapes, and those that leave out a fold."""
        if free not in self._regressions:
            V, reference = self._shapes.vertices, self._shapes.mesh(0)
            placed = align(V, reference.vertices) if free else V
            group = np.arange(len(V)) % min(_FOLDS, len(V))

            def regression(kept: NDArray, basis: LinearBasis | None = None) -> HandleRegression:
                K = len(self.basis.components)
                basis = basis or self.fit_basis(placed[kept], reference, K, self._seed)
                return HandleRegression(basis, placed[kept], V[~kept], free)

            everything = regression(group >= 0, None if free else self.basis)
            folds = [regression(group != g) for g in range(group.max() + 1)]
            self._regressions[free] = everything, folds
        return self._regressions[free]
