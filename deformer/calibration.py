"""How closely handle fits follow handles: what recovers training shapes left out best."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from deformer.geodesics import Geodesics, farthest_points
from deformer.mesh import FloatArray, IntArray, MeshSequence

# (vertices, targets, noise) to a mesh (V, 3).
HandleFit = Callable[[IntArray, FloatArray, float], FloatArray]
# Handle fit of components that were learned from a few of the training shapes, given by index.
Learn = Callable[[IntArray], HandleFit]

_LEFT_OUT = 3
_COUNTS = (10, 40)


def choose_noise(
    learn: Learn, shapes: MeshSequence, geodesics: Geodesics, choices: Sequence[float], seed: int
) -> float:
    """The noise by which shapes left out are recovered best from a few of their vertices.

    Three shapes spread over the training shapes are left out (fewer of less than 12), and
    recovered from 10 and from 40 control vertices. The reference, shape 0, is never left out.
    With fewer than 4 shapes none can be spared, and the middle of the choices is taken.

    Args:
        learn: learns from the shapes that are kept.
        shapes: the training shapes.
        geodesics: of the reference.
        choices: in increasing order.
        seed: of the first control vertex.
    """
    N, V = shapes.vertices.shape[:2]
    count = min(_LEFT_OUT, N // 4)
    if count == 0:
        return choices[len(choices) // 2]
    left: IntArray = 1 + (np.arange(count) * (N - 1)) // count + (N - 1) // (2 * count)
    fit = learn(np.setdiff1d(np.arange(N), left))
    score = np.zeros(len(choices))
    for control_count in _COUNTS:
        control = farthest_points(geodesics, min(control_count, V), seed)
        for c, noise in enumerate(choices):
            square = 0.0
            for shape in shapes.vertices[left]:
                square += float(((fit(control, shape[control], noise) - shape) ** 2).sum())
            score[c] += np.log(max(square, np.finfo(float).tiny))
    return choices[int(score.argmin())]
