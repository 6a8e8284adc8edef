"""Regions of the body that its components are named after, from the bones that move the skin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from humanoid.body import Body

_HAND = ("wrist", "finger", "metacarpal")
_FOOT = ("foot", "toe")
_ARM = ("upperarm", "lowerarm", *_HAND)
_CHEST = ("spine01", "spine02", "spine03", "clavicle", "shoulder")
_HEAD = ("neck", "head", "eye")
# Name on one side, name of both sides, and how the names of its bones begin. A lower part has the
# bones that follow it, which turn with it.
_LIMBS = (
    ("arm", "Arms", _ARM),
    ("upper arm", "Upper arms", ("upperarm",)),
    ("forearm", "Forearms", ("lowerarm", *_HAND)),
    ("hand", "Hands", _HAND),
    ("leg", "Legs", ("upperleg", "lowerleg", *_FOOT)),
    ("upper leg", "Upper legs", ("upperleg",)),
    ("lower leg", "Lower legs", ("lowerleg", *_FOOT)),
    ("foot", "Feet", _FOOT),
)
_MIDDLE = {
    "Head": _HEAD,
    "Chest": _CHEST,
    "Waist": ("spine04", "spine05"),
    "Hips": ("root", "pelvis"),
    "Upper body": (*_CHEST, *_HEAD, *_ARM),
    "Whole body": ("",),
}


def body_regions(body: Body) -> dict[str, NDArray]:
    """Name of a region → (V,) share of every vertex that its bones move. Left is the body's own."""

    def share(bones: tuple[str, ...], side: str = "") -> NDArray:
        inside = [name.startswith(bones) and name.endswith(side) for name in body.labels]
        return body.weights @ np.array(inside, dtype=float)

    regions = {name: share(bones) for name, bones in _MIDDLE.items()}
    for name, both, bones in _LIMBS:
        regions[f"Left {name}"] = share(bones, ".L")
        regions[f"Right {name}"] = share(bones, ".R")
        regions[both] = share(bones)
    return regions
