"""Poses of a hand in anatomical ranges, as angles in degrees; drawn, the same for a seed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from hand.rig import DIGITS, Angles, Hand, joints_of

FINGERS = DIGITS[1:]
# Side flexion of the knuckles when fingers are spread, to the thumb's side.
FAN = {"index": 14.0, "middle": 3.0, "ring": -8.0, "pinky": -18.0}
PAD = 0.014  # metres between the tip joints of a thumb and a finger whose pads touch
Rng = np.random.Generator


def finger(digit: str, knuckle: float, middle: float, fan: float = 0.0) -> Angles:
    """One finger.

    Args:
        digit: index to pinky.
        knuckle: flexion at its base, −20 to 90.
        middle: flexion at the middle joint, 0 to 105; the last joint follows with 0.6 of it.
        fan: −0.5 fingers together to 1 spread; a flexed knuckle does not spread.
    """
    spread = fan * FAN[digit] * np.clip(1 - knuckle / 90, 0, 1)
    _, base, centre, end, _ = joints_of(digit)
    return {base: (knuckle, spread, 0.0), centre: (middle, 0.0, 0.0), end: (0.6 * middle, 0.0, 0.0)}


def thumb(across: float, out: float, bend: float) -> Angles:
    """The thumb.

    Args:
        across: at its base, to the little finger, −15 to 40; it turns its pad to the fingers.
        out: at its base, away from the palm, −20 to 25.
        bend: flexion of the last joint, −10 to 75; the one before follows with 0.6 of it.
    """
    base, middle, end, _ = joints_of("thumb")
    return {base: (across, out, 0.5 * across), middle: (0.6 * bend, 0, 0), end: (bend, 0, 0)}


def wrist(flexion: float, deviation: float) -> Angles:
    """The wrist.

    Args:
        flexion: −50 back to 50 to the palm.
        deviation: −25 to the little finger to 15 to the thumb.
    """
    return {"wrist": (flexion, deviation, 0.0)}


def _fingers(knuckle: NDArray, middle: NDArray, fan: float) -> Angles:
    angles: Angles = {}
    for digit, k, m in zip(FINGERS, knuckle, middle, strict=True):
        angles |= finger(digit, float(np.clip(k, -20, 88)), float(np.clip(m, 0, 105)), fan)
    return angles


def _some_wrist(rng: Rng) -> Angles:
    return wrist(rng.uniform(-15, 15), rng.uniform(-8, 8))


def one_digit(hand: Hand, rng: Rng, t: float) -> Angles:
    """One digit bends, the others hardly."""
    bent = rng.integers(5)
    knuckle, middle = rng.uniform(-5, 12, 4), rng.uniform(0, 15, 4)
    if bent == 4:
        return _fingers(knuckle, middle, rng.uniform(0, 0.5)) | thumb(30 * t, -10 * t, 65 * t)
    knuckle[bent], middle[bent] = 80 * t * rng.uniform(0.5, 1), 100 * t
    return _fingers(knuckle, middle, rng.uniform(0, 0.5)) | thumb(0, 0, rng.uniform(0, 20))


def fist(hand: Hand, rng: Rng, t: float) -> Angles:
    """All fingers close, the thumb outside or beside them."""
    knuckle, middle = 74 * t + rng.normal(0, 3, 4), 90 * t + rng.normal(0, 3, 4)
    return (
        _fingers(knuckle, middle, 0.2 * (1 - t))
        | thumb(22 * t * rng.uniform(0.3, 1), 8 * t, 45 * t * rng.uniform(0.3, 1))
        | _some_wrist(rng)
    )


def spread(hand: Hand, rng: Rng, t: float) -> Angles:
    """Straight fingers between close together and spread."""
    fan = -0.3 + 1.3 * t
    straight = _fingers(rng.uniform(-15, 10, 4), rng.uniform(0, 8, 4), fan)
    return straight | thumb(-12 * t, rng.uniform(-15, 10), rng.uniform(-8, 15))


def signs(hand: Hand, rng: Rng, t: float) -> Angles:
    """Some fingers point, the others and often the thumb close."""
    closed = rng.random(4) < 0.55
    knuckle = np.where(closed, 74 * t, rng.uniform(-10, 10, 4))
    middle = np.where(closed, 88 * t, rng.uniform(0, 12, 4))
    away = thumb(-8, rng.uniform(-10, 10), 0) if rng.random() < 0.4 else thumb(20 * t, 5, 35 * t)
    return _fingers(knuckle, middle, rng.uniform(0, 0.8)) | away | _some_wrist(rng)


def grasp(hand: Hand, rng: Rng, t: float) -> Angles:
    """Fingers around something round, the thumb opposite."""
    fan = 0.8 * (1 - t)
    knuckle, middle = 15 + 45 * t + rng.normal(0, 6, 4), 25 + 45 * t + rng.normal(0, 6, 4)
    around = thumb(5 + 15 * t, rng.uniform(5, 20), rng.uniform(5, 30))
    return _fingers(knuckle, middle, fan) | around | _some_wrist(rng)


def hook(hand: Hand, rng: Rng, t: float) -> Angles:
    """Only the outer joints bend, or only the knuckles."""
    outer = rng.random() < 0.5
    knuckle = rng.uniform(-10, 10, 4) if outer else 82 * t + rng.normal(0, 4, 4)
    middle = 95 * t + rng.normal(0, 4, 4) if outer else rng.uniform(0, 15, 4)
    return _fingers(knuckle, middle, 0.0) | thumb(rng.uniform(-5, 10), 0, rng.uniform(0, 30))


def bent_wrist(hand: Hand, rng: Rng, t: float) -> Angles:
    """The wrist in its whole range, a relaxed hand."""
    knuckle, middle = rng.uniform(5, 30, 4), rng.uniform(10, 35, 4)
    turned = wrist(-50 + 100 * t, rng.uniform(-25, 15))
    return _fingers(knuckle, middle, 0.2) | thumb(5, 5, rng.uniform(0, 25)) | turned


def loose(hand: Hand, rng: Rng, t: float) -> Angles:
    """Every digit for itself."""
    free = thumb(rng.uniform(-10, 30), rng.uniform(-12, 20), rng.uniform(-5, 60))
    digits = _fingers(rng.uniform(-10, 75, 4), rng.uniform(0, 90, 4), rng.uniform(0, 1))
    return digits | free | _some_wrist(rng)


def pinch(hand: Hand, rng: Rng, t: float) -> Angles:
    """The pads of the thumb and of one finger touch, as near as the ranges allow."""
    chosen = int(rng.integers(4))
    knuckle, middle = rng.uniform(5, 35, 4), rng.uniform(10, 40, 4)
    low = np.array([20.0, 15.0, -15.0, -20.0, -5.0])
    high = np.array([75.0, 80.0, 42.0, 25.0, 60.0])
    start = rng.uniform([40, 35, 15, 0, 15], [55, 55, 30, 15, 35])
    ends = [hand.index[joints_of(digit)[-1]] for digit in ("thumb", FINGERS[chosen])]

    def posed(x: NDArray) -> Angles:
        k, m = knuckle.copy(), middle.copy()
        k[chosen], m[chosen] = x[:2]
        return _fingers(k, m, 0.1) | thumb(*x[2:])

    def energy(x: NDArray) -> float:
        tips = hand.joint_positions(posed(x))[ends]
        gap = np.sqrt(((tips[0] - tips[1]) ** 2).sum()) - PAD
        return (gap / 0.01) ** 2 + 1e-3 * float(((x - start) ** 2 / 100).sum())

    found = minimize(energy, start, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)))
    return posed(found.x) | _some_wrist(rng)


Family = Callable[[Hand, Rng, float], Angles]
# Of every 16 poses.
CYCLE: tuple[Family, ...] = (
    *(one_digit, fist, loose, signs, pinch, one_digit, bent_wrist, loose),
    *(one_digit, spread, loose, signs, pinch, hook, one_digit, grasp),
)


def schedule(count: int) -> list[tuple[Family, float]]:
    """Families of `count` poses, and how far each goes, from 0.15 to 1, evenly in each family."""
    families = [CYCLE[n % len(CYCLE)] for n in range(count)]
    plan = []
    for n, family in enumerate(families):
        rank, total = families[:n].count(family), families.count(family)
        # Golden-ratio steps: near ranks differ, and all together are even.
        plan.append((family, 0.15 + 0.85 * ((0.5 + rank * 0.618034) % 1.0 if total > 1 else 0.6)))
    return plan
