"""Rigid relaxation of a decoded surface until it stays: local and global steps with momentum."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from deformer.editing.arap import DecodedSurface
from deformer.editing.momentum import Momentum
from deformer.geometry import FloatArray

# Newton steps of the local rotation fits: in the first round, and in each later one.
FIRST_ROTATION_STEPS, ROTATION_STEPS = 60, 10
# A round that moves no vertex by this much, in bounding diagonals, is the last one.
_RELAXED = 2e-5


def relaxation(
    surface: DecodedSurface, solve: Callable[[], FloatArray], rounds: int
) -> Iterator[FloatArray]:
    """Positions (V, 3) before any round of relaxation, and after each until they stay.

    Momentum takes a third of the rounds of over-relaxed steps, which the frames of a drag have.

    Args:
        surface: has exact handles and the gradients of a code; its rotations are where it starts.
        solve: gives the positions by the surface's present rotations, handles at their targets.
        rounds: the most rounds.
    """
    vertices = solve()
    yield vertices
    momentum = Momentum()
    for n in range(rounds):
        surface.move_on(momentum)
        surface.relax(ROTATION_STEPS if n else FIRST_ROTATION_STEPS, over=1.0)
        before, vertices = vertices, solve()
        yield vertices
        if np.abs(vertices - before).max() < _RELAXED * surface.unit:
            break
