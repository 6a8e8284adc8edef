"""Cross-validation of handle fits: errors of held-out shapes recovered from a few vertices."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from deformer.geometry import (
    FloatArray,
    Geodesics,
    IntArray,
    MeshSequence,
    farthest_points,
    sted_spatial,
)
from deformer.model import HANDLE_COUNTS

# (vertices (H,), targets (H, 3), noises or misfits, the largest first) → positions (V, 3) for each.
HandleFit = Callable[[IntArray, FloatArray, Sequence[float]], Iterable[FloatArray]]
# Indices (n,) of the shapes to train on → handle fits of the model trained on them.
TrainOnSubset = Callable[[IntArray], HandleFit]

_HELD_OUT = 3
_CONTROL_COUNTS = (10, 40)
# With fewer shapes than this, single ones are held out in turn, at most so many.
MANY, _MOST_TURNS = 12, 5


def choose_noise(
    train: TrainOnSubset,
    shapes: MeshSequence,
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
    shapes: MeshSequence,
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
    N, V = shapes.vertices.shape[:2]
    count = _held_out_count(N)
    held_out: IntArray = 1 + _spread(N - 1, count)
    fit = train(np.setdiff1d(np.arange(N), held_out))
    errors = np.zeros(len(noises))
    for control_count in _CONTROL_COUNTS:
        control = farthest_points(geodesics, min(control_count, V), seed)
        squares = np.zeros(len(noises))
        for shape in shapes.vertices[held_out]:
            poses = fit(control, shape[control], noises[::-1])
            squares += [((pose - shape) ** 2).mean() / count for pose in poses]
        errors += 0.5 * np.log(np.maximum(squares, np.finfo(float).tiny)) / len(_CONTROL_COUNTS)
    return errors[::-1]


def held_out_turns(shape_count: int) -> list[IntArray]:
    """Indices of the shapes that `misfit_errors` holds out in each turn.

    Three shapes spread over the training shapes; of fewer than 12 a single one each turn, since
    what is left must come near to all of them.
    """
    others = np.arange(1, shape_count)
    if shape_count >= MANY:
        return [others[_spread(shape_count - 1, _HELD_OUT)]]
    if len(others) < 2:
        return []
    return [others[[n]] for n in _spread(len(others), min(len(others), _MOST_TURNS))]


def misfit_errors(
    train: TrainOnSubset,
    shapes: MeshSequence,
    geodesics: Geodesics,
    misfits: Sequence[float],
    turn: int,
) -> FloatArray:
    """Errors of held-out shapes in position and in stretch, by misfit.

    As `held_out_errors`, but with the shapes of one of `held_out_turns`, from `HANDLE_COUNTS`
    control vertices, which differ between turns.

    Args:
        train, shapes, geodesics: as there.
        misfits: M candidates, in increasing order, in bounding diagonals.
        turn: index into `held_out_turns`.

    Returns:
        (2, M) means of the logarithms of the root mean square error and of the edges' deviation
        (`geometry.sted_spatial`), from few and from many vertices.
    """
    N, V = shapes.vertices.shape[:2]
    held_out = held_out_turns(N)[turn]
    fit = train(np.setdiff1d(np.arange(N), held_out))
    found = np.zeros((len(HANDLE_COUNTS), len(misfits)))
    for errors, count in zip(found, HANDLE_COUNTS, strict=True):
        control = farthest_points(geodesics, min(count, V), turn)
        for shape in shapes.vertices[held_out]:
            poses = fit(control, shape[control], misfits[::-1])
            errors += [_log_error(shape, pose, shapes.faces) / len(held_out) for pose in poses]
    return found[:, ::-1]


def _log_error(shape: FloatArray, pose: FloatArray, faces: IntArray) -> float:
    """Mean of the logarithms of the root mean square error and of the edges' deviation."""
    square = float(((pose - shape) ** 2).mean())
    stretch = sted_spatial(shape, pose, faces)
    tiny = np.finfo(float).tiny
    return 0.25 * float(np.log(max(square, tiny))) + 0.5 * float(np.log(max(stretch, tiny)))


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
