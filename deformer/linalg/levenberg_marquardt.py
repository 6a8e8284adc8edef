"""Levenberg–Marquardt: damped Gauss–Newton descent of a sum of squares.

A problem says its energy, its damped step and where a step leads; this loop chooses the damping and
ends the descent (Levenberg 1944; Marquardt 1963; the damping's schedule as in Madsen, Nielsen and
Tingleff, Methods for Non-Linear Least Squares Problems, 2004, section 3.2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from deformer.geometry import FloatArray

# A step that leads up is tried again at this share of its length.
_SHORTER = 0.4


class Point(Protocol):
    """Unknowns, with the energy there. Immutable: a step leads to another point."""

    @property
    def energy(self) -> float:
        """Sum of squares, not negative."""
        ...

    def step(self, damping: float) -> FloatArray:
        """Damped Gauss–Newton step, to be added to the unknowns: (JᵀJ + damping D)⁻¹ (−Jᵀr).

        Called again with more damping when a step led up; a point keeps its normal matrix.
        """
        ...

    def moved(self, step: FloatArray) -> Any:
        """The point that a step leads to."""
        ...


P = TypeVar("P", bound=Point)


@dataclass(frozen=True)
class Damping:
    """Schedule of the damping, relative to the diagonal of the normal matrix.

    Args:
        initial: of the first step.
        up: factor after a step that led up.
        down: divisor after a step that led down.
        floor: least damping after a step.
        ceiling: more than this ends the descent.
    """

    initial: float = 1e-3
    up: float = 8.0
    down: float = 8.0
    floor: float = 1e-9
    ceiling: float = 1e6


@dataclass(frozen=True)
class Descent(Generic[P]):
    """The end of a descent.

    Args:
        point: the last one, of the least energy.
        steps: taken.
    """

    point: P
    steps: int


def damped_step(H: FloatArray, gradient: FloatArray, damping: float) -> FloatArray:
    """Step (n,) that solves (H + damping · diag H) step = −gradient for a dense H (n, n)."""
    step = np.linalg.solve(H + damping * np.diag(np.diag(H)), -gradient)
    return np.asarray(step, dtype=np.float64)


def descend(
    point: P,
    *,
    steps: int,
    relative_gain: float,
    absolute_gain: float = 0.0,
    damping: Damping | None = None,
    negligible: float = 0.0,
    shortenings: int = 0,
    is_last: Callable[[P, FloatArray], bool] | None = None,
) -> Descent[P]:
    """Follow damped Gauss–Newton steps; the energy never rises.

    The descent ends after `steps`, after a step that gains at most `relative_gain` of the energy
    that is left plus `absolute_gain`, or when the damping passes its ceiling.

    Args:
        point: where to start.
        steps: most steps.
        relative_gain: of a step that ends the descent.
        absolute_gain: of a step that ends the descent.
        damping: its schedule; None is `Damping()`.
        negligible: an energy that counts as none.
        shortenings: how often a step that leads up is shortened before more damping is tried:
            where a step costs a factorisation, and an energy little.
        is_last: True for a step that promises so little that the descent ends with it, whether
            it leads down (and is taken) or up (and is not).

    Returns:
        The last point, and the number of steps taken.
    """
    damping = damping or Damping()
    factor = damping.initial
    for count in range(steps):
        if point.energy <= negligible:
            return Descent(point, count)
        while True:
            step = point.step(factor)
            last = is_last is not None and is_last(point, step)
            there, share = _lower(point, step, shortenings)
            if there is not None:
                break
            factor *= damping.up
            if last or factor > damping.ceiling:
                return Descent(point, count)
        gain = point.energy - there.energy
        point = there
        if share < 1.0:
            factor *= damping.down
            continue
        factor = max(factor / damping.down, damping.floor)
        if last or gain <= relative_gain * point.energy + absolute_gain:
            return Descent(point, count + 1)
    return Descent(point, steps)


def _lower(point: P, step: FloatArray, shortenings: int) -> tuple[P | None, float]:
    """The first point along a step, made shorter and shorter, that is not above; and its share."""
    share = 1.0
    for _ in range(1 + shortenings):
        there: P = point.moved(share * step)
        # Written so that an energy that is not a number counts as a rise.
        if there.energy <= point.energy:
            return there, share
        share *= _SHORTER
    return None, share
