"""Limits of the rotation between neighbouring parts: a knee bends one way only.

A Gaussian prior is the same on both sides of its mean: a bend that no example shows costs no more
than one that all of them show. So sample vertices are spread over the surface, the rotation between
each and its neighbours (to first order a linear function of the code) is measured, and a fit pays
for bends beyond the range of the examples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from deformer.geometry import FloatArray, IntArray

if TYPE_CHECKING:
    from deformer.geometry import Geodesics
    from deformer.network import Decoder

# Sample vertices, and the nearest others that each is compared with.
SAMPLES = 96
_NEIGHBOURS = 6
# A bend this far beyond the examples costs as much as one standard deviation of the prior: a factor
# on the bend's own deviation among the examples, and the least slack (rad).
_SLACK, _LEAST = 1.0, 0.02


@dataclass(frozen=True, eq=False)
class BendLimits:
    """Bends D z of a code z, in radians, and their range among the examples.

    Args:
        directions: D (M, K), derivative of the bends with respect to the code.
        low, high: (M,) range among the examples.
        slack: (M,) excess that costs as much as one standard deviation of the prior.
    """

    directions: FloatArray
    low: FloatArray
    high: FloatArray
    slack: FloatArray

    def excess(self, z: FloatArray) -> FloatArray:
        """Excess (..., M) of the bends of codes (..., K) over their range, in slacks; 0 inside."""
        bends = z @ self.directions.T
        return np.asarray((bends - np.clip(bends, self.low, self.high)) / self.slack)

    @property
    def arrays(self) -> dict[str, FloatArray]:
        """All arrays by the names of the arguments."""
        names = ("directions", "low", "high", "slack")
        return {name: getattr(self, name) for name in names}


def choose_samples(geodesics: Geodesics, count: int = SAMPLES) -> tuple[IntArray, IntArray]:
    """Vertices (n,) that spread over the mesh, and pairs (m, 2) of neighbours among them."""
    from deformer.geometry import farthest_points

    samples = farthest_points(geodesics, min(count, len(geodesics.mesh.vertices)), 0)
    apart = np.array([geodesics.row(int(v))[samples] for v in samples])
    np.fill_diagonal(apart, np.inf)
    near = np.argsort(apart, axis=1, kind="stable")[:, :_NEIGHBOURS]
    first = np.repeat(np.arange(len(samples)), near.shape[1])
    joined = np.isfinite(apart[first, near.ravel()])
    pairs = np.sort(np.stack([first, near.ravel()], axis=1)[joined], axis=1)
    return samples, np.unique(pairs, axis=0)


def fit_bend_limits(
    decoder: Decoder, pairs: IntArray, mean: FloatArray, codes: FloatArray
) -> BendLimits:
    """Limits by the range of bends among the examples.

    Args:
        decoder: restricted to the n sample vertices.
        pairs: (m, 2) pairs of samples to compare.
        mean: (K,) code about which bends are linearised.
        codes: (N, K) of the examples and, if the model learned from them, of their mirror images.
    """
    _, dq = decoder.differential(mean)
    turns = dq[:, :, :3]
    bends = turns[:, pairs[:, 0]] - turns[:, pairs[:, 1]]
    directions = np.ascontiguousarray(bends.reshape(len(bends), -1).T)
    shown = codes @ directions.T
    slack = np.hypot(_SLACK * shown.std(axis=0), _LEAST)
    return BendLimits(directions, shown.min(axis=0), shown.max(axis=0), slack)
