"""How closely handle fits follow handles: what recovers training shapes left out best."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from deformer.geometry import FloatArray, Geodesics, IntArray, MeshSequence, farthest_points

# (vertices, targets, noises) to a mesh (V, 3) for every noise, the largest first.
HandleFit = Callable[[IntArray, FloatArray, Sequence[float]], Iterable[FloatArray]]
# Handle fit of components that were learned from a few of the training shapes, given by index.
Learn = Callable[[IntArray], HandleFit]

_LEFT_OUT = 3
_COUNTS = (10, 40)


def choose_noise(
    learn: Learn, shapes: MeshSequence, geodesics: Geodesics, choices: Sequence[float], seed: int
) -> float:
    """The noise by which shapes left out are recovered best, see `recovery_errors`.

    With fewer than 4 shapes none can be left out, and the middle of the choices is taken.
    """
    errors = recovery_errors(learn, shapes, geodesics, choices, seed)
    return choices[len(choices) // 2 if errors is None else int(errors.argmin())]


def recovery_errors(
    learn: Learn, shapes: MeshSequence, geodesics: Geodesics, choices: Sequence[float], seed: int
) -> FloatArray | None:
    """How well shapes left out are recovered from a few of their vertices, by noise.

    Three shapes spread over the training shapes are left out (fewer of less than 12), and
    recovered from 10 and from 40 control vertices. The reference, shape 0, is never left out.

    Args:
        learn: learns from the shapes that are kept.
        shapes: the training shapes.
        geodesics: of the reference.
        choices: noises, in increasing order.
        seed: of the first control vertex.

    Returns:
        For every noise the logarithm of the error's root mean square, the mean over the two
        numbers of control vertices; None where fewer than 4 shapes leave none to spare.
    """
    N, V = shapes.vertices.shape[:2]
    count = _left_out(N)
    if count == 0:
        return None
    left: IntArray = 1 + (np.arange(count) * (N - 1)) // count + (N - 1) // (2 * count)
    fit = learn(np.setdiff1d(np.arange(N), left))
    errors = np.zeros(len(choices))
    for control_count in _COUNTS:
        control = farthest_points(geodesics, min(control_count, V), seed)
        squares = np.zeros(len(choices))
        for shape in shapes.vertices[left]:
            found = fit(control, shape[control], choices[::-1])
            squares += [((mesh - shape) ** 2).mean() / count for mesh in found]
        errors += 0.5 * np.log(np.maximum(squares, np.finfo(float).tiny)) / len(_COUNTS)
    return errors[::-1]


def recoveries(shape_count: int) -> int:
    """How many handle fits `recovery_errors` makes for every noise."""
    return len(_COUNTS) * _left_out(shape_count)


def _left_out(shape_count: int) -> int:
    return min(_LEFT_OUT, shape_count // 4)


def one_by_one(fit: Callable[[IntArray, FloatArray, float], FloatArray]) -> HandleFit:
    """A handle fit that gains nothing from several noises at a time."""
    return lambda vertices, targets, noises: (fit(vertices, targets, n) for n in noises)
