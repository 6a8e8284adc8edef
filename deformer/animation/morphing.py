"""Sequences of shapes as a base and a few morph targets with weights that vary in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.checks import checked_number
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray

# Frames whose principal shapes are computed; of longer sequences so many, evenly spread.
_MOST_FRAMES = 2000
# Numbers that are computed at once.
_CHUNK = 8_000_000
# Eigenvalues below this share of the largest are rounding.
_ROUNDING = 1e-14
# Numbers of all targets: glTF files have sizes of 32 bits.
_MOST_NUMBERS = 1_000_000_000


@dataclass(frozen=True, eq=False)
class MorphTargets:
    """F shapes as base + Σ weight · target, in single precision.

    Weights are 0 to 1, for the sliders of programs such as Blender have no others. What would need
    negative ones is a target of its own, "offset", which has the weight 1 all the time.

    Args:
        base: (V, 3) the first shape.
        targets: (T, V, 3) displacements from the base.
        names: T names of the targets.
        weights: (F, T) of each shape, 0 to 1.
        error: largest distance of a vertex from its place in any of the shapes.
        principal: false if the targets are the shapes themselves.
    """

    base: FloatArray
    targets: np.ndarray
    names: tuple[str, ...]
    weights: FloatArray
    error: float
    principal: bool


def morph_targets(
    vertices: FloatArray, tolerance: float, names: tuple[str, ...] = ()
) -> MorphTargets:
    """The fewest principal shapes of a sequence that give it to a tolerance.

    They are the principal components of the displacements from the first shape, the strongest
    first. Where as many of them are needed as there are other shapes, the targets are these shapes.

    Args:
        vertices: (F, V, 3) the shapes.
        tolerance: the largest distance of a vertex from its place, in units of the data. Rounding
            to single precision comes on top.
        names: F names of the shapes, or none.

    Raises:
        InputError: the targets take more than a GLB file can hold.

    Source: Alexa and Müller, Representing Animations by Principal Components, 2000.
    """
    # A sequence that moves has a target, whatever the tolerance: a clip without one stands still.
    if not (vertices != vertices[0]).any():
        return MorphTargets(vertices[0], np.empty((0, *vertices.shape[1:]), np.float32), (),
                            np.zeros((len(vertices), 0)), 0.0, True)  # fmt: skip
    basis = _Basis(vertices)
    count = basis.fewest(tolerance)
    # The offset makes one more.
    if count is None or count + 1 >= len(vertices) - 1:
        return _frames(vertices, names)
    _check_room(count, vertices)
    targets, weights = basis.scaled(count)
    error = _largest_error(vertices, targets, weights)
    found = tuple(f"principal {n + 1}" for n in range(count))
    found += ("offset",) * (len(targets) - count)
    return MorphTargets(vertices[0], targets, found, weights, error, True)


def _frames(vertices: FloatArray, names: tuple[str, ...]) -> MorphTargets:
    """The shapes after the first one as targets."""
    _check_room(len(vertices) - 1, vertices)
    targets = np.empty((len(vertices) - 1, *vertices.shape[1:]), np.float32)
    for n, shape in enumerate(vertices[1:]):
        targets[n] = shape - vertices[0]
    weights = np.eye(len(vertices))[:, 1:]
    found = names[1:] or tuple(f"frame {n}" for n in range(1, len(vertices)))
    error = _largest_error(vertices, targets, weights)
    return MorphTargets(vertices[0], targets, found, weights, error, False)


class _Basis:
    """Orthonormal principal shapes of displacements from the first shape, in chunks of vertices."""

    def __init__(self, vertices: FloatArray) -> None:
        self._vertices = vertices
        F = len(vertices)
        self._rows: IntArray = np.unique(np.linspace(0, F - 1, min(F, _MOST_FRAMES)).astype(int))
        gram = np.zeros((len(self._rows), len(self._rows)))
        for block in _chunks(vertices):
            x = _displacements(vertices, block)[self._rows]
            gram += x @ x.T
        values, vectors = np.linalg.eigh(gram)
        kept = values > _ROUNDING * values[-1]
        # (B, R): the displacements of the B frames times this are the R principal shapes.
        self._mixture = (vectors[:, kept] / np.sqrt(values[kept]))[:, ::-1]
        self._coefficients = np.zeros((F, self._mixture.shape[1]))
        for block in _chunks(vertices):
            x = _displacements(vertices, block)
            self._coefficients += x @ (x[self._rows].T @ self._mixture)

    def fewest(self, tolerance: float) -> int | None:
        """Smallest number of principal shapes that keep the tolerance; None if none does."""
        rank = self._mixture.shape[1]
        low, high = 0, 1
        while high < rank and self._error(high) > tolerance:
            low, high = high, 2 * high
        high = min(high, rank)
        if self._error(high) > tolerance:
            return None
        # `high` keeps the tolerance, and `low` does not.
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self._error(middle) <= tolerance else (middle, high)
        return high

    def scaled(self, count: int) -> tuple[np.ndarray, FloatArray]:
        """Targets (T, V, 3) and weights (F, T) of 0 to 1; the offset, if there is one, is last."""
        V = self._vertices.shape[1]
        weights = self._coefficients[:, :count]
        low, high = weights.min(axis=0), weights.max(axis=0)
        flipped = -low > high
        sign = np.where(flipped, -1.0, 1.0)
        low, high = np.where(flipped, -high, low), np.where(flipped, -low, high)
        shift = bool((low < 0).any())
        targets = np.empty((count + shift, V, 3), np.float32)
        for block in _chunks(self._vertices):
            shapes = self._shapes(_displacements(self._vertices, block), count) * sign[:, None]
            targets[:count, block] = (shapes * (high - low)[:, None]).reshape(count, -1, 3)
            if shift:
                targets[-1, block] = (low @ shapes).reshape(-1, 3)
        found = np.ones((len(weights), count + shift))
        found[:, :count] = (weights * sign - low) / (high - low)
        return targets, found

    def _shapes(self, x: FloatArray, count: int) -> FloatArray:
        return self._mixture[:, :count].T @ x[self._rows]

    def _error(self, count: int) -> float:
        """Largest distance of a vertex with the first principal shapes."""
        worst = 0.0
        for block in _chunks(self._vertices):
            x = _displacements(self._vertices, block)
            x = x - self._coefficients[:, :count] @ self._shapes(x, count)
            worst = max(worst, _longest(x))
        return worst


def _chunks(vertices: FloatArray) -> list[slice]:
    """Ranges of vertices whose positions in all shapes are not too many."""
    F, V = vertices.shape[:2]
    step = max(1, _CHUNK // (3 * F))
    return [slice(start, start + step) for start in range(0, V, step)]


def _displacements(vertices: FloatArray, block: slice) -> FloatArray:
    """Displacements (F, 3n) of a range of vertices from the first shape."""
    return (vertices[:, block] - vertices[0, block]).reshape(len(vertices), -1)


def _largest_error(vertices: FloatArray, targets: np.ndarray, weights: FloatArray) -> float:
    """Largest distance of a vertex as single precision has base, targets and weights."""
    stored = weights.astype(np.float32).astype(np.float64)
    worst = 0.0
    for block in _chunks(vertices):
        base = vertices[0, block].astype(np.float32).astype(np.float64)
        found = stored @ targets[:, block].reshape(len(targets), -1).astype(np.float64)
        worst = max(worst, _longest((vertices[:, block] - base).reshape(len(vertices), -1) - found))
    return worst


def _longest(x: FloatArray) -> float:
    """Length of the longest vector of rows (F, 3n)."""
    return float(np.sqrt((x.reshape(-1, 3) ** 2).sum(axis=1).max()))


def _check_room(count: int, vertices: FloatArray) -> None:
    if count * vertices[0].size > _MOST_NUMBERS:
        raise InputError(
            f"shapes: {count} morph targets of {vertices.shape[1]} vertices are more than a GLB "
            "file can hold; allow a larger tolerance, or write a point cache (.mdd, .pc2)"
        )


def diagonal(vertices: FloatArray) -> float:
    """Bounding-box diagonal of a shape (V, 3)."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def checked_tolerance(tolerance: float) -> float:
    """A share of the diagonal, 0 or more; InputError for anything else."""
    return checked_number(tolerance, "tolerance", least=0, remedy="give a share of the diagonal")
