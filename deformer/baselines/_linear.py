"""What all methods share whose shapes are an origin plus codes times components."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from deformer.baselines._linear_basis import (
    HandleRegression,
    LinearBasis,
    Penalty,
    choose_penalty,
)
from deformer.baselines.method import Space
from deformer.errors import InputError
from deformer.mesh import FloatArray, IntArray, Mesh, MeshSequence

# Groups of training shapes that are left out in turn, at most.
_GROUPS = 4


class LinearMethod(ABC):
    """A method on positions whose decoder is linear; a subclass learns the basis.

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
    def learn(
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
        self._basis = self.learn(shapes.vertices, shapes.mesh(0), components, seed)
        self._regression: HandleRegression | None = None
        self._left_out: list[HandleRegression] = []
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
        return self.basis.encode(self._checked(vertices))

    def fit_codes(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) whose decoded vertices come closest to shapes (N, V, 3): least squares."""
        return self.basis.project(self._checked(vertices))

    def decode(self, codes: ArrayLike) -> FloatArray:
        """Shapes (N, V, 3) of codes (N, K)."""
        z = np.asarray(codes, dtype=np.float64)
        K = len(self.basis.components)
        if z.ndim != 2 or z.shape[1] != K:
            raise InputError(f"codes: expected an array of shape (N, {K}), got {z.shape}")
        return self.basis.decode(z)

    def fit_handles(self, vertices: ArrayLike, targets: ArrayLike) -> FloatArray:
        """The mesh (V, 3) when only vertices (H,) are known to lie at targets (H, 3).

        Raises:
            InputError: no, repeated or unknown vertices, or targets of another shape.
        """
        handles, positions = _check_handles(vertices, targets, len(self.basis.origin))
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
            if not self._left_out:
                self._left_out = self._leave_out()
            self._penalties[key] = choose_penalty(self._left_out, handles)
        return self._penalties[key]

    def _leave_out(self) -> list[HandleRegression]:
        V, reference = self._shapes.vertices, self._shapes.mesh(0)
        group = np.arange(len(V)) % min(_GROUPS, len(V))
        regressions = []
        for g in range(group.max() + 1):
            kept, left = V[group != g], V[group == g]
            basis = self.learn(kept, reference, len(self.basis.components), self._seed)
            regressions.append(HandleRegression(basis, kept, left))
        return regressions

    def _checked(self, vertices: ArrayLike) -> FloatArray:
        X = np.asarray(vertices, dtype=np.float64)
        V = len(self.basis.origin)
        if X.ndim != 3 or X.shape[1:] != (V, 3):
            raise InputError(f"vertices: expected an array of shape (N, {V}, 3), got {X.shape}")
        if not np.isfinite(X).all():
            raise InputError("vertices: expected finite positions")
        return X


def _check_handles(
    vertices: ArrayLike, targets: ArrayLike, vertex_count: int
) -> tuple[IntArray, FloatArray]:
    handles = np.asarray(vertices)
    positions = np.asarray(targets, dtype=np.float64)
    if handles.ndim != 1 or len(handles) == 0 or not np.issubdtype(handles.dtype, np.integer):
        raise InputError(
            f"vertices: expected at least one vertex index (H,), got {handles.dtype} "
            f"of shape {handles.shape}"
        )
    if positions.shape != (len(handles), 3) or not np.isfinite(positions).all():
        raise InputError(
            f"targets: expected finite positions of shape {(len(handles), 3)}, "
            f"got shape {positions.shape}"
        )
    bad = handles[(handles < 0) | (handles >= vertex_count)]
    if len(bad):
        raise InputError(
            f"vertex {bad[0]} does not exist; the mesh has vertices 0…{vertex_count - 1}"
        )
    values, counts = np.unique(handles, return_counts=True)
    if counts.max() > 1:
        raise InputError(f"vertex {values[counts.argmax()]} is given twice; name each once")
    return handles.astype(np.int64), positions
