"""From joint angles to skin: anatomical angles → bone rotations → dual-quaternion skinning.

Rotations of bones are written in the world axes of the rest pose (z up, facing −y, left at +x),
so that every bone's rest frame is the identity. The right side is the mirror image of the left.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from skinning import DeltaMush, blend

from humanoid.body import Body

X, Y, Z = np.eye(3)
DOWN = -Z
MUSH_ROUNDS = 12
FINGERS = ("finger2", "finger3", "finger4", "finger5")
SPINE = {"spine05": 0.15, "spine04": 0.2, "spine03": 0.25, "spine02": 0.2, "spine01": 0.2}
NECK = {"neck01": 0.2, "neck02": 0.2, "neck03": 0.2, "head": 0.4}


@dataclass
class Arm:
    """One arm, in degrees; the same numbers mean mirrored poses on both sides.

    Args:
        direction: (out, front, up) of the upper arm seen from the chest.
        roll: humeral rotation about the upper arm, positive outwards.
        elbow: flexion, 0 straight.
        pronation: turn of the hand from thumb-up, positive palm down.
        wrist: flexion towards the palm.
        curl: flexion of the fingers, 0 as at rest, 100 a fist.
        reach: wrist position (out, front, up) from the shoulder in arm lengths; overrides
            `direction`, `roll` and `elbow`.
        swivel: for `reach`, turn of the elbow about the line to the wrist, positive outwards.
    """

    direction: tuple[float, float, float] = (0.22, 0.02, -1.0)
    roll: float = 0.0
    elbow: float = 14.0
    pronation: float = 15.0
    wrist: float = 0.0
    curl: float = 15.0
    reach: tuple[float, float, float] | None = None
    swivel: float = 0.0


@dataclass
class Leg:
    """One leg, in degrees: hip flexion, abduction and outward rotation, knee, ankle (toes up)."""

    hip: float = 0.0
    abduction: float = -3.0
    rotation: float = 0.0
    knee: float = 4.0
    ankle: float = 0.0
    toes: float = 0.0


@dataclass
class Pose:
    """A whole pose, in degrees: (forward lean, bend to the left, twist to the left) triples."""

    family: str
    pelvis: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spine: tuple[float, float, float] = (0.0, 0.0, 0.0)
    neck: tuple[float, float, float] = (0.0, 0.0, 0.0)
    arms: dict[str, Arm] = field(default_factory=lambda: {"L": Arm(), "R": Arm()})
    legs: dict[str, Leg] = field(default_factory=lambda: {"L": Leg(), "R": Leg()})


def _turn(axis: NDArray, degrees: float) -> NDArray:
    return Rotation.from_rotvec(np.deg2rad(degrees) * axis / np.linalg.norm(axis)).as_matrix()


def _torso(triple: tuple[float, float, float], share: float = 1.0) -> NDArray:
    lean, bend, twist = (share * angle for angle in triple)
    return Rotation.from_euler("zyx", [twist, bend, lean], degrees=True).as_matrix()


def _unit(vector: NDArray) -> NDArray:
    return vector / np.linalg.norm(vector)


def _shortest(a: NDArray, b: NDArray) -> NDArray:
    """Rotation by the smallest angle that takes unit `a` to unit `b`."""
    axis, cosine = np.cross(a, b), float(a @ b)
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return np.eye(3)
    return Rotation.from_rotvec(np.arctan2(sine, cosine) * axis / sine).as_matrix()


def _split_twist(rotation: NDArray, axis: NDArray) -> tuple[NDArray, float]:
    """`rotation` = swing · turn(axis, twist): the swing and the twist in degrees."""
    swing = _shortest(axis, rotation @ axis)
    twist = Rotation.from_matrix(swing.T @ rotation).as_rotvec() @ axis
    return swing, float(np.rad2deg(twist))


class Rig:
    """Poses a `Body`; arms and legs are computed on the left and mirrored to the right."""

    def __init__(self, body: Body) -> None:
        """Measure the limbs of `body` at rest."""
        self.body = body
        self.index = {name: i for i, name in enumerate(body.labels)}
        self.shoulder, self.elbow, self.wrist = map(
            self._head, ("upperarm01.L", "lowerarm01.L", "wrist.L")
        )
        self.upper = np.linalg.norm(self.elbow - self.shoulder)
        self.fore = np.linalg.norm(self.wrist - self.elbow)
        self.u0 = _unit(self.elbow - self.shoulder)
        self.f0 = _unit(self.wrist - self.elbow)
        self.h0 = _unit(np.cross(self.u0, self.f0))
        self.elbow0 = np.rad2deg(np.arccos(self.u0 @ self.f0))
        self.thigh = _unit(self._head("lowerleg01.L") - self._head("upperleg01.L"))
        self.shank = _unit(self._head("foot.L") - self._head("lowerleg01.L"))
        across = self._head("finger5-1.L") - self._head("finger2-1.L")
        along = self._head("finger3-1.L") - self.wrist
        # Turning about `across` (index to little finger) by a positive angle bends to the palm.
        self.across = _unit(across - (across @ _unit(along)) * _unit(along))
        self._mush = DeltaMush(body.vertices, body.faces, MUSH_ROUNDS)

    def _head(self, name: str) -> NDArray:
        return self.body.heads[self.index[name]]

    def bone_transforms(self, pose: Pose) -> tuple[NDArray, NDArray]:
        """Rotations (B, 3, 3) and translations (B, 3) that take rest points to posed points."""
        local = np.tile(np.eye(3), (len(self.index), 1, 1))
        local[0] = _torso(pose.pelvis)
        for names, triple in ((SPINE, pose.spine), (NECK, pose.neck)):
            for name, share in names.items():
                local[self.index[name]] = _torso(triple, share)
        mirror = np.diag([-1.0, 1.0, 1.0])
        for side in "LR":
            for limb in (self._arm(pose.arms[side]), self._leg(pose.legs[side])):
                for name, turn in limb.items():
                    turn = turn if side == "L" else mirror @ turn @ mirror
                    local[self.index[f"{name}.{side}"]] = turn
        rotations, positions = local.copy(), self.body.heads.copy()
        for bone, parent in enumerate(self.body.parents):
            if parent >= 0:
                offset = self.body.heads[bone] - self.body.heads[parent]
                rotations[bone] = rotations[parent] @ local[bone]
                positions[bone] = positions[parent] + rotations[parent] @ offset
        return rotations, positions - np.einsum("bij,bj->bi", rotations, self.body.heads)

    def _arm(self, arm: Arm) -> dict[str, NDArray]:
        aim = arm.direction if arm.reach is None else arm.reach
        aim = _unit(np.array([aim[0], -aim[1], aim[2]], dtype=float))
        girdle = self._girdle(aim)
        if arm.reach is None:
            u1 = aim
            swing = _shortest(DOWN, u1)
            h1 = _turn(u1, -arm.roll) @ swing @ -X
            elbow = arm.elbow
        else:
            u1, h1, elbow = self._reach(arm, girdle)
        target = np.stack([u1, h1, np.cross(u1, h1)], 1)
        rest = np.stack([self.u0, self.h0, np.cross(self.u0, self.h0)], 1)
        swing, twist = _split_twist(girdle.T @ target @ rest.T, self.u0)
        half = Rotation.from_rotvec(0.5 * Rotation.from_matrix(girdle).as_rotvec()).as_matrix()
        turns = {
            "clavicle": half,
            "shoulder01": half,
            "upperarm01": swing @ _turn(self.u0, 0.45 * twist),
            "upperarm02": _turn(self.u0, 0.55 * twist),
            "lowerarm01": _turn(self.h0, elbow - self.elbow0)
            @ _turn(self.f0, 0.35 * arm.pronation),
            "lowerarm02": _turn(self.f0, 0.65 * arm.pronation),
            "wrist": _turn(self.across, arm.wrist),
        }
        for rank, finger in enumerate(FINGERS):
            along = self._head(f"{finger}-3.L") - self._head(f"{finger}-1.L")
            axis = _unit(self.across - (self.across @ _unit(along)) * _unit(along))
            for joint, share in (("1", 0.75), ("2", 0.9), ("3", 0.5)):
                turns[f"{finger}-{joint}"] = _turn(axis, arm.curl * share * (0.9 + 0.05 * rank))
        along = _unit(self._head("finger1-3.L") - self._head("finger1-2.L"))
        axis = _unit(np.cross(along, self._head("finger4-1.L") - self._head("finger1-3.L")))
        for joint, share in (("1", 0.15), ("2", 0.4), ("3", 0.5)):
            turns[f"finger1-{joint}"] = _turn(axis, share * arm.curl)
        return turns

    def _girdle(self, aim: NDArray) -> NDArray:
        """Shoulder-blade rotation: it lifts with the arm, and follows it forwards and back."""
        lift = np.rad2deg(np.arccos(np.clip(-aim[2], -1, 1)))
        raised = 0.3 * max(lift - 40.0, 0.0) - 0.1 * max(40.0 - lift, 0.0)
        return _turn(Z, 12.0 * aim[1] - 6.0 * max(-aim[0], 0.0)) @ _turn(Y, -raised)

    def _reach(self, arm: Arm, girdle: NDArray) -> tuple[NDArray, NDArray, float]:
        """Two-bone inverse kinematics: upper arm direction, elbow axis, elbow flexion."""
        assert arm.reach is not None
        clavicle, blade = self._head("clavicle.L"), self._head("shoulder01.L")
        half = Rotation.from_rotvec(0.5 * Rotation.from_matrix(girdle).as_rotvec()).as_matrix()
        shoulder = clavicle + half @ (blade - clavicle) + girdle @ (self.shoulder - blade)
        wish = np.array([arm.reach[0], -arm.reach[1], arm.reach[2]]) * (self.upper + self.fore)
        towards = self.shoulder + wish - shoulder
        a, b = self.upper, self.fore
        distance = np.clip(np.linalg.norm(towards), 0.35 * (a + b), 0.995 * (a + b))
        towards = _unit(towards)
        inner = np.arccos((a * a + distance**2 - b * b) / (2 * a * distance))
        bend = 180 - np.rad2deg(np.arccos((a * a + b * b - distance**2) / (2 * a * b)))
        pole = np.array([0.5, 0.2 - 0.4 * towards[2], -0.8])
        pole = _turn(towards, arm.swivel) @ _unit(pole - (pole @ towards) * towards)
        u1 = np.cos(inner) * towards + np.sin(inner) * pole
        return u1, _unit(np.cross(u1, towards)), float(bend)

    def _leg(self, leg: Leg) -> dict[str, NDArray]:
        turn = _turn(-X, leg.hip) @ _turn(Y, -leg.abduction) @ _turn(Z, leg.rotation)
        swing, twist = _split_twist(turn, self.thigh)
        hinge = _unit(X - (X @ self.thigh) * self.thigh)
        foot = _turn(-X, leg.ankle)
        turns = {
            "upperleg01": swing @ _turn(self.thigh, 0.4 * twist),
            "upperleg02": _turn(self.thigh, 0.6 * twist),
            "lowerleg01": _turn(hinge, leg.knee - 4.0),
            "foot": foot,
        }
        return turns | {f"toe{i}-1": _turn(-X, leg.toes) for i in range(1, 6)}

    def skin(self, pose: Pose) -> NDArray:
        """Posed vertices (V, 3) of the full body, the pelvis where it is at rest."""
        body = self.body
        turned = blend(body.vertices, body.weights, body.parents, *self.bone_transforms(pose))
        return self._mush.apply(turned)
