"""Cross-validation of handle fits: errors of held-out shapes recovered from a few vertices."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from deformer.geometry import (
    FloatArray,
    Geodesics,
    IntArray,
    ShapeSequence,
    farthest_points,
    sted_spatial,
)
from deformer.model import HANDLE_COUNTS
from deformer.parallel import run_to_end

# (vertices (H,), targets (H, 3), noises or misfits, the largest first) → positions (V, 3) for each.
HandleFit = Callable[[IntArray, FloatArray, Sequence[float]], Iterable[FloatArray]]
# Indices (n,) of the shapes to train on → handle fits of the model trained on them.
TrainOnSubset = Callable[[IntArray], HandleFit]

# Yields once a pose, and returns errors.
Errors = Generator[None, None, FloatArray]

_HELD_OUT = 3
_CONTROL_COUNTS = (10, 40)
# With fewer shapes than this, single ones are held out in turn, at most so many.
MANY, _MOST_TURNS = 12, 5


@dataclass(frozen=True, eq=False)
class Recovery:
    """Held-out shapes that are to be recovered from some of their vertices.

    Args:
        shapes: (n, V, 3).
        faces: (F, 3).
        control: (H,) the vertices that are given.
        stretch: true if errors are those of edges, too.
    """

    shapes: FloatArray
    faces: IntArray
    control: IntArray
    stretch: bool

    def errors(self, fit: HandleFit, values: Sequence[float]) -> Errors:
        """Logarithms (M,) of errors, for M noises or misfits.

        They are the root mean square over the shapes; or, with stretch, means of the logarithms of
        each shape's root mean square error and of its edges' deviation (`geometry.sted_spatial`).

        Args:
            fit: recovers a shape; it is given the values in reverse order.
            values: noises or misfits, in increasing order.
        """
        found = np.empty((len(self.shapes), len(values)))
        tiny = np.finfo(float).tiny
        for shape, row in zip(self.shapes, found, strict=True):
            poses = fit(self.control, shape[self.control], values[::-1])
            for m, pose in enumerate(poses):
                row[m] = ((pose - shape) ** 2).mean()
                if self.stretch:
                    deviation = sted_spatial(shape, pose, self.faces)
                    row[m] = np.sqrt(max(row[m], tiny)) * max(deviation, tiny)
                yield None
        if self.stretch:
            return 0.5 * np.log(np.maximum(found, tiny)).mean(axis=0)[::-1]
        return 0.5 * np.log(np.maximum(found.mean(axis=0), tiny))[::-1]


def choose_noise(
    train: TrainOnSubset,
    shapes: ShapeSequence,
    geodesics: Geodesics,
    noises: Sequence[float],
    seed: int,
) -> float:
    """The noise of the least error of held-out shapes; see `held_out_errors`.

    With fewer than 4 shapes none can be held out: the result is then the middle candidate.

    Args:
        train, shapes, geodesics, noises, seed: as in `held_out_errors`.
    """
    if not held_out_fits(len(shapes)):
        return noises[len(noises) // 2]
    return noises[int(held_out_errors(train, shapes, geodesics, noises, seed).argmin())]


def held_out_errors(
    train: TrainOnSubset,
    shapes: ShapeSequence,
    geodesics: Geodesics,
    noises: Sequence[float],
    seed: int,
) -> FloatArray:
    """Errors of held-out shapes that are recovered from a few of their vertices, by noise.

    Three shapes spread over the training shapes are held out (one for every four if there are fewer
    than 12), and recovered from 10 and from 40 control vertices. Shape 0, the reference, is never
    held out. There are at least 4 shapes (`held_out_fits`).

    Args:
        train: trains on the other shapes.
        shapes: N training shapes.
        geodesics: distances over the reference.
        noises: M candidates, in increasing order, in bounding diagonals.
        seed: seed of the first control vertex.

    Returns:
        (M,) logarithms of root mean square errors, averaged over the two numbers of control
        vertices.
    """
    fit = train(kept_for_noise(len(shapes)))
    cases = noise_recoveries(shapes, geodesics, seed)
    errors = [run_to_end(case.errors(fit, noises))[1] for case in cases]
    return np.mean(errors, axis=0)


def noise_recoveries(shapes: ShapeSequence, geodesics: Geodesics, seed: int) -> list[Recovery]:
    """What `held_out_errors` recovers, from few and from many vertices."""
    N, V = shapes.vertices.shape[:2]
    held_out = np.setdiff1d(np.arange(N), kept_for_noise(N))
    return [
        Recovery(
            shapes.vertices[held_out],
            shapes.faces,
            farthest_points(geodesics, min(count, V), seed),
            stretch=False,
        )
        for count in _CONTROL_COUNTS
    ]


def kept_for_noise(shape_count: int) -> IntArray:
    """Indices of the shapes that `held_out_errors` trains on."""
    held_out = 1 + _spread(shape_count - 1, _held_out_count(shape_count))
    return np.setdiff1d(np.arange(shape_count), held_out)


def held_out_turns(shape_count: int) -> list[IntArray]:
    """Indices of the shapes that `misfit_recoveries` holds out in each turn.

    Three shapes spread over the training shapes; of fewer than 12 a single one each turn, since
    what is left must come near to all of them.
    """
    others = np.arange(1, shape_count)
    if shape_count >= MANY:
        return [others[_spread(shape_count - 1, _HELD_OUT)]]
    if len(others) < 2:
        return []
    return [others[[n]] for n in _spread(len(others), min(len(others), _MOST_TURNS))]


def misfit_recoveries(shapes: ShapeSequence, geodesics: Geodesics, turn: int) -> list[Recovery]:
    """What one of `held_out_turns` recovers, from each number of `HANDLE_COUNTS` vertices.

    Its shapes are those of the turn, and its control vertices differ between turns.

    Args:
        shapes: N training shapes.
        geodesics: distances over the reference.
        turn: index into `held_out_turns`.
    """
    N, V = shapes.vertices.shape[:2]
    return [
        Recovery(
            shapes.vertices[held_out_turns(N)[turn]],
            shapes.faces,
            farthest_points(geodesics, min(count, V), turn),
            stretch=True,
        )
        for count in HANDLE_COUNTS
    ]


def _spread(count: int, chosen: int) -> IntArray:
    """Indices (chosen,) spread over 0 … count − 1."""
    return (np.arange(chosen) * count) // chosen + count // (2 * chosen)


def held_out_fits(shape_count: int) -> int:
    """Number of handle fits of `held_out_errors` for every noise, with `shape_count` shapes."""
    return len(_CONTROL_COUNTS) * _held_out_count(shape_count)


def _held_out_count(shape_count: int) -> int:
    return min(_HELD_OUT, shape_count // 4)


def fit_each_noise(fit: Callable[[IntArray, FloatArray, float], FloatArray]) -> HandleFit:
    """The `HandleFit` of a function `fit` of (vertices, targets, noise), positions (V, 3)."""
    return lambda vertices, targets, noises: (fit(vertices, targets, n) for n in noises)
