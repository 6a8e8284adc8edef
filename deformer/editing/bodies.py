"""How far the whole body of a handle fit may turn and travel, as a choice of the user."""

from __future__ import annotations

from typing import Literal

import numpy as np

from deformer.checks import LARGEST, checked_choice, checked_number
from deformer.geometry import FloatArray
from deformer.model import RigidPrior

Body = Literal["auto", "stays", "moves"]
"""How free the whole body is.

"stays" keeps it about where it is, "moves" lets it go wherever handles are, "auto" keeps it under
gentle pulls and yields to strong ones.
"""
BODIES: tuple[Body, ...] = ("auto", "stays", "moves")
"""The values of `Body`."""
# A factor on the standard deviations of `DIFFUSE_PRIOR`, "auto", or None for the training shapes'.
Freedom = float | Literal["auto"] | None

_FREEDOMS: dict[str, float | Literal["auto"]] = {"auto": "auto", "stays": 0.01, "moves": 1.0}
# Standard deviations (rad, bounding diagonals) of a body that yields, and δ, how many of them it
# moves before its resistance stops growing.
_YIELDING = RigidPrior(0.02, 0.01)
_DELTA = 1.5


def checked_freedom(freedom: object) -> Freedom:
    """The freedom of a body by its name, or by a number; None is None.

    Raises:
        InputError: another text, or a number that is not positive.
    """
    if freedom is None:
        return None
    if isinstance(freedom, str):
        return _FREEDOMS[checked_choice(freedom, "freedom", BODIES)]
    return checked_number(freedom, "freedom", above=0, most=LARGEST)


def yielding_stiffness(motion: FloatArray) -> tuple[FloatArray, float]:
    """Weights of the squared rigid motion of a body that yields, and the constant beside them.

    The motion costs ρ(s) = 2 δ² (√(1 + s/δ²) − 1), the pseudo-Huber function of its squared length
    s in standard deviations: s of a small motion, 2 δ √s of a large one. The resistance grows up to
    that of δ deviations and no further. The cost is convex, and does not depend on the number of
    handles: one that is placed where the surface is changes nothing. With the weight w = ρ'(s) of
    the squared motion, ρ = w s + constant.

    Args:
        motion: (6,) rotation vector in radians, translation in bounding diagonals.

    Returns:
        (6,) weights, and the constant.
    """
    stiffness = _YIELDING.stiffness()
    s = float(stiffness @ motion**2)
    root = float(np.sqrt(1.0 + s / _DELTA**2))
    return stiffness / root, 2.0 * _DELTA**2 * (root - 1.0) - s / root
