"""Many frames of one model at once: handle positions, their derivatives, and shapes."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from deformer.editing.green_functions import HandleBasis
from deformer.geometry import FloatArray
from deformer.linalg import over_parts

# Steps of the local rotation fits: in the first round and in later ones.
FIRST_TURNS = 8
TURNS = 2

Boolean = NDArray[np.bool_]


class Frames(Protocol):
    """What a sequence needs of the model, for m codes (m, K) at once."""

    def by_landmarks(self, z: FloatArray) -> FloatArray:
        """Handle positions (m, H, 3) by landmarks, relative to the shape's centroid."""
        ...

    def jacobians(self, z: FloatArray) -> FloatArray:
        """Their derivatives (m, H, 3, K)."""
        ...

    def by_all(self, z: FloatArray) -> FloatArray:
        """Handle positions (m, H, 3) by all vertices."""
        ...

    def shapes(
        self,
        z: FloatArray,
        Q: FloatArray,
        origin: FloatArray,
        goals: FloatArray,
        held: Boolean,
        rounds: int,
        out: FloatArray,
    ) -> None:
        """Shapes of codes, turned by Q (m, 3, 3) and moved to origins (m, 3), into out (m, V, 3).

        Where held (m, H) is set the handle meets its goal (m, H, 3), and the frame goes through
        `rounds` of rigid relaxation.
        """
        ...


class NumbaFrames:
    """`Frames` on all cores, every core with frames of its own.

    Args:
        basis: with its handles taken.
    """

    def __init__(self, basis: HandleBasis) -> None:
        """Take over the handles."""
        self._basis = basis
        self._handles = basis.landmark_positions()
        self._count = len(basis.vertices)

    def by_landmarks(self, z: FloatArray) -> FloatArray:
        """Handle positions (m, H, 3) by landmarks, relative to the shape's centroid."""
        out = np.empty((len(z), self._count, 3))

        def evaluate(part: range) -> None:
            for m in part:
                out[m] = self._handles.at(z[m]).positions

        over_parts(evaluate, len(z))
        return out

    def jacobians(self, z: FloatArray) -> FloatArray:
        """Their derivatives (m, H, 3, K)."""
        out = np.empty((len(z), self._count, 3, z.shape[1]))

        def differentiate(part: range) -> None:
            for m in part:
                out[m] = self._handles.at(z[m]).derivative()

        over_parts(differentiate, len(z))
        return out

    def by_all(self, z: FloatArray) -> FloatArray:
        """Handle positions (m, H, 3) by all vertices."""
        out = np.empty((len(z), self._count, 3))

        def decode(part: range) -> None:
            surface = self._basis.surface.copy()
            for m in part:
                out[m] = surface.decode(z[m])

        over_parts(decode, len(z))
        return out

    def shapes(
        self,
        z: FloatArray,
        Q: FloatArray,
        origin: FloatArray,
        goals: FloatArray,
        held: Boolean,
        rounds: int,
        out: FloatArray,
    ) -> None:
        """Shapes of codes, moved, with the held handles at their goals."""
        vertices, basis = self._basis.vertices, self._basis

        def rebuild(part: range) -> None:
            surface = basis.surface.copy()
            surface.set_handles_by_block(np.empty(0, dtype=np.int64), [])
            for m in part:
                targets = (goals[m, held[m]] - origin[m]) @ Q[m]
                basis.set_exact(vertices[held[m]], surface)
                surface.reset()
                surface.decode(z[m])
                surface.solve()
                surface.move_to_targets(targets)
                for n in range(rounds if held[m].any() else 0):
                    surface.relax(TURNS if n else FIRST_TURNS)
                    surface.solve()
                    surface.move_to_targets(targets)
                out[m] = surface.positions(Q[m], origin[m])
                out[m, vertices[held[m]]] = goals[m, held[m]]

        over_parts(rebuild, len(z))
