"""Where shapes stand as a whole: how far training shapes are turned and moved against their codes.

Features hold the rotation of a shape's parts and no position. What is left between a decoded shape
and the example it stands for is a small rigid motion, whose size tells whether a handle that moves
should take the whole body along.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deformer.mesh import FloatArray
from deformer.rotations import procrustes, rotation_to_log

# What is believed before any example is seen (rad, diagonals), and how many examples that is worth.
_BELIEVED, _COUNT = 0.01, 1
# How unlikely it is before any handle is seen that a shape stands somewhere else altogether.
_ELSEWHERE = 0.01


@dataclass(frozen=True)
class Placement:
    """Standard deviations of rigid motions about the reference's centroid, per axis.

    Args:
        rotation: radians.
        translation: bounding diagonals of the reference.
    """

    rotation: float
    translation: float

    def stiffness(self, share: float = 1.0) -> FloatArray:
        """Weights (6,) of a squared rotation vector and translation; `share` scales deviations."""
        scales = np.repeat([self.rotation, self.translation], 3)
        return np.asarray((share * scales) ** -2.0)

    @property
    def log_volume(self) -> float:
        """Twice the logarithm of the deviations' product: what a density this wide gives away."""
        return 6.0 * float(np.log(self.rotation) + np.log(self.translation))


# Anywhere: about a sixth of a turn, one bounding diagonal.
FREE = Placement(0.3, 1.0)


def surprise(placement: Placement) -> float:
    """Energy that it costs to stand anywhere and not where `placement` has it."""
    odds = 2.0 * float(np.log((1.0 - _ELSEWHERE) / _ELSEWHERE))
    return odds + FREE.log_volume - placement.log_volume


def fit_placement(decoded: ArrayLike, shapes: ArrayLike, diagonal: float) -> Placement:
    """Placement of training shapes (N, V, 3) against their decoded codes (N, V, 3).

    Args:
        decoded: with their centroids at the reference's.
        shapes: as they stand.
        diagonal: bounding diagonal of the reference.
    """
    turns, moves = [], []
    for a, b in zip(np.asarray(decoded), np.asarray(shapes), strict=True):
        R, _ = procrustes(a, b)
        turns.append(rotation_to_log(R))
        moves.append((b.mean(axis=0) - a.mean(axis=0)) / diagonal)
    rotation, translation = (
        float(np.sqrt(((np.square(x).mean(axis=1)).sum() + _COUNT * _BELIEVED**2) / n))
        for x, n in ((turns, len(turns) + _COUNT), (moves, len(moves) + _COUNT))
    )
    return Placement(min(rotation, FREE.rotation), min(translation, FREE.translation))
