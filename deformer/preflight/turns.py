"""Single shapes that are turned as a whole."""

from __future__ import annotations

import numpy as np

from deformer.geometry import IntArray
from deformer.preflight.local_rotations import LocalRotations, distances, rotation_angles
from deformer.preflight.neighbours import beside, odd_ones
from deformer.preflight.report import Finding, Labels
from deformer.preflight.statistics import evenly

# Angle from which on a shape is turned against its neighbours.
_TURNED = np.radians(30.0)
# Turning it back multiplies its distance from the most alike shape by less than _CLOSER, and makes
# it as small as usual between neighbours or multiplies it by less than _PROOF.
_CLOSER, _PROOF = 0.4, 0.1
_COMPARED = 200


def rotated(local: LocalRotations, shapes: IntArray, label: Labels) -> list[Finding]:
    """Warnings of single shapes that are turned as a whole against quiet neighbours.

    Args:
        local: of all shapes.
        shapes: (n,) those with nothing else wrong.
        label: names shapes.
    """
    odd = odd_ones(shapes, local.angles, _TURNED)
    findings = []
    for n, near in odd.items():
        others = shapes[shapes != n]
        others = np.union1d(others[evenly(len(others), _COMPARED)], near)
        C, R = local.between(n, others)
        after, angles = distances(C, R), rotation_angles(R)
        best = int(after.argmin())
        # The most alike shape is no neighbour: the set is in no order, and all of it is compared.
        if others[best] in odd or (others[best] not in near and angles.min() < _TURNED):
            continue
        gain = after[best] / distances(C)[best]
        C, R = local.between(near[:-1], near[1:])
        if gain > _CLOSER or (gain > _PROOF and after[best] > np.median(distances(C))):
            continue
        findings.append(
            Finding(
                "warning",
                "rotated",
                f"{label([n])} is turned by {np.degrees(angles[best]):.0f}° as a whole against its "
                "neighbours, which turn by at most "
                f"{np.degrees(rotation_angles(R).max()):.0f}° from one to the next, expected an "
                "orientation near theirs; turn it back",
                (n,),
                values={"like": int(others[best]), "between": beside(near, n).tolist()},
            )
        )
    return findings
