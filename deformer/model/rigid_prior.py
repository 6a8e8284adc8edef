"""The prior of rigid motions: where training shapes are as a whole, given their codes.

Features contain the rotations of a shape's parts and no position. The position of a training shape
follows from its pose to a great part (a wrist that never moves, feet on the floor): its centroid is
learned as a linear function of the code. A small rigid motion remains between the decoded and the
training shape. Its size tells whether a handle that moves should move the whole body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deformer.geometry import FloatArray

# Deviation assumed before any example is seen (rad, diagonals), and the examples it counts as.
_ASSUMED, _COUNT = 0.01, 1
# Candidate ridges of the regression on codes, relative to its largest squared singular value; the
# infinite one leaves the codes out.
_RIDGES = (*np.logspace(-8, 0, 9), np.inf)
# Probability, before any handle is seen, that a shape is somewhere else altogether.
_ELSEWHERE = 0.01


@dataclass(frozen=True, eq=False)
class RigidPrior:
    """Where a shape of code z is: its centroid at offset + gain z, then a small rigid motion.

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

    def centroid(self, z: FloatArray) -> FloatArray:
        """Centroids (..., 3) of codes (..., K), in diagonals from the reference's centroid."""
        if self.offset is None or self.gain is None:
            return np.zeros((*z.shape[:-1], 3))
        return self.offset + z @ self.gain.T

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations by the names of the arguments."""
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
        """Twice the logarithm of the product of all six deviations."""
        return 6.0 * float(np.log(self.rotation) + np.log(self.translation))


# Anywhere: about a sixth of a turn, one bounding diagonal.
FREE = RigidPrior(0.3, 1.0)


def cost_of_freedom(prior: RigidPrior) -> float:
    """Energy of the prior `FREE` over that of `prior`: −2 log of odds and ratio of densities."""
    odds = 2.0 * float(np.log((1.0 - _ELSEWHERE) / _ELSEWHERE))
    return odds + FREE.log_volume - prior.log_volume


def fit_rigid_prior(
    codes: ArrayLike, decoded: ArrayLike, shapes: ArrayLike, diagonal: float
) -> RigidPrior:
    """The rigid motions of training shapes against their decoded codes.

    Args:
        codes: (N, K).
        decoded: (N, V, 3), with their centroids at the reference's.
        shapes: (N, V, 3), the training shapes.
        diagonal: bounding diagonal of the reference.
    """
    # numba, which these need, takes as long to import as all else; a model is used without it.
    from deformer.geometry import procrustes, rotation_to_log

    turns, moves = [], []
    for a, b in zip(np.asarray(decoded), np.asarray(shapes), strict=True):
        R, _ = procrustes(a, b)
        turns.append(rotation_to_log(R))
        moves.append((b.mean(axis=0) - a.mean(axis=0)) / diagonal)
    offset, gain, left = _regression(np.asarray(codes, dtype=np.float64), np.array(moves))
    rotation, translation = (
        float(np.sqrt(((np.square(x).mean(axis=1)).sum() + _COUNT * _ASSUMED**2) / n))
        for x, n in ((turns, len(turns) + _COUNT), (left, len(left) + _COUNT))
    )
    return RigidPrior(
        min(rotation, FREE.rotation), min(translation, FREE.translation), offset, gain
    )


def _regression(codes: FloatArray, moves: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Offset (3,) and gain (3, K) of moves (N, 3), and leave-one-out residuals (N, 3).

    Ridge regression, with the ridge of the smallest leave-one-out error.
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
