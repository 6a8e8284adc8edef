"""Digits that enter the rest of a posed hand."""

from __future__ import annotations

import igl
import numpy as np
from numpy.typing import NDArray

from hand.rig import DIGITS, Hand, joints_of

MOST_INSIDE = 0.05  # share of a digit's outer vertices that may be inside: skin gives way


class Inspector:
    """Counts vertices of digits that are inside the rest of the hand."""

    def __init__(self, hand: Hand) -> None:
        """Find each digit's outer vertices, and the faces that do not belong to it."""
        self._parts = []
        for digit in DIGITS:
            bones = [hand.index[name] for name in joints_of(digit)]
            share = hand.weights[:, bones[1:]].sum(axis=1)
            outer = np.flatnonzero(hand.weights[:, bones[2:]].sum(axis=1) > 0.9)
            self._parts.append((outer, hand.faces[share[hand.faces].max(axis=1) < 0.5]))

    def inside(self, points: NDArray) -> float:
        """The largest share, over digits, of outer vertices inside the rest of the hand (V, 3)."""
        shares = []
        for outer, others in self._parts:
            winding = igl.fast_winding_number(points, others, points[outer])
            shares.append(float((winding > 0.5).mean()))
        return max(shares)
