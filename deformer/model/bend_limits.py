"""Limits of the rotation between neighbouring parts: a knee bends one way only.

A Gaussian prior is symmetric about its mean: it penalises a bend in a direction that no example
shows no more than one in the opposite direction that all examples show. Bend limits therefore
measure the rotation between neighbouring sample vertices, to first order a linear function of the
code, and a fit penalises bends outside the range of the examples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from deformer.checks import LARGEST, checked_array
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray

if TYPE_CHECKING:
    from deformer.geometry import Geodesics
    from deformer.network import Decoder

# Number of sample vertices, and of nearest samples that each is compared with.
SAMPLES = 96
_NEIGHBOURS = 6
# The slack of a bend: a factor on its standard deviation among the examples, and the least (rad).
_SLACK_FACTOR, _LEAST_SLACK = 1.0, 0.02
# Codes whose bends are in memory at once.
_CODES = 1000


@dataclass(frozen=True, eq=False)
class BendLimits:
    """Range of the M bends D z of codes z among the examples.

    Args:
        directions: D (M, K), derivative of the bends with respect to the code, radians.
        low, high: (M,) least and greatest bend among the examples, radians.
        slack: (M,) excess that costs as much as one standard deviation of the prior, radians.

    Raises:
        InputError: other shapes, numbers that are not finite, a slack that is not positive, or a
            `low` above its `high`.
    """

    directions: FloatArray
    low: FloatArray
    high: FloatArray
    slack: FloatArray

    def __post_init__(self) -> None:
        """Check the numbers."""
        M = len(self.directions)
        for name, array in self.arrays.items():
            shape = (M, "K") if name == "directions" else (M,)
            checked_array(array, f"bend_limits_{name}", shape, largest=LARGEST)
        bad = np.flatnonzero(~(self.slack > 0) | (self.low > self.high))
        if len(bad):
            raise InputError(
                f"bend_limits: bend {bad[0]} has range {self.low[bad[0]]:g}…{self.high[bad[0]]:g} "
                f"and slack {self.slack[bad[0]]:g}, expected low ≤ high and slack > 0; retrain"
            )

    def excess(self, z: FloatArray) -> FloatArray:
        """Excess (..., M) of the bends of codes z (..., K) over the range, in slacks; 0 inside."""
        bends = z @ self.directions.T
        return np.asarray((bends - np.clip(bends, self.low, self.high)) / self.slack)

    def including(self, z: FloatArray) -> BendLimits:
        """Limits that also have the bends of a code z (K,) within their range."""
        bends = self.directions @ z
        low, high = np.minimum(self.low, bends), np.maximum(self.high, bends)
        return replace(self, low=low, high=high)

    @property
    def arrays(self) -> dict[str, FloatArray]:
        """All arrays by the names of the arguments."""
        names = ("directions", "low", "high", "slack")
        return {name: getattr(self, name) for name in names}


def choose_samples(geodesics: Geodesics, count: int = SAMPLES) -> tuple[IntArray, IntArray]:
    """Sample vertices spread over the mesh, and pairs of neighbours among them.

    Args:
        geodesics: distances over the mesh of V vertices.
        count: number of samples, unless V is less.

    Returns:
        Vertices (n,), and pairs (m, 2) of indices into them.
    """
    from deformer.geometry import farthest_points

    samples = farthest_points(geodesics, min(count, len(geodesics.mesh.vertices)), 0)
    distances = np.array([geodesics.row(int(v))[samples] for v in samples])
    np.fill_diagonal(distances, np.inf)
    near = np.argsort(distances, axis=1, kind="stable")[:, :_NEIGHBOURS]
    first = np.repeat(np.arange(len(samples)), near.shape[1])
    connected = np.isfinite(distances[first, near.ravel()])
    pairs = np.sort(np.stack([first, near.ravel()], axis=1)[connected], axis=1)
    return samples, np.unique(pairs, axis=0)


def fit_bend_limits(
    decoder: Decoder, pairs: IntArray, mean: FloatArray, codes: FloatArray
) -> BendLimits:
    """Bend limits from the range of bends among the examples.

    Args:
        decoder: restricted to the n sample vertices.
        pairs: (m, 2) pairs of samples, whose M = 3 m differences of rotation vectors are the bends.
        mean: (K,) code about which bends are linearised.
        codes: (N, K) of the examples and, if the model learned from them, of their mirror images.
    """
    _, dq = decoder.differential(mean)
    dr = dq[:, :, :3]
    differences = dr[:, pairs[:, 0]] - dr[:, pairs[:, 1]]
    directions = np.ascontiguousarray(differences.reshape(len(differences), -1).T)
    # The deviation of D z from the covariance of z, so that few bends are in memory at a time.
    centred = codes - codes.mean(axis=0)
    variance = np.einsum("mk,kl,ml->m", directions, centred.T @ centred / len(codes), directions)
    slack = np.hypot(_SLACK_FACTOR * np.sqrt(np.maximum(variance, 0.0)), _LEAST_SLACK)
    low, high = np.full(len(directions), np.inf), np.full(len(directions), -np.inf)
    for start in range(0, len(codes), _CODES):
        bends = codes[start : start + _CODES] @ directions.T
        low, high = np.minimum(low, bends.min(axis=0)), np.maximum(high, bends.max(axis=0))
    return BendLimits(directions, low, high, slack)
