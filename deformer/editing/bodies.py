"""How far the whole body of a handle fit may turn and travel, as a choice of the user."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from deformer.checks import LARGEST, checked_choice, checked_number
from deformer.geometry import FloatArray
from deformer.model import DeformationModel, RigidPrior

Body = Literal["auto", "stays", "moves"]
"""How free the whole body is.

"stays" keeps it about where it is, "moves" lets it go wherever handles are, "auto" keeps it under
gentle pulls and yields to strong ones. Where most of the surface is still in all examples, as a
face's neck and head are, the first and the last keep it as still (`DeformationModel.travel`).
"""
BODIES: tuple[Body, ...] = ("auto", "stays", "moves")
"""The values of `Body`."""
# Standard deviations (rad, bounding diagonals) of a body that yields, and δ, how many of them it
# moves before its resistance stops growing.
_YIELDING = RigidPrior(0.02, 0.01)
_DELTA = 1.5
# Factor on the standard deviations of `DIFFUSE_PRIOR` of a body that stays; its translation is that
# of `_YIELDING`.
_STAYING = 0.01


@dataclass(frozen=True)
class Yielding:
    """A body that stays under gentle pulls and yields to strong ones.

    Its motion costs ρ(s) = 2 δ² (√(1 + s/δ²) − 1), the pseudo-Huber function of its squared length
    s in standard deviations: s of a small motion, 2 δ √s of a large one. The resistance grows up to
    that of δ deviations and no further. The cost is convex, and does not depend on the number of
    handles: one that is placed where the surface is changes nothing.

    Args:
        share: factor on the standard deviations, at most 1.
    """

    share: float = 1.0

    @cached_property
    def _stiffness(self) -> FloatArray:
        return _YIELDING.stiffness(self.share)

    def stiffness(self, motion: FloatArray) -> tuple[FloatArray, float]:
        """Weights of the squared rigid motion, and the constant beside them.

        With the weight w = ρ'(s) of the squared motion, ρ = w s + constant.

        Args:
            motion: (6,) rotation vector in radians, translation in bounding diagonals.

        Returns:
            (6,) weights, and the constant.
        """
        s = float(self._stiffness @ motion**2)
        root = float(np.sqrt(1.0 + s / _DELTA**2))
        return self._stiffness / root, 2.0 * _DELTA**2 * (root - 1.0) - s / root


# A factor on the standard deviations of `DIFFUSE_PRIOR`, or None for the training shapes'.
Freedom = float | Yielding | None


def checked_freedom(freedom: object, model: DeformationModel) -> Freedom:
    """The freedom of a model's body by its name, or by a number; None is None.

    Raises:
        InputError: another text, or a number that is not positive.
    """
    if freedom is None:
        return None
    if not isinstance(freedom, str):
        return checked_number(freedom, "freedom", above=0, most=LARGEST)
    name = checked_choice(freedom, "freedom", BODIES)
    if name == "moves":
        return 1.0
    share = min(model.travel / _YIELDING.translation, 1.0)
    return Yielding(share) if name == "auto" else _STAYING * share
