"""How far neighbouring parts turn against each other: a knee bends one way only.

A Gaussian prior is the same on both sides of its mean, and a bend that no example shows costs it no
more than one that all of them show. So the rotation between marks that spread over the surface and
their neighbours, to first order a linear function of the code, is held within what the examples
show of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.geometry import FloatArray, Geodesics, IntArray, farthest_points
from deformer.network import Decoder

# Marks on the surface, and the nearest others that each is compared with.
MARKS = 96
_NEIGHBOURS = 6
# How far beyond the examples a bend goes for as much as one standard deviation of the prior: a
# factor on the bend's own deviation among the examples, and what is believed without any (rad).
_SLACK, _LEAST = 1.0, 0.02


@dataclass(frozen=True, eq=False)
class BendLimits:
    """Bends D z of a code z, in radians, and their range among the examples.

    Args:
        directions: D (M, K), derivative of the bends.
        low, high: (M,) range.
        slack: (M,) how far beyond it weighs as much as one standard deviation of the prior.
    """

    directions: FloatArray
    low: FloatArray
    high: FloatArray
    slack: FloatArray

    def beyond(self, z: FloatArray) -> FloatArray:
        """How far bends of codes (..., K) are outside, (..., M), in slacks; 0 inside."""
        bends = z @ self.directions.T
        return np.asarray((bends - np.clip(bends, self.low, self.high)) / self.slack)

    @property
    def arrays(self) -> dict[str, FloatArray]:
        """By the names of the arguments."""
        names = ("directions", "low", "high", "slack")
        return {name: getattr(self, name) for name in names}


def choose_marks(geodesics: Geodesics, count: int = MARKS) -> tuple[IntArray, IntArray]:
    """Vertices (n,) that spread over the mesh, and pairs (m, 2) of neighbours among them."""
    marks = farthest_points(geodesics, min(count, len(geodesics.mesh.vertices)), 0)
    apart = np.array([geodesics.row(int(v))[marks] for v in marks])
    np.fill_diagonal(apart, np.inf)
    near = np.argsort(apart, axis=1, kind="stable")[:, :_NEIGHBOURS]
    first = np.repeat(np.arange(len(marks)), near.shape[1])
    joined = np.isfinite(apart[first, near.ravel()])
    pairs = np.sort(np.stack([first, near.ravel()], axis=1)[joined], axis=1)
    return marks, np.unique(pairs, axis=0)


def fit_limits(
    decoder: Decoder, pairs: IntArray, mean: FloatArray, codes: FloatArray
) -> BendLimits:
    """Limits by the range of the examples' codes (N, K).

    Args:
        decoder: of the n marks.
        pairs: (m, 2) of marks to compare.
        mean: (K,) code about which bends are linear.
        codes: of examples and, where these are learned from, of their mirror images.
    """
    _, dq = decoder.differential(mean)
    turns = dq[:, :, :3]
    bends = turns[:, pairs[:, 0]] - turns[:, pairs[:, 1]]
    directions = np.ascontiguousarray(bends.reshape(len(bends), -1).T)
    shown = codes @ directions.T
    slack = np.hypot(_SLACK * shown.std(axis=0), _LEAST)
    return BendLimits(directions, shown.min(axis=0), shown.max(axis=0), slack)
