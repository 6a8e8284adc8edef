"""Positions of all vertices of a state: decoded, and deformed as rigidly as possible to handles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from deformer.editing.arap import DecodedSurface
from deformer.editing.green_functions import HandleBasis
from deformer.editing.lifted_surface import LiftedSurface, Surface
from deformer.editing.refinement import State
from deformer.editing.relaxation import relaxation
from deformer.editing.search import CodeSearch
from deformer.geometry import FloatArray, IntArray, RowPoint

# Steps of the local rotation fits in a frame of a drag, which continues from the frame before.
_FRAME_ROTATION_STEPS = 1
# Rounds of the full relaxation in a call at rest: at most so many, of so many vertices in all, for
# a drag that begins waits for the call to end.
_ROUNDS_A_CALL, _VERTICES_A_CALL = 5, 50_000


@dataclass(eq=False)
class _Relaxing:
    """A full relaxation, as far as it has come.

    Args:
        surface: a copy of the solver's.
        rounds: yields the positions (V, 3) after each round.
        vertices: (V, 3) the last ones.
    """

    surface: DecodedSurface
    rounds: Iterator[FloatArray]
    vertices: FloatArray

    def advance(self) -> bool:
        """Do some rounds; True if no more are needed."""
        count = min(_ROUNDS_A_CALL, max(1, _VERTICES_A_CALL // len(self.vertices)))
        done = list(islice(self.rounds, count))
        self.vertices = done[-1] if done else self.vertices
        return len(done) < count


class PosedSurface:
    """The surface of a solver's states, with the rigid relaxation for the handles that it reaches.

    Exact handles are at their targets. Soft ones are, if the model has an error of its own, where
    its expected share of their error puts them. Otherwise the surface does not reach for them; but
    beside exact ones they stay where the code has them, and with their gaps where these put them:
    reaching the exact ones would pull the surface off their targets.

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
        # The surface of the last frame, which has the present rotations.
        self._last: Surface = basis.surface
        self._exact = basis.exact_handles([])
        self._points: list[RowPoint] = []
        self._index: IntArray = np.zeros(0, dtype=np.int64)
        self.hard: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self._gaps = np.zeros((0, 3))
        self._forget_rest()

    def set_exact(self, hard: NDArray[np.bool_], gaps: FloatArray) -> None:
        """Choose the exact handles among the basis's points.

        To be called whenever the energy's handles have changed. Rigid relaxation has the handles in
        an order of their own: sums depend on it in their last digits, and the basis's order on
        which handles there were before.

        Args:
            hard: (H,) true for exact handles.
            gaps: (H, 3) vectors from the energy's targets to those of the surface.
        """
        if not np.array_equal(gaps, self._gaps):
            self._forget_rest()
        self._gaps = gaps
        energy = self._search.energy
        reached = hard | bool(hard.any() or gaps.any() or energy.misfit)
        if energy.floor is not None:
            reached[energy.floor.rows] = hard[energy.floor.rows]
        reaching = np.flatnonzero(reached).tolist()
        reaching.sort(key=lambda n: _place(self._basis.points[n]))
        self._index = np.array(reaching, dtype=np.int64)
        points = [self._basis.points[n] for n in self._index]
        if points != self._points or not np.array_equal(hard, self.hard):
            self._forget_rest()
        if points != self._points:
            self._points, self._exact = points, self._basis.set_exact(points)
            if not points:
                self._last.reset()
        self.hard = hard

    def _forget_rest(self) -> None:
        self._relaxing: _Relaxing | None = None
        self._rest: FloatArray | None = None  # (V, 3) at rest

    @property
    def rests(self) -> bool:
        """True once `settled` no longer changes, until the next frame."""
        return self._rest is not None

    def frame(self, state: State) -> FloatArray:
        """Positions (V, 3) of a state, with the rotations that the last frame's relaxation left.

        The state or its targets may be others than before.
        """
        self._forget_rest()
        return self._next_frame(state)

    def _next_frame(self, state: State) -> FloatArray:
        self._search.decode(state)
        surface = state.surface
        self._continue_on(surface)
        vertices = self._solved(surface, state)
        if self._relaxes:
            surface.relax(_FRAME_ROTATION_STEPS)
        return vertices

    def _continue_on(self, surface: Surface) -> None:
        """Give a surface the present rotations."""
        last, self._last = self._last, surface
        if surface is last:
            return
        if isinstance(surface, LiftedSurface):
            surface.restrict_rotations()
        elif isinstance(last, LiftedSurface):
            last.prolong_rotations()

    def relaxed(self, state: State) -> FloatArray:
        """Positions (V, 3) of a state after a full relaxation: they depend on nothing else.

        Args:
            state: by all vertices.
        """
        self._forget_rest()
        self._last = self._surface
        self._surface.reset()
        self._search.decode(state)
        *_, vertices = self._relaxation(self._surface, state)
        self._rest = vertices
        return vertices.copy()

    def settled(self, state: State) -> FloatArray:
        """Positions (V, 3) of a state that stays, by all vertices: after some calls, `relaxed`'s.

        Each call does a few rounds of a full relaxation on a copy, and gives a frame until it ends.

        Args:
            state: its unknowns x are those of the last call, and its targets as well.
        """
        if self._rest is None and not self._relaxes:
            self._rest = self._next_frame(state)
        if self._rest is not None:
            return self._rest.copy()
        if self._relaxing is None:
            self._relaxing = self._begun(state)
        relaxing = self._relaxing
        if not relaxing.advance():
            return self._next_frame(state)
        self._forget_rest()
        self._rest = relaxing.vertices
        self._last = self._surface
        self._surface.take_rotations(relaxing.surface)
        return relaxing.vertices.copy()

    @property
    def _relaxes(self) -> bool:
        return bool(len(self._exact) and self.rounds)

    def _begun(self, state: State) -> _Relaxing:
        surface = self._surface.copy()
        self._basis.set_exact(self._points, surface)
        surface.decode(self._search.energy.code(state.x))
        rounds = self._relaxation(surface, state)
        return _Relaxing(surface, rounds, next(rounds))

    def _relaxation(self, surface: DecodedSurface, state: State) -> Iterator[FloatArray]:
        """Positions (V, 3) of a state before any round of relaxation, and after each."""
        rounds = self.rounds if len(self._exact) else 0
        return relaxation(surface, lambda: self._solved(surface, state), rounds)

    def _solved(self, surface: Surface, state: State) -> FloatArray:
        """Positions (V, 3) by a surface's present rotations, handles where they are to be."""
        motion = self._search.energy.rigid_motion(state.x)
        return self._exact.solve(surface, *motion, self._goals(state)[self._index])

    def _goals(self, state: State) -> FloatArray:
        """Where the shape of a state deforms to: exact handles at their targets, soft ones near."""
        energy = self._search.energy
        targets = energy.targets + self._gaps  # of the surface
        if self.hard.all() or not len(self._index):
            return targets
        at = energy.move(state.x, state.p)
        near = at + energy.model_error(at) + self._gaps
        return np.where(self.hard[:, None], targets, near)


def _place(point: RowPoint) -> tuple[tuple[int, ...], tuple[float, ...], float]:
    """Where a handle is on the mesh, for sorting."""
    if isinstance(point, int):
        return (point,), (1.0,), 0.0
    return point.vertices, point.weights, point.offset
