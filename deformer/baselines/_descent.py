"""Levenberg–Marquardt on any sum of squares that can say its own damped step."""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np

from deformer.geometry import FloatArray


class Point(Protocol):
    """Unknowns with the energy there."""

    value: float

    def step(self, damping: float) -> FloatArray:
        """Damped Gauss–Newton step of the unknowns."""
        ...

    def moved(self, step: FloatArray) -> Point:
        """The point that a step leads to."""
        ...


def damped_step(H: FloatArray, gradient: FloatArray, damping: float) -> FloatArray:
    """Step (n,) that solves (H + damping · diag H) step = −gradient for a dense H (n, n)."""
    step = np.linalg.solve(H + damping * np.diag(np.diag(H)), -gradient)
    return np.asarray(step, dtype=np.float64)


P = TypeVar("P", bound=Point)

# A step that leads up is tried again at this share of its length.
_SHORTER = 0.4


def descend(
    point: P,
    limit: int,
    tolerance: float,
    damping: float = 1e-3,
    floor: float = 0.0,
    shorter: int = 0,
) -> P:
    """Follow damped Gauss–Newton steps; the energy never rises.

    Args:
        point: where to start.
        limit: most steps.
        tolerance: relative gain of a step that ends the descent.
        damping: of the first step, relative to the diagonal of the normal matrix.
        floor: an energy that counts as none.
        shorter: how often a step that leads up is shortened before more damping is tried: where
            a step costs a factorisation, and an energy little.

    Returns:
        The last point.
    """
    for _ in range(limit):
        if point.value <= floor:
            break
        while True:
            there, share = _lower(point, point.step(damping), shorter)
            if there is not None:
                break
            damping *= 64.0 if shorter else 8.0
            if damping > 1e6:
                return point
        gain = point.value - there.value
        point = there
        if share < 1.0:
            damping *= 8.0
            continue
        damping = max(damping / 8.0, 1e-9)
        if gain <= tolerance * point.value:
            break
    return point


def _lower(point: P, step: FloatArray, shorter: int) -> tuple[P | None, float]:
    """The first point along a step, made shorter and shorter, that is not above; and its share."""
    share = 1.0
    for _ in range(1 + shorter):
        there = point.moved(share * step)
        # Written so that an energy that is not a number counts as a rise.
        if there.value <= point.value:
            return there, share  # type: ignore[return-value]
        share *= _SHORTER
    return None, share
