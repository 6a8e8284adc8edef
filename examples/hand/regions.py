"""Regions of the hand that its components are named after, from the joints that move the skin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hand.rig import DIGITS, FOREARM, Hand, joints_of


def hand_regions(hand: Hand) -> dict[str, NDArray]:
    """Name of a region → (V,) share of every vertex that its joints move."""

    def share(joints: list[str]) -> NDArray:
        return hand.weights @ np.isin(hand.labels, joints).astype(float)

    regions, palm, knuckles, fingers = {}, ["wrist"], [], []
    for digit in DIGITS:
        # The bone in the palm, the one that bends at the knuckle, and those that follow it.
        first, second, *rest = joints_of(digit)
        if digit == "thumb":
            regions["Thumb"] = share([first, second, *rest])
            regions["Thumb base"] = share([first])
            continue
        regions[f"{digit.capitalize()} finger"] = share([second, *rest])
        regions[f"{digit.capitalize()} finger knuckle"] = share([second])
        palm.append(first)
        knuckles.append(second)
        fingers += [second, *rest]
    regions["Palm"], regions["Wrist"] = share(palm), share([FOREARM])
    regions["Finger knuckles"], regions["Fingers"] = share(knuckles), share(fingers)
    regions["Whole hand"] = 1 - regions["Wrist"]
    return regions
