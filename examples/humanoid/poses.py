"""The pose library: families of natural poses, sampled with a seed.

Every family takes a random generator and t ∈ [0, 1) (its place in the family, the phase of a
gait cycle for walks and runs) and returns one `Pose`. Angles are degrees; see `rig.Arm`, `rig.Leg`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from humanoid.rig import Arm, Leg, Pose

Generator = np.random.Generator
SIDES = ("L", "R")
OTHER = {"L": "R", "R": "L"}


def _jitter(rng: Generator, value: float, spread: float) -> float:
    """`value` ± `spread`, never further away."""
    return float(value + spread * np.clip(rng.normal(0, 0.5), -1, 1))


def _hanging(rng: Generator, curl: float = 22.0) -> Arm:
    """An arm at rest beside the body."""
    direction = (_jitter(rng, 0.24, 0.06), _jitter(rng, 0.0, 0.08), -1.0)
    return Arm(
        direction,
        roll=_jitter(rng, 0, 10),
        elbow=_jitter(rng, 15, 8),
        pronation=_jitter(rng, 10, 20),
        curl=_jitter(rng, curl, 15),
    )


def _standing(rng: Generator, family: str) -> Pose:
    pose = Pose(family)
    pose.arms = {side: _hanging(rng) for side in SIDES}
    stance = _jitter(rng, -2, 3)
    pose.legs = {side: Leg(abduction=stance, rotation=_jitter(rng, 6, 6)) for side in SIDES}
    pose.neck = (_jitter(rng, 2, 6), _jitter(rng, 0, 4), _jitter(rng, 0, 10))
    return pose


def _side(rng: Generator) -> str:
    return SIDES[int(rng.integers(2))]


def _look(pose: Pose, side: str, out: float, up: float) -> None:
    """Turn and lift the head towards a target at the side of the body."""
    sign = 1.0 if side == "L" else -1.0
    bend = pose.neck[1]
    pose.neck = (float(np.clip(-22 * up, -25, 25)), bend, float(np.clip(30 * sign * out, -40, 40)))


def _swing(phase: float, elbow: float, amount: float, flex: float, curl: float) -> Arm:
    """The arm of a gait, forwards at phase 0."""
    forward = amount * np.cos(2 * np.pi * phase) + 0.08 * amount
    bend = elbow + flex * 0.5 * (1 + np.cos(2 * np.pi * phase))
    return Arm((0.26, float(forward), -1.0), roll=-4.0, elbow=float(bend), pronation=20, curl=curl)


def _cycle(phase: float, keys: list[tuple[float, float]]) -> float:
    """Smooth periodic curve through (phase, value) keys: cosine steps between neighbours."""
    phase %= 1.0
    extended = [(keys[-1][0] - 1, keys[-1][1]), *keys, (keys[0][0] + 1, keys[0][1])]
    for (p0, v0), (p1, v1) in pairwise(extended):
        if p0 <= phase <= p1:
            return v0 + (v1 - v0) * 0.5 * (1 - np.cos(np.pi * (phase - p0) / (p1 - p0)))
    raise AssertionError("the keys cover one period")


def walk(rng: Generator, t: float) -> Pose:
    """One moment of a walk; the heel of the left foot strikes at phase 0."""
    pose = Pose("walk")
    pace, bounce = _jitter(rng, 1.0, 0.25), _jitter(rng, 1.0, 0.3)
    curl, arms = _jitter(rng, 28, 15), _jitter(rng, 0.42, 0.16)
    phase = {"L": t, "R": t + 0.5}
    for side in SIDES:
        p = phase[side]
        hip = _cycle(p, [(0.0, 27), (0.5, -14), (0.58, -12), (0.85, 29)])
        knee = _cycle(p, [(0.0, 4), (0.13, 17), (0.4, 5), (0.72, 60), (0.96, 4)])
        ankle = _cycle(p, [(0.0, 2), (0.08, -5), (0.42, 10), (0.62, -18), (0.85, 2)])
        toes = _cycle(p, [(0.0, 5), (0.3, 0), (0.55, 22), (0.75, 4)])
        pose.legs[side] = Leg(
            hip * pace, -4, 4, max(knee * (0.8 + 0.2 * pace) * bounce, 2), ankle, toes
        )
        pose.arms[side] = _swing(p + 0.5, 14, arms * pace, 16 * pace, curl)
    turn = np.cos(2 * np.pi * t)
    pose.pelvis = (_jitter(rng, 3, 3), 3 * float(np.sin(2 * np.pi * t)), -5 * float(turn) * pace)
    pose.spine = (_jitter(rng, 1, 4), -2 * float(np.sin(2 * np.pi * t)), 10 * float(turn) * pace)
    pose.neck = (_jitter(rng, 0, 6), 0.0, -5 * float(turn) * pace)
    return pose


def run(rng: Generator, t: float) -> Pose:
    """One moment of a run, from a jog to a sprint."""
    pose = Pose("run")
    pace = _jitter(rng, 1.0, 0.25)
    elbow, amount, curl = _jitter(rng, 80, 15), _jitter(rng, 0.75, 0.2), _jitter(rng, 65, 30)
    phase = {"L": t, "R": t + 0.5}
    for side in SIDES:
        p = phase[side]
        hip = _cycle(p, [(0.0, 32), (0.35, -14), (0.42, -16), (0.8, 60), (0.9, 50)])
        knee = _cycle(p, [(0.0, 18), (0.15, 38), (0.36, 14), (0.65, 105), (0.95, 20)])
        ankle = _cycle(p, [(0.0, 4), (0.16, 18), (0.4, -28), (0.75, 0)])
        toes = _cycle(p, [(0.0, 4), (0.2, 0), (0.38, 22), (0.6, 4)])
        pose.legs[side] = Leg(hip * pace, -4, 2, max(knee * pace, 4), ankle, toes)
        pose.arms[side] = replace(_swing(p + 0.5, elbow, amount * pace, 15, curl), roll=8.0)
    turn = float(np.cos(2 * np.pi * t))
    pose.pelvis = (_jitter(rng, 8, 5), 3 * float(np.sin(2 * np.pi * t)), -7 * turn)
    pose.spine = (_jitter(rng, 5, 4), 0.0, 15 * turn)
    pose.neck = (_jitter(rng, -8, 5), 0.0, -8 * turn)
    return pose


def reach(rng: Generator, t: float) -> Pose:
    """One arm to a point in front, above, at the side or across the body."""
    pose = _standing(rng, "reach")
    side = SIDES[int(t * 1000) % 2]
    out, up = 75 * (2 * ((t * 7.3) % 1) - 1) + 25, _jitter(rng, 100 * t - 45, 25)
    far = float(rng.uniform(0.68, 0.99))
    azimuth, height = np.deg2rad(np.clip(out, -45, 95)), np.deg2rad(np.clip(up, -55, 75))
    target = np.array([np.cos(height) * np.sin(azimuth), np.cos(height) * np.cos(azimuth)])
    point = (float(far * target[0]), float(far * target[1]), float(far * np.sin(height)))
    pose.arms[side] = Arm(
        reach=point,
        swivel=float(rng.uniform(-25, 30)),
        pronation=float(rng.uniform(0, 70)),
        wrist=float(rng.uniform(-25, 15)),
        curl=float(rng.uniform(-5, 40)),
    )
    _look(pose, side, point[0], point[2])
    sign = 1.0 if side == "L" else -1.0
    pose.spine = (12 * point[1] * far, -6 * sign * point[2], -14 * sign * max(point[1], 0.2) * far)
    return pose


def reach_both(rng: Generator, t: float) -> Pose:
    """Both hands to one thing: to carry, lift, push or hold it."""
    pose = _standing(rng, "reach_both")
    height, ahead = float(-0.55 + 1.2 * t), float(rng.uniform(0.55, 0.85))
    apart, swivel = float(rng.uniform(-0.25, 0.25)), float(rng.uniform(-25, 25))
    hand = {"pronation": float(rng.uniform(0, 60)), "wrist": float(rng.uniform(-30, 10))}
    for side in SIDES:
        point = (apart, ahead * float(np.cos(height)), height + _jitter(rng, 0, 0.08))
        pose.arms[side] = Arm(reach=point, swivel=swivel, curl=float(rng.uniform(5, 50)), **hand)
    pose.neck = (-16 * height, 0.0, 0.0)
    pose.spine = (_jitter(rng, 6 - 8 * height, 6), 0.0, _jitter(rng, 0, 8))
    return pose


def arm_raise(rng: Generator, t: float) -> Pose:
    """One or both straight arms lifted in front, diagonally or at the side, up to overhead."""
    pose = _standing(rng, "arm_raise")
    lift = np.deg2rad(_jitter(rng, 40 + 115 * t, 12))
    azimuth = np.deg2rad((12, 50, 88)[int(rng.integers(3))])
    which = SIDES if rng.random() < 0.5 else (_side(rng),)
    flat = float(np.sin(lift))
    for side in which:
        direction = (flat * np.sin(azimuth) + 0.12, flat * np.cos(azimuth), -np.cos(lift))
        pose.arms[side] = Arm(
            tuple(map(float, direction)),
            roll=_jitter(rng, 12 * float(lift), 15),
            elbow=float(rng.uniform(2, 22)),
            pronation=float(rng.uniform(0, 60)),
            curl=float(rng.uniform(-5, 35)),
        )
    pose.spine = (-8 * max(t - 0.4, 0), 0.0, 0.0)
    if len(which) == 1:
        sign = 1.0 if which[0] == "L" else -1.0
        pose.spine = (pose.spine[0], -7 * sign * t, -6 * sign * t * float(np.cos(azimuth)))
    return pose


def squat(rng: Generator, t: float) -> Pose:
    """A squat from shallow to deep, the arms in front, at the chest or hanging."""
    pose = _standing(rng, "squat")
    deep, wide = 0.3 + 0.7 * t, _jitter(rng, 12, 8)
    for side in SIDES:
        pose.legs[side] = Leg(100 * deep, wide, 1.2 * wide, 110 * deep, 22 * deep)
    pose.pelvis = (22 * deep, 0.0, 0.0)
    pose.spine = (_jitter(rng, 14 * deep, 6), 0.0, _jitter(rng, 0, 6))
    pose.neck = (_jitter(rng, -18 * deep, 6), 0.0, _jitter(rng, 0, 10))
    style = int(rng.integers(3))
    for side in SIDES:
        if style == 0:
            pose.arms[side] = Arm((0.15, 1.0, _jitter(rng, 0.1, 0.2)), elbow=_jitter(rng, 15, 10))
        elif style == 1:
            point = (_jitter(rng, -0.22, 0.03), 0.5, _jitter(rng, -0.1, 0.06))
            pose.arms[side] = Arm(reach=point, curl=70)
        else:
            pose.arms[side] = Arm((0.4, _jitter(rng, 0.5, 0.2), -1.0), elbow=_jitter(rng, 40, 15))
    return pose


def lunge(rng: Generator, t: float) -> Pose:
    """A long step with bent knees."""
    pose = _standing(rng, "lunge")
    front, deep = _side(rng), 0.35 + 0.65 * t
    pose.legs[front] = Leg(_jitter(rng, 85 * deep, 8), 0, 4, _jitter(rng, 85 * deep, 8), 8 * deep)
    pose.legs[OTHER[front]] = Leg(-16 - 10 * deep, 0, 4, _jitter(rng, 75 * deep, 10), 0, 25 * deep)
    sign = 1.0 if front == "L" else -1.0
    pose.pelvis = (_jitter(rng, 6, 5), 0.0, -4 * sign)
    pose.spine = (_jitter(rng, 4, 8), 0.0, _jitter(rng, 8 * sign, 8))
    if rng.random() < 0.5:
        pose.arms[OTHER[front]] = Arm((0.3, 0.5, -1.0), elbow=_jitter(rng, 50, 25), curl=40)
        pose.arms[front] = Arm((0.3, -0.45, -1.0), elbow=_jitter(rng, 35, 20), curl=40)
    elif rng.random() < 0.5:
        for side in SIDES:
            pose.arms[side] = Arm((0.9, 0.3, _jitter(rng, 0.0, 0.4)), elbow=_jitter(rng, 20, 12))
    return pose


def sit(rng: Generator, t: float) -> Pose:
    """Sitting on a chair: upright, leaning, the legs stretched or drawn in."""
    pose = _standing(rng, "sit")
    lean, wide = _jitter(rng, 6, 14), float(rng.uniform(0, 16))
    for side in SIDES:
        knee = _jitter(rng, 50 + 55 * t, 15)
        hip = 84 + lean + _jitter(rng, 0, 4)
        pose.legs[side] = Leg(min(hip, 108), wide, 0.5 * wide, knee, _jitter(rng, 0, 8))
        out, ahead = _jitter(rng, 0.14, 0.08), _jitter(rng, 0.5, 0.15)
        pose.arms[side] = Arm(
            (out + 0.16, ahead, -1.0), roll=5, elbow=_jitter(rng, 60, 20), pronation=55, curl=25
        )
    pose.pelvis = (lean, 0.0, 0.0)
    pose.spine = (_jitter(rng, 8, 10), _jitter(rng, 0, 5), _jitter(rng, 0, 12))
    if rng.random() < 0.3:
        side = _side(rng)
        pose.arms[side] = Arm(reach=(_jitter(rng, 0.1, 0.2), 0.7, _jitter(rng, 0.0, 0.3)), curl=30)
    return pose


def kick(rng: Generator, t: float) -> Pose:
    """A kick forwards, sideways or backwards; the arms balance."""
    pose = _standing(rng, "kick")
    side = _side(rng)
    sign = 1.0 if side == "L" else -1.0
    style = int(t * 1000) % 4
    if style == 3:  # backwards
        pose.legs[side] = Leg(-24, 3, 5, _jitter(rng, 55, 35), -15)
        pose.pelvis, pose.spine = (14.0, 0.0, 0.0), (12.0, 0.0, 6 * sign)
    elif style == 2:  # sideways
        pose.legs[side] = Leg(18, _jitter(rng, 38, 8), 0, _jitter(rng, 20, 15), -5)
        pose.pelvis, pose.spine = (0.0, -12 * sign, 0.0), (5.0, -10 * sign, 0.0)
    else:
        high = _jitter(rng, 45 + 55 * t, 10)
        pose.legs[side] = Leg(high, 3, 4, _jitter(rng, 45 - 35 * t, 12) + 4, -20)
        pose.pelvis, pose.spine = (-0.12 * high, 0.0, 0.0), (10.0, 0.0, 10 * sign)
    pose.legs[OTHER[side]] = Leg(-pose.pelvis[0] * 0.6 + 4, 2, 8, _jitter(rng, 12, 8), 6)
    for arm, ahead in ((side, -0.4), (OTHER[side], 0.6)):
        direction = (_jitter(rng, 0.6, 0.25), _jitter(rng, ahead, 0.15), -0.7)
        pose.arms[arm] = Arm(direction, elbow=_jitter(rng, 35, 25), curl=_jitter(rng, 45, 30))
    return pose


def torso(rng: Generator, t: float) -> Pose:
    """Bends forwards, back and sideways, and twists."""
    pose = _standing(rng, "torso")
    style, sign = int(t * 1000) % 4, 1.0 if rng.random() < 0.5 else -1.0
    amount = float(rng.uniform(0.4, 1.0))
    if style == 0:
        pose.pelvis, pose.spine = (40 * amount, 0.0, 0.0), (38 * amount, 0.0, _jitter(rng, 0, 8))
        for side in SIDES:
            pose.legs[side] = replace(pose.legs[side], hip=40 * amount, knee=4 + 14 * amount)
            pose.arms[side] = replace(pose.arms[side], direction=(0.2, 0.9 * amount, -1.0))
    elif style == 1:
        pose.spine = (-20 * amount, 0.0, _jitter(rng, 0, 8))
    elif style == 2:
        pose.spine = (_jitter(rng, 3, 4), 28 * sign * amount, 0.0)
        pose.neck = (0.0, 10 * sign * amount, 0.0)
        if rng.random() < 0.5:
            lifted = "R" if sign > 0 else "L"
            pose.arms[lifted] = Arm((0.5, 0.2, 1.0), roll=25, elbow=_jitter(rng, 25, 15))
    else:
        pose.spine = (_jitter(rng, 5, 8), _jitter(rng, 0, 6), 38 * sign * amount)
        pose.neck = (0.0, 0.0, 20 * sign * amount)
        if rng.random() < 0.6:
            for side in SIDES:
                pose.arms[side] = Arm(
                    (0.7, 0.35, _jitter(rng, -0.5, 0.4)), elbow=_jitter(rng, 45, 30)
                )
    return pose


def head(rng: Generator, t: float) -> Pose:
    """Nods, turns and tilts of the head."""
    pose = _standing(rng, "head")
    pose.neck = (float(rng.uniform(-30, 35)), float(rng.uniform(-22, 22)), 130 * t - 65)
    pose.spine = (0.0, 0.0, 0.12 * pose.neck[2])
    return pose


def crouch(rng: Generator, t: float) -> Pose:
    """Low on both feet, bent forwards, as if to sneak or to pick something up."""
    pose = squat(rng, 0.3 + 0.45 * t)
    pose.family = "crouch"
    ahead = _side(rng)
    leg = pose.legs[ahead]
    pose.legs[ahead] = replace(leg, hip=min(leg.hip + 14, 108), abduction=8)
    other = pose.legs[OTHER[ahead]]
    pose.legs[OTHER[ahead]] = replace(other, hip=other.hip - 14, abduction=8, toes=15)
    pose.pelvis = (_jitter(rng, 28, 6), 0.0, 0.0)
    pose.spine = (_jitter(rng, 26, 8), _jitter(rng, 0, 6), _jitter(rng, 0, 12))
    pose.neck = (_jitter(rng, -28, 8), 0.0, _jitter(rng, 0, 20))
    for side in SIDES:
        point = (_jitter(rng, 0.1, 0.2), _jitter(rng, 0.65, 0.1), _jitter(rng, -0.3, 0.25))
        pose.arms[side] = Arm(reach=point, curl=_jitter(rng, 35, 25), pronation=35)
    return pose


def wave(rng: Generator, t: float) -> Pose:
    """A raised hand, waving."""
    pose = _standing(rng, "wave")
    side = _side(rng)
    direction = (1.0, _jitter(rng, 0.25, 0.2), _jitter(rng, 0.0, 0.4))
    pose.arms[side] = Arm(
        direction,
        roll=_jitter(rng, 78, 10),
        elbow=70 + 50 * t,
        pronation=_jitter(rng, 5, 20),
        wrist=-5,
        curl=5,
    )
    return pose


def hands_on_hips(rng: Generator, t: float) -> Pose:
    """One or both hands on the hips, the elbows out."""
    pose = _standing(rng, "hands_on_hips")
    for side in SIDES if t < 0.7 else (_side(rng),):
        point = (_jitter(rng, 0.25, 0.04), _jitter(rng, 0.0, 0.05), _jitter(rng, -0.68, 0.04))
        pose.arms[side] = Arm(
            reach=point, swivel=_jitter(rng, 35, 10), pronation=15, wrist=-25, curl=25
        )
    pose.spine = (_jitter(rng, -2, 5), _jitter(rng, 0, 6), _jitter(rng, 0, 12))
    return pose


def touch(rng: Generator, t: float) -> Pose:
    """A hand near the head, the other shoulder or the chest; arms folded in front."""
    pose = _standing(rng, "touch")
    side = _side(rng)
    places = [(-0.08, 0.32, 0.35), (-0.5, 0.35, 0.0), (-0.32, 0.42, -0.25), (0.12, 0.25, 0.38)]
    place = places[int(t * 1000) % 4]
    point = tuple(_jitter(rng, value, 0.05) for value in place)
    pose.arms[side] = Arm(reach=point, swivel=_jitter(rng, 5, 20), pronation=40, curl=30)
    return pose


def mixed(rng: Generator, t: float) -> Pose:
    """The legs of one family, the arms and head of others, and a free torso."""
    lower = (walk, run, squat, lunge, sit, kick, crouch)[int(t * 1000) % 7](rng, rng.random())
    pose = replace(lower, family="mixed", arms={}, legs=dict(lower.legs))
    for side in SIDES:
        source = (reach, arm_raise, wave, walk, run, touch, torso)[int(rng.integers(7))]
        for _ in range(20):  # the family chooses the arm it moves; take the one that moved most
            drawn = source(rng, rng.random())
            if drawn.arms[side].reach or drawn.arms[side].direction[2] > -0.9 or rng.random() < 0.2:
                break
        pose.arms[side] = drawn.arms[side]
    lean, bend, twist = pose.spine
    pose.spine = (_jitter(rng, lean, 10), _jitter(rng, bend, 12), _jitter(rng, twist, 18))
    pose.neck = (_jitter(rng, pose.neck[0], 15), _jitter(rng, 0, 10), _jitter(rng, 0, 35))
    return pose


# Families with their share of the set.
FAMILIES: dict[Callable[[Generator, float], Pose], int] = {
    walk: 32,
    run: 22,
    reach: 34,
    reach_both: 12,
    arm_raise: 22,
    squat: 10,
    lunge: 12,
    sit: 12,
    kick: 12,
    torso: 16,
    head: 8,
    crouch: 6,
    wave: 8,
    hands_on_hips: 6,
    touch: 8,
    mixed: 20,
}


def schedule(count: int) -> list[tuple[Callable[[Generator, float], Pose], float]]:
    """`count` families with their t, shared out by the largest remainder."""
    total = sum(FAMILIES.values())
    exact = {family: share * count / total for family, share in FAMILIES.items()}
    counts = {family: int(value) for family, value in exact.items()}
    short = count - sum(counts.values())
    for family in sorted(exact, key=lambda f: counts[f] - exact[f])[:short]:
        counts[family] += 1
    return [(family, i / n) for family, n in counts.items() for i in range(n)]


def soften(pose: Pose, amount: float) -> Pose:
    """The same pose with every angle brought towards standing by `amount` (0 … 1)."""

    def scale(triple: tuple[float, float, float]) -> tuple[float, float, float]:
        return tuple((1 - amount) * value for value in triple)  # type: ignore[return-value]

    def leg(value: Leg) -> Leg:
        rest = Leg()
        keys = ("hip", "abduction", "rotation", "knee", "ankle", "toes")
        mixed = {k: (1 - amount) * getattr(value, k) + amount * getattr(rest, k) for k in keys}
        return Leg(**mixed)

    def arm(value: Arm) -> Arm:
        curl, wrist = (1 - amount) * value.curl, (1 - amount) * value.wrist
        if value.reach is not None:
            # Away from the body, to where the arm is freer.
            out, ahead, up = value.reach
            point = (out + 0.35 * amount, ahead + 0.25 * amount, up)
            return replace(value, reach=point, curl=curl, wrist=wrist)
        out, ahead, up = value.direction
        direction = (out + 0.35 * amount, ahead, up)
        roll, elbow = (1 - amount) * value.roll, (1 - amount) * value.elbow + amount * 20
        return replace(value, direction=direction, roll=roll, elbow=elbow, curl=curl, wrist=wrist)

    return replace(
        pose,
        pelvis=scale(pose.pelvis),
        spine=scale(pose.spine),
        neck=scale(pose.neck),
        arms={side: arm(value) for side, value in pose.arms.items()},
        legs={side: leg(value) for side, value in pose.legs.items()},
    )
