"""Lowers a handle energy to its minimum: landmarks find the steps, all vertices the energy."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from deformer.editing.energy import HandleEnergy
from deformer.editing.green_functions import HandleBasis
from deformer.editing.handle_positions import CorrectedHandlePositions
from deformer.editing.lifted_surface import Surface
from deformer.geometry import FloatArray

# Steps with one derivative by all vertices, the relative gain that ends them, and the most such
# derivatives.
_STEPS = 40
_GAIN = 1e-8
_REFINEMENTS = 10
# Shares of a refining step, tried in turn until one lowers the exact energy.
_SHARES = (1.0, 0.3, 0.1, 0.03)


@dataclass(frozen=True, eq=False)
class State:
    """Unknowns with their handle positions and energy.

    Args:
        x: (K+6,) unknowns.
        p: (H, 3) handle positions by all vertices, or by nodes while handles move, relative to the
            shape's centroid.
        energy: energy at x.
        surface: which decoded the positions.
    """

    x: FloatArray
    p: FloatArray
    energy: float
    surface: Surface


@dataclass(frozen=True, eq=False)
class Correction:
    """Error of the landmarks' derivative at unknowns x (K+6,): (H, 3, K), to be added to it."""

    x: FloatArray
    derivative: FloatArray


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where a descent has ended.

    Args:
        energy: the energy that was lowered.
        state: the state of its least value.
        correction: of the landmarks' derivative there.
    """

    energy: HandleEnergy
    state: State
    correction: Correction | None


class Evaluate(Protocol):
    """Gives the state of unknowns x (K+6,) by all vertices, for an energy."""

    def __call__(self, x: FloatArray, energy: HandleEnergy, /) -> State:
        """Decode, and compute the energy."""
        ...


class Refinement:
    """Descents near a minimum, by landmarks whose derivative is corrected by that of all vertices.

    Args:
        basis: the model's handles.
        evaluate: decodes all vertices.
        relative_gain: ends a descent.
    """

    def __init__(
        self, basis: HandleBasis, evaluate: Evaluate, relative_gain: float = _GAIN
    ) -> None:
        """Store the arguments."""
        self._basis, self._evaluate, self.relative_gain = basis, evaluate, relative_gain

    def converge(
        self, energy: HandleEnergy, state: State, lowest: float = np.inf
    ) -> Generator[int, None, Minimum]:
        """Refine a state until its energy no longer falls.

        Args:
            energy: the energy to lower.
            state: to start from.
            lowest: energy of another minimum; the refinement ends, too, where the last gain is
                less than what is missing to it.

        Yields:
            The steps of each refinement.

        Returns:
            The minimum.
        """
        correction = None
        for _ in range(_REFINEMENTS):
            before, correction = state, self.correction(energy, state, correction)
            state, steps = self.refine(energy, before, correction)
            yield steps
            gain = before.energy - state.energy
            if gain <= self.relative_gain * before.energy or gain < state.energy - lowest:
                break
        return Minimum(energy, state, correction)

    def correction(
        self, energy: HandleEnergy, state: State, known: Correction | None = None
    ) -> Correction:
        """The correction of the landmarks' derivative at a state: a known one, if it is that."""
        if known is not None and np.array_equal(known.x, state.x):
            return known
        z = energy.code(state.x)
        exact, landmarks = self._basis.exact_positions(), self._basis.landmark_positions()
        return Correction(state.x, exact.at(z).derivative() - landmarks.at(z).derivative())

    def refine(
        self, energy: HandleEnergy, state: State, correction: Correction
    ) -> tuple[State, int]:
        """Descend by landmarks with a corrected derivative.

        Args:
            energy: the energy to lower.
            state: to start from.
            correction: of a state that is near.

        Returns:
            A state whose energy is not higher, and the steps taken.
        """
        x, _, steps = self.descend(energy, state, correction, _STEPS, self.relative_gain)
        step = x - state.x
        # Far from the state the corrected landmarks may be wrong: a shorter step may be better.
        for share in _SHARES if step.any() else ():
            found = self._evaluate(state.x + share * step, energy)
            if found.energy < state.energy:
                return found, steps
        return state, steps

    def descend(
        self,
        energy: HandleEnergy,
        state: State,
        correction: Correction | None,
        steps: int,
        relative_gain: float,
    ) -> tuple[FloatArray, float, int]:
        """Descend from a state with handle positions by landmarks, which are exact at the state."""
        positions = CorrectedHandlePositions(
            self._basis.landmark_positions(), None if correction is None else correction.derivative
        )
        here = positions.match(energy.code(state.x), state.p)
        return energy.descend(positions, state.x, steps, relative_gain, here)
