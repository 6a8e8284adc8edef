"""Positions of all vertices of a state: decoded, and deformed as rigidly as possible to handles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from deformer.editing.arap import DecodedSurface
from deformer.editing.green_functions import HandleBasis
from deformer.editing.search import CodeSearch, State
from deformer.geometry import FloatArray, IntArray, RowPoint

# Steps of the local rotation fits: in a frame of a drag, which continues from the frame before; in
# the first round of a full relaxation; in each later round.
_FRAME_ROTATION_STEPS = 1
_FIRST_ROTATION_STEPS = 60
_ROTATION_STEPS = 10
# A round of relaxation that moves no vertex by this much, in bounding diagonals, is the last one.
_RELAXED = 2e-5
# At rest: rounds of the full relaxation a call; the way of a vertex in one call from the last
# frame's pose to the relaxed one, in bounding diagonals, and the most calls that this takes.
_ROUNDS_A_CALL = 5
_STRIDE, _STRIDES = 2e-3, 30


@dataclass(eq=False)
class _Relaxing:
    """A full relaxation, as far as it has come.

    Args:
        state: whose shape it relaxes.
        surface: a copy of the solver's.
        rounds: yields the positions (V, 3) after each round.
        vertices: (V, 3) the last ones.
    """

    state: State
    surface: DecodedSurface
    rounds: Iterator[FloatArray]
    vertices: FloatArray

    def advance(self) -> bool:
        """Do some rounds; True if no more are needed."""
        done = list(islice(self.rounds, _ROUNDS_A_CALL))
        self.vertices = done[-1] if done else self.vertices
        return len(done) < _ROUNDS_A_CALL


@dataclass(eq=False)
class _Fading:
    """What a drag's frames have ahead of the relaxed pose, which shrinks to zero in equal steps.

    Args:
        offset: (V, 3) at first.
        steps: in all.
        left: steps left.
    """

    offset: FloatArray
    steps: int
    left: int

    def next(self) -> FloatArray:
        """The offset (V, 3) one step later."""
        self.left -= 1
        return self.left / self.steps * self.offset


class PosedSurface:
    """The surface of a solver's states, with the rigid relaxation for the handles that it reaches.

    Exact handles are at their targets. Soft ones are, if the model has an error of its own, where
    its expected share of their error puts them; otherwise the surface does not reach for them.

    Args:
        search: finds the states; its energy has the handles.
        basis: the model's handles.
        rounds: the most rounds of relaxation.

    Attributes:
        rounds: as given.
        hard: (H,) true for exact handles among the basis's points.
    """

    def __init__(self, search: CodeSearch, basis: HandleBasis, rounds: int) -> None:
        """Start without handles."""
        self._search, self._basis, self.rounds = search, basis, rounds
        self._surface = basis.surface
        self._exact = basis.exact_handles([])
        self._points: list[RowPoint] = []
        self._index: IntArray = np.zeros(0, dtype=np.int64)
        self.hard: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self._forget_rest()
        self._fading: _Fading | None = None

    def set_exact(self, hard: NDArray[np.bool_]) -> None:
        """Choose the exact handles among the basis's points.

        To be called whenever the energy's handles have changed.

        Args:
            hard: (H,) true for exact handles.
        """
        reaching = hard | (self._search.energy.misfit > 0)
        self._index = np.flatnonzero(reaching)
        points = [self._basis.points[n] for n in self._index]
        if points != self._points or not np.array_equal(hard, self.hard):
            self._forget_rest()
        if points != self._points:
            self._points, self._exact = points, self._basis.set_exact(points)
            if not points:
                self._surface.reset()
        self.hard = hard

    def _forget_rest(self) -> None:
        self._relaxing: _Relaxing | None = None
        self._rest: tuple[State, FloatArray] | None = None

    def at_rest(self, state: State) -> bool:
        """True once `settled` of this state no longer changes."""
        return self._rest is not None and self._rest[0] is state and self._fading is None

    def frame(self, state: State) -> FloatArray:
        """Positions (V, 3) of a state, with the rotations that the last frame's relaxation left."""
        vertices = self._frame(state)
        if self._fading is not None:
            vertices = self._faded(vertices)
        return vertices

    def _frame(self, state: State) -> FloatArray:
        self._search.decode(state)
        vertices = self._solved(self._surface, state)
        if self._relaxes:
            self._surface.relax(_FRAME_ROTATION_STEPS)
        return vertices

    def relaxed(self, state: State) -> FloatArray:
        """Positions (V, 3) of a state after a full relaxation: they depend on nothing else."""
        self._forget_rest()
        self._fading = None
        self._surface.reset()
        self._search.decode(state)
        *_, vertices = self._relaxation(self._surface, state)
        self._rest = state, vertices
        return vertices.copy()

    def jumped(self, before: State, state: State) -> FloatArray:
        """Positions (V, 3) after a jump to another minimum: on the way to those of `relaxed`.

        Args:
            before: the state of the last frame, for the same handles.
            state: the present one.
        """
        last = self.frame(before)
        return self._approach(state, last, self.relaxed(state))

    def settled(self, state: State) -> FloatArray:
        """Positions (V, 3) of a state that stays: call by call nearer to those of `relaxed`.

        A few rounds of a full relaxation are done in each call, on a copy, while the frames go on;
        then these come to its result by small steps.
        """
        if self._rest is not None and self._rest[0] is state:
            vertices = self._rest[1]
            return vertices.copy() if self._fading is None else self._faded(vertices)
        if not self._relaxes:
            self._rest = state, self._frame(state)
            return self.settled(state)
        if self._relaxing is None or self._relaxing.state is not state:
            self._relaxing = self._begun(state)
        relaxing = self._relaxing
        ended, frame = relaxing.advance(), self.frame(state)
        if not ended:
            return frame
        vertices = relaxing.vertices
        self._forget_rest()
        self._rest = state, vertices
        self._surface.take_rotations(relaxing.surface)
        return self._approach(state, frame, vertices)

    def _approach(self, state: State, last: FloatArray, vertices: FloatArray) -> FloatArray:
        """Positions (V, 3) one step from the last frame's towards a state's relaxed ones."""
        offset = last - vertices
        away = np.linalg.norm(offset, axis=1).max() / self._search.energy.diagonal
        steps = min(int(np.ceil(away / _STRIDE)), _STRIDES)
        self._fading = _Fading(offset, steps, steps) if steps else None
        return self.settled(state)

    @property
    def _relaxes(self) -> bool:
        return bool(len(self._exact) and self.rounds)

    def _begun(self, state: State) -> _Relaxing:
        surface = self._surface.copy()
        self._basis.set_exact(self._points, surface)
        surface.decode(self._search.energy.code(state.x))
        rounds = self._relaxation(surface, state)
        return _Relaxing(state, surface, rounds, next(rounds))

    def _relaxation(self, surface: DecodedSurface, state: State) -> Iterator[FloatArray]:
        """Positions (V, 3) before any round of relaxation, and after each until they stay."""
        vertices = self._solved(surface, state)
        yield vertices
        for n in range(self.rounds if len(self._exact) else 0):
            surface.relax(_ROTATION_STEPS if n else _FIRST_ROTATION_STEPS)
            before, vertices = vertices, self._solved(surface, state)
            yield vertices
            if np.abs(vertices - before).max() < _RELAXED * self._search.energy.diagonal:
                break

    def _solved(self, surface: DecodedSurface, state: State) -> FloatArray:
        """Positions (V, 3) by a surface's present rotations, handles where they are to be."""
        motion = self._search.energy.rigid_motion(state.x)
        return self._exact.solve(surface, *motion, self._goals(state)[self._index])

    def _goals(self, state: State) -> FloatArray:
        """Where the shape of a state deforms to: exact handles to their targets, soft ones near."""
        energy = self._search.energy
        if self.hard.all() or not energy.misfit:
            return energy.targets
        at = energy.move(state.x, state.p)
        return np.where(self.hard[:, None], energy.targets, at + energy.model_error(at))

    def _faded(self, vertices: FloatArray) -> FloatArray:
        """Positions (V, 3) that are on their way to `vertices`; exact handles are there already."""
        assert self._fading is not None
        vertices = vertices + self._fading.next()
        if not self._fading.left:
            self._fading = None
        at = self._exact.points.at(vertices)
        targets, hard = self._search.energy.targets[self._index], self.hard[self._index, None]
        self._exact.correct(vertices, np.where(hard, targets, at))
        return vertices
