"""Where shapes stand as a whole: how far training shapes are turned and moved against their codes.

Features hold the rotation of a shape's parts and no position. Where examples stand follows from
their pose to a great part (a wrist that never moves, feet on the floor), which is learned as
a linear function of the code. What is left between a decoded shape and the example it stands for is
a small rigid motion, whose size tells whether a handle that moves should take the whole body along.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deformer.geometry import FloatArray, procrustes, rotation_to_log

# What is believed before any example is seen (rad, diagonals), and how many examples that is worth.
_BELIEVED, _COUNT = 0.01, 1
# Ridges of the regression on codes, against its largest squared singular value; the last is none.
_RIDGES = (*np.logspace(-8, 0, 9), np.inf)
# How unlikely it is before any handle is seen that a shape stands somewhere else altogether.
_ELSEWHERE = 0.01


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a shape stands: its centroid at offset + gain z, moved by a small rigid motion.

    Args:
        rotation: standard deviation of the rigid motion's rotation vector, per axis, in radians.
        translation: of its translation, in bounding diagonals of the reference.
        offset: (3,) in bounding diagonals from the reference's centroid; None is 0.
        gain: (3, K); None is 0.
    """

    rotation: float
    translation: float
    offset: FloatArray | None = None
    gain: FloatArray | None = None

    def at(self, z: FloatArray) -> FloatArray:
        """Centroids (..., 3) of codes (..., K), in diagonals from the reference's centroid."""
        if self.offset is None or self.gain is None:
            return np.zeros((*z.shape[:-1], 3))
        return self.offset + z @ self.gain.T

    @property
    def deviations(self) -> dict[str, float]:
        """By the names of the arguments."""
        return {"rotation": self.rotation, "translation": self.translation}

    @property
    def arrays(self) -> dict[str, FloatArray]:
        """Offset and gain by the names of the arguments, where there are any."""
        every = {"offset": self.offset, "gain": self.gain}
        return {name: array for name, array in every.items() if array is not None}

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


def fit_placement(
    codes: ArrayLike, decoded: ArrayLike, shapes: ArrayLike, diagonal: float
) -> Placement:
    """Placement of training shapes (N, V, 3) against their decoded codes.

    Args:
        codes: (N, K).
        decoded: (N, V, 3), with their centroids at the reference's.
        shapes: as they stand.
        diagonal: bounding diagonal of the reference.
    """
    turns, moves = [], []
    for a, b in zip(np.asarray(decoded), np.asarray(shapes), strict=True):
        R, _ = procrustes(a, b)
        turns.append(rotation_to_log(R))
        moves.append((b.mean(axis=0) - a.mean(axis=0)) / diagonal)
    offset, gain, left = _regression(np.asarray(codes, dtype=np.float64), np.array(moves))
    rotation, translation = (
        float(np.sqrt(((np.square(x).mean(axis=1)).sum() + _COUNT * _BELIEVED**2) / n))
        for x, n in ((turns, len(turns) + _COUNT), (left, len(left) + _COUNT))
    )
    return Placement(min(rotation, FREE.rotation), min(translation, FREE.translation), offset, gain)


def _regression(codes: FloatArray, moves: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Offset (3,) and gain (3, K) of moves (N, 3), and what they leave (N, 3) of one left out.

    Ridge regression; the ridge is that which leaves least.
    """
    mean = codes.mean(axis=0)
    U, s, Vt = np.linalg.svd(codes - mean, full_matrices=False)
    centred = moves - moves.mean(axis=0)
    found = []
    for ridge in _RIDGES:
        share = np.divide(s**2, s**2 + ridge * s[0] ** 2, out=np.zeros_like(s), where=s > 0)
        residual = centred - U @ (share[:, None] * (U.T @ centred))
        influence = 1.0 / len(codes) + (U**2) @ share
        left = residual / np.maximum(1.0 - influence, 1e-9)[:, None]
        slope = np.divide(share, s, out=np.zeros_like(s), where=s > 0)
        found.append((float((left**2).sum()), (Vt.T * slope @ (U.T @ centred)).T, left))
    _, gain, left = min(found, key=lambda entry: entry[0])
    return moves.mean(axis=0) - gain @ mean, gain, left
