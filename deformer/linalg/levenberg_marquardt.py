"""Levenberg–Marquardt: damped Gauss–Newton descent of a sum of squares.

A problem provides its energy, its damped step, and the point that a step leads to; the loop chooses
the damping and ends the descent (Levenberg 1944; Marquardt 1963; the damping's schedule as in
Madsen, Nielsen and Tingleff, Methods for Non-Linear Least Squares Problems, 2004, section 3.2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from deformer.geometry import FloatArray

# A step that raises the energy is tried again at this share of its length.
_SHORTENING = 0.4
# A step that gains less than the first share of what was predicted is too long, in directions in
# which the residuals' curvature counts: the next one is damped more, by the factor. After one that
# gains more than the second share it is damped less.
_TOO_LONG, _MORE, _RIGHT = 0.25, 2.0, 0.6


class Point(Protocol):
    """Values of the unknowns, with their energy; a step leads to another point."""

    @property
    def energy(self) -> float:
        """Sum of squares, not negative."""
        ...

    def step(self, damping: float) -> FloatArray:
        """Damped Gauss–Newton step, to be added to the unknowns: (JᵀJ + damping D)⁻¹ (−Jᵀr).

        It is called again with more damping if a step raised the energy: a point should cache its
        normal matrix.
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
        initial: damping of the first step.
        up: factor after a step that raised the energy.
        down: divisor after a step that lowered it.
        floor: least damping after a step.
        ceiling: greatest damping; the descent ends when it is exceeded.
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
        point: the last point, with the least energy.
        steps: number of steps taken.
    """

    point: P
    steps: int


def damped_step(H: FloatArray, gradient: FloatArray, damping: float) -> FloatArray:
    """Step (n,) that solves (H + damping · diag H) step = −gradient.

    Args:
        H: (n, n) dense normal matrix.
        gradient: (n,).
        damping: relative to the diagonal of H.
    """
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
    predicted_gain: Callable[[P, FloatArray], float] | None = None,
) -> Descent[P]:
    """Follow damped Gauss–Newton steps; the energy never rises.

    The descent ends after `steps` steps, after a step that lowers the energy E by at most
    `relative_gain` · E + `absolute_gain`, or when the damping exceeds its ceiling.

    Args:
        point: the start.
        steps: greatest number of steps.
        relative_gain: the descent ends after a step that gains at most this share of the energy,
        absolute_gain: and this amount.
        damping: schedule of the damping; None is `Damping()`.
        negligible: the descent ends at an energy of at most this.
        shortenings: how often a step that raises the energy is shortened before more damping is
            tried. Useful if a step costs a factorisation and an energy costs little.
        is_last: true for a (point, step) with so little to gain that the descent ends with it,
            whether it lowers the energy (and is taken) or raises it (and is not).
        predicted_gain: gives by how much a (point, step) lowers the energy of the linearised
            residuals. The damping then depends on the share of it that steps gain; without it, it
            falls after every step.

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
            lower, share = _lower_point(point, step, shortenings)
            if lower is not None:
                break
            factor *= damping.up
            if last or factor > damping.ceiling:
                return Descent(point, count)
        gain, predicted = point.energy - lower.energy, 0.0
        if predicted_gain is not None:
            predicted = predicted_gain(point, step)
        point = lower
        if share < 1.0:
            factor *= damping.down
            continue
        if last or gain <= relative_gain * point.energy + absolute_gain:
            return Descent(point, count + 1)
        if gain < _TOO_LONG * predicted:
            factor *= _MORE
        elif gain > _RIGHT * predicted:
            factor = max(factor / damping.down, damping.floor)
    return Descent(point, steps)


def _lower_point(point: P, step: FloatArray, shortenings: int) -> tuple[P | None, float]:
    """The point after a step, shortened until the energy is no higher; and the step's share."""
    share = 1.0
    for _ in range(1 + shortenings):
        candidate: P = point.moved(share * step)
        # An energy of NaN counts as a rise: no comparison with it is true.
        if candidate.energy <= point.energy:
            return candidate, share
        share *= _SHORTENING
    return None, share
