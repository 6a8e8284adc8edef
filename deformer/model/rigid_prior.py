"""The prior of rigid motions: position and orientation of training shapes, given their codes.

Features contain the rotations of a shape's parts but no position. A training shape's pose largely
determines its position (a wrist never moves, feet are on the floor): its centroid is learned as a
linear function of the code. A small rigid motion remains between the decoded and the training
shape; its standard deviation decides how far a moved handle moves the whole body.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import LARGEST, checked_array, checked_number
from deformer.errors import InputError
from deformer.geometry import FloatArray
from deformer.linalg import ridge_regressions

# Standard deviation assumed before any example is seen (rad, diagonals), and the number of examples
# that this assumption weighs as much as.
_ASSUMED_DEVIATION, _ASSUMED_COUNT = 0.01, 1
# Candidate ridges of the regression on codes, relative to its largest squared singular value; with
# the infinite one the centroid does not depend on the code.
_RIDGES = (*np.logspace(-8, 0, 9), np.inf)
# Prior probability that a shape's rigid motion follows `DIFFUSE_PRIOR` and not the training shapes.
_DIFFUSE_PROBABILITY = 0.01


@dataclass(frozen=True, eq=False)
class RigidPrior:
    """Distribution of a shape's rigid motion: centroid at offset + gain z, then a small motion.

    Args:
        rotation: standard deviation of the small motion's rotation vector, per axis, radians.
        translation: standard deviation of its translation, per axis, in bounding diagonals of the
            reference.
        offset: (3,) in bounding diagonals from the reference's centroid; None is 0.
        gain: (3, K) in bounding diagonals; None is 0.

    Raises:
        InputError: a deviation that is not positive, other shapes, or numbers that are not finite.
    """

    rotation: float
    translation: float
    offset: FloatArray | None = None
    gain: FloatArray | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name, deviation in self.deviations.items():
            checked_number(deviation, f"rigid_prior: {name}", above=0, most=LARGEST)
        if (self.offset is None) != (self.gain is None):
            raise InputError("rigid_prior: expected offset and gain, or neither, got one of them")
        for name, array in self.arrays.items():
            shape = (3,) if name == "offset" else (3, "K")
            checked_array(array, f"rigid_prior_{name}", shape, largest=LARGEST)

    def centroid(self, z: FloatArray) -> FloatArray:
        """Centroids (..., 3) of codes z (..., K), in diagonals from the reference's centroid."""
        if self.offset is None or self.gain is None:
            return np.zeros((*z.shape[:-1], 3))
        return self.offset + z @ self.gain.T

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations by the names of the arguments."""
        return {"rotation": self.rotation, "translation": self.translation}

    @property
    def arrays(self) -> dict[str, FloatArray]:
        """Offset and gain by the names of the arguments, without those that are None."""
        arrays = {"offset": self.offset, "gain": self.gain}
        return {name: array for name, array in arrays.items() if array is not None}

    def stiffness(self, share: float = 1.0) -> FloatArray:
        """Inverse variances (6,) of rotation vector and translation.

        Args:
            share: factor on the standard deviations.
        """
        scales = np.repeat([self.rotation, self.translation], 3)
        return np.asarray((share * scales) ** -2.0)

    @property
    def log_volume(self) -> float:
        """Twice the logarithm of the product of the six standard deviations."""
        return 6.0 * float(np.log(self.rotation) + np.log(self.translation))


# Nearly any rigid motion: standard deviations of about a twentieth of a turn and one bounding
# diagonal.
DIFFUSE_PRIOR = RigidPrior(0.3, 1.0)


def diffuse_prior_cost(prior: RigidPrior) -> float:
    """Energy of the mean motion under `DIFFUSE_PRIOR`, less its energy under `prior`.

    It is −2 log of two ratios: of the prior probabilities, `DIFFUSE_PRIOR` over `prior`, and of the
    peak densities.

    Args:
        prior: fitted to the training shapes.
    """
    odds = 2.0 * float(np.log((1.0 - _DIFFUSE_PROBABILITY) / _DIFFUSE_PROBABILITY))
    return odds + DIFFUSE_PRIOR.log_volume - prior.log_volume


def fit_rigid_prior(
    codes: ArrayLike,
    decoded: Iterable[FloatArray],
    shapes: Iterable[FloatArray],
    diagonal: float,
) -> RigidPrior:
    """Rigid prior from the rigid motions between decoded codes and training shapes.

    Args:
        codes: (N, K) codes of the training shapes.
        decoded: N shapes (V, 3) decoded from them, with their centroids at the reference's.
        shapes: the N training shapes (V, 3).
        diagonal: bounding diagonal of the reference.
    """
    # Both need numba, whose import takes as long as all others; using a model does not need them.
    from deformer.geometry import procrustes, rotation_to_log

    rotations, translations = [], []
    for a, b in zip(decoded, shapes, strict=True):
        R, _ = procrustes(a, b)
        rotations.append(rotation_to_log(R))
        translations.append((b.mean(axis=0) - a.mean(axis=0)) / diagonal)
    Z = np.asarray(codes, dtype=np.float64)
    offset, gain, residuals = _regression(Z, np.array(translations))
    rotation, translation = (
        shrunk_deviation(float(np.square(x).mean(axis=1).sum()), len(x))
        for x in (np.array(rotations), residuals)
    )
    return RigidPrior(
        min(rotation, DIFFUSE_PRIOR.rotation),
        min(translation, DIFFUSE_PRIOR.translation),
        offset,
        gain,
    )


def shrunk_deviation(squares: float, count: int) -> float:
    """Standard deviation by the sum of squares of so many examples, the assumed one among them."""
    total = squares + _ASSUMED_COUNT * _ASSUMED_DEVIATION**2
    return float(np.sqrt(total / (count + _ASSUMED_COUNT)))


def _regression(
    codes: FloatArray, translations: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ridge regression of translations (N, 3) on codes (N, K).

    The ridge is the least one whose leave-one-out error cannot be told from the smallest: the mean
    of the difference, shape by shape, is within its standard error. A smaller ridge puts the
    examples closer to where they were.

    Returns:
        Offset (3,), gain (3, K), and leave-one-out residuals (N, 3).
    """
    mean = codes.mean(axis=0)
    centred = translations - translations.mean(axis=0)
    found = list(ridge_regressions(codes - mean, centred, _RIDGES, centred=True, least=1e-9))
    errors = np.array([(left_out**2).sum(axis=1) for _, left_out in found])
    excess = errors - errors[errors.sum(axis=1).argmin()]
    spread = excess.std(axis=1, ddof=1) / np.sqrt(len(codes))
    slope, left_out = found[int((excess.mean(axis=1) <= spread).argmax())]
    return translations.mean(axis=0) - slope.T @ mean, slope.T, left_out
