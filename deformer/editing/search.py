"""Minimises the energy of a handle fit: from several starts, or for one frame of a drag.

Descents use handle positions by a few landmark vertices (cubature). All vertices then give the
exact energy, and near the minimum their derivative corrects that of the landmarks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deformer.editing.energy import HandleEnergy
from deformer.editing.green_functions import HandleBasis
from deformer.editing.handle_positions import CorrectedHandlePositions, HandlePositions
from deformer.editing.unknowns import MOTION, Unknowns
from deformer.geometry import FloatArray, spread
from deformer.model import LatentPrior

# A cold solve evaluates _CANDIDATES training codes spread over the latent space, descends from the
# prior's mean and the _STARTS codes of least energy, and refines the _FINISHED lowest results.
_CANDIDATES = 32
_STARTS = 3
_START_STEPS = 40
_FINISHED = 2
# A frame of a drag: steps, the relative gain that ends them, and how far (relative, and in units
# of the energy) the exact energy may lie above the landmarks' estimate.
_FRAME_STEPS = 4
_FRAME_GAIN = 5e-2
_ESTIMATE_TOLERANCE = 0.05
# Refinement (of a cold solve, or of a frame with unchanged targets): steps with one derivative by
# all vertices, the relative gain that ends them, and the most such derivatives of a cold solve.
_FINAL_STEPS = 40
_FINAL_GAIN = 1e-8
_REFINEMENTS = 10
# Warm solves with unchanged targets that gain less than _RESTING try other minima. A start is worth
# refining if its estimate is at most this share above the energy, unless it ends within _SAME (in
# standard deviations) of the state; the result replaces the state if its energy is lower by _LOWER.
_RESTING = 1e-2
_WORTH_REFINING = 0.1
_SAME = 0.05
_LOWER = 5e-3
# Shares of a refining step, tried in turn until one lowers the exact energy.
_SHARES = (1.0, 0.3, 0.1, 0.03)


@dataclass(frozen=True, eq=False)
class State:
    """Unknowns with their exact handle positions and energy.

    Args:
        x: (K+6,) unknowns.
        p: (H, 3) handle positions by all vertices, relative to the shape's centroid.
        energy: energy at x.
    """

    x: FloatArray
    p: FloatArray
    energy: float


@dataclass(frozen=True, eq=False)
class _Correction:
    """Error of the landmarks' derivative at unknowns x (K+6,): (H, 3, K), to be added to it."""

    x: FloatArray
    derivative: FloatArray


@dataclass(eq=False)
class _Cache:
    """Results of one solve that the next one reuses.

    Args:
        x: (K+6,) unknowns of the last solution.
        state: these unknowns with the positions of the present handles; None after the handle
            vertices have changed.
        decoded: the state whose deformation gradients the surface has.
        correction: correction of the landmarks' derivative.
        solved_for: targets and weights of the last solve.
        starts: what is left of the starts of a cold solve, with their energies, since the handles
            are at rest; None while they move.
        other: a state on its way to another minimum, and its correction.
    """

    x: FloatArray | None = None
    state: State | None = None
    decoded: State | None = None
    correction: _Correction | None = None
    solved_for: tuple[FloatArray, FloatArray] | None = None
    starts: list[tuple[HandleEnergy, FloatArray]] | None = None
    other: tuple[State, _Correction | None] | None = None

    def invalidate(self, *, vertices: bool = False) -> None:
        """Drop the results that a changed energy invalidates; the unknowns x stay.

        Args:
            vertices: true if the handle vertices have changed, too.
        """
        self.correction = self.solved_for = None
        self.forget_starts()
        if vertices:
            self.state = None

    def forget_starts(self) -> None:
        """Drop what was tried at rest, because the handles have moved."""
        self.starts = self.other = None


class CodeSearch:
    """Minimises a handle energy over the latent code and the rigid motion.

    Args:
        energy: energy of the model without handles.
        basis: the model's handles; its surface has the gradients of the last code decoded.
        codes: (N, K) training codes, some of which are starts of a cold search.

    Attributes:
        jumped: true if the last warm solve ended in another minimum than it began in.
    """

    def __init__(self, energy: HandleEnergy, basis: HandleBasis, codes: FloatArray) -> None:
        """Choose the candidates; there is no solution yet."""
        self.energy = energy
        self._basis, self._codes = basis, codes
        self._cache = _Cache()
        self.jumped = False
        self._candidates = self._choose_candidates()

    def _choose_candidates(self) -> FloatArray:
        """Whitened training codes (n, K), spread over the latent space."""
        away = (self._codes - self.energy.prior.mean).T
        white: FloatArray = np.asarray(np.linalg.solve(self.energy.factor, away).T, np.float64)
        return white[spread(white, _CANDIDATES)]

    @property
    def solution(self) -> FloatArray | None:
        """Unknowns (K+6,) of the last solution; None before the first."""
        return self._cache.x

    def set_targets(self, targets: FloatArray, weights: FloatArray) -> None:
        """Set the targets (H, 3) and weights (H,) of the basis's handles."""
        self.energy = replace(self.energy, targets=targets, weights=weights)

    def vertices_changed(self) -> None:
        """Drop what depends on the handle vertices; to be called after the basis's have changed."""
        self._cache.invalidate(vertices=True)

    def set_prior(self, energy: HandleEnergy, mean: FloatArray | None) -> None:
        """Change the energy's parameters; the last solution keeps its code and rigid motion.

        Args:
            energy: the new energy; its prior has the old mean.
            mean: (K,) new mean of the prior, or None to keep the old one.
        """
        before, cache = self.energy, self._cache
        self.energy = energy
        if mean is not None:
            self.energy = replace(energy, prior=LatentPrior(mean, before.prior.covariance))
            self._candidates = self._choose_candidates()
        cache.invalidate()
        if cache.x is None:
            return
        last = Unknowns(cache.x)
        cache.x = self.energy.unknowns(before.code(cache.x), last.rotation, last.translation)
        if cache.state is not None:
            p = cache.state.p
            state = State(cache.x, p, self.energy.value(cache.x, p))
            # The code has not changed, so the surface's gradients are still those of the state.
            cache.decoded = state if cache.decoded is cache.state else None
            cache.state = state

    def evaluate(self, x: FloatArray) -> State:
        """State of unknowns x (K+6,): decodes all vertices for the exact energy."""
        p = self._basis.surface.decode(self.energy.code(x))
        state = State(x, p, self.energy.value(x, p))
        self._cache.decoded = state
        return state

    def decode(self, state: State) -> None:
        """Give the surface the deformation gradients of a state."""
        if self._cache.decoded is not state:
            self._basis.surface.decode(self.energy.code(state.x))
            self._cache.decoded = state

    def restart(self, x: FloatArray) -> State:
        """Make x (K+6,) the last solution, independent of what was solved before."""
        self._cache.invalidate()
        return self._keep(self.evaluate(x))

    def _keep(self, state: State) -> State:
        self._cache.x, self._cache.state = state.x, state
        return state

    def cold(self) -> tuple[State, int]:
        """Minimise from several starts, independent of what was solved before.

        Each start descends by landmarks; the two lowest results are refined with all vertices.

        Returns:
            The state of least energy, and the steps taken.
        """
        cache = self._cache
        self._targets_unchanged()
        positions = self._basis.landmark_positions()
        coarse = [
            energy.descend(positions, x, _START_STEPS) for energy, x in self._all_starts(positions)
        ]
        coarse.sort(key=lambda entry: entry[1])
        steps = sum(entry[2] for entry in coarse)
        finished = []
        for x, _, _ in coarse[:_FINISHED]:
            cache.correction = None
            state, more = self._converge(self.evaluate(x))
            steps += more
            finished.append((state, cache.correction))
        state, cache.correction = min(finished, key=lambda entry: entry[0].energy)
        return self._keep(state), steps

    def _converge(self, state: State) -> tuple[State, int]:
        """Refine a state until its energy no longer falls."""
        steps = 0
        for _ in range(_REFINEMENTS):
            before = state
            state, more = self._refine(before)
            steps += more
            if state.energy > before.energy * (1.0 - _FINAL_GAIN):
                break
        return state, steps

    @property
    def at_rest(self) -> bool:
        """True once warm solves with unchanged targets have nothing left to try."""
        return self._cache.starts == [] and self._cache.other is None

    def warm(self, explore: bool = True) -> tuple[State, int]:
        """One frame: descend by landmarks from the last solution, then evaluate all vertices.

        If targets and weights are those of the last solve, refine towards the exact minimum. Once
        that is reached, try the starts of a cold solve, one a call: a drag over a long way may have
        come to a minimum that is not the lowest.

        Args:
            explore: false to stay in the minimum of the last solution.

        Returns:
            The state, and the steps taken.

        Raises:
            ValueError: there is no last solution.
        """
        cache = self._cache
        if cache.x is None:
            raise ValueError("warm: there is no solution to start from; call cold first")
        self.jumped = False
        state = cache.state or self.evaluate(cache.x)
        # The energy of the last unknowns changes with the targets.
        state = replace(state, energy=self.energy.value(state.x, state.p))
        if self._targets_unchanged():
            found, steps = self._refine(state)
            if explore and found.energy > state.energy * (1.0 - _RESTING):
                found, more = self._explore(found)
                steps += more
            return self._keep(found), steps
        cache.forget_starts()
        x, estimate, steps = self._descend_by_landmarks(state, _FRAME_STEPS, _FRAME_GAIN)
        found = self.evaluate(x)
        if found.energy > estimate + _ESTIMATE_TOLERANCE * (abs(estimate) + 1.0):
            better = found if found.energy < state.energy else state
            x, _, more = self._descend_by_landmarks(better, _FRAME_STEPS, _FRAME_GAIN)
            again, steps = self.evaluate(x), steps + more
            found = min((again, found), key=lambda entry: entry.energy)
        return self._keep(min((state, found), key=lambda entry: entry.energy)), steps

    def _explore(self, state: State) -> tuple[State, int]:
        """A part of the search for a lower minimum: a start, or a refinement of what it led to.

        Returns:
            The state of the lower minimum once it is found, else `state`, and the steps taken.
        """
        cache, positions = self._cache, self._basis.landmark_positions()
        if cache.starts is None:
            cache.starts = self._all_starts(positions)
        elif cache.other is not None:
            return self._refine_other(state, *cache.other)
        elif cache.starts:
            energy, start = cache.starts.pop(0)
            x, estimate, steps = energy.descend(positions, start, _START_STEPS)
            near = np.linalg.norm(x - state.x) < _SAME
            if not near and estimate < state.energy * (1.0 + _WORTH_REFINING):
                cache.other = self.evaluate(x), None
            return state, steps
        return state, 0

    def _refine_other(
        self, state: State, other: State, correction: _Correction | None
    ) -> tuple[State, int]:
        """Refine a state that may be on its way below `state`; the lower one, and the steps."""
        cache = self._cache
        own, cache.correction, cache.other = cache.correction, correction, None
        refined, steps = self._refine(other)
        if refined.energy < state.energy * (1.0 - _LOWER):
            self.jumped = True
            return refined, steps
        if refined.energy < other.energy * (1.0 - _RESTING):
            cache.other = refined, cache.correction
        cache.correction = own
        return state, steps

    def _targets_unchanged(self) -> bool:
        """True if the last solve had the present targets and weights; stores the present ones."""
        now = self.energy.targets, self.energy.weights
        last, self._cache.solved_for = self._cache.solved_for, now
        return last is not None and all(map(np.array_equal, last, now))

    def _refine(self, state: State) -> tuple[State, int]:
        """Descend by landmarks whose derivative is corrected by that of all vertices."""
        correction = self._cache.correction
        if correction is None or not np.array_equal(correction.x, state.x):
            z = self.energy.code(state.x)
            exact, landmarks = self._basis.exact_positions(), self._basis.landmark_positions()
            difference = exact.at(z).derivative() - landmarks.at(z).derivative()
            self._cache.correction = _Correction(state.x, difference)
        x, _, steps = self._descend_by_landmarks(state, _FINAL_STEPS, _FINAL_GAIN)
        step = x - state.x
        # Far from the state the corrected landmarks may be wrong: a shorter step may be better.
        for share in _SHARES if step.any() else ():
            found = self.evaluate(state.x + share * step)
            if found.energy < state.energy:
                return found, steps
        return state, steps

    def _descend_by_landmarks(
        self, state: State, steps: int, relative_gain: float
    ) -> tuple[FloatArray, float, int]:
        """Descend from a state with handle positions by landmarks, which are exact at the state."""
        correction = self._cache.correction
        positions = CorrectedHandlePositions(
            self._basis.landmark_positions(), None if correction is None else correction.derivative
        )
        here = positions.match(self.energy.code(state.x), state.p)
        return self.energy.descend(positions, state.x, steps, relative_gain, here)

    def _all_starts(self, positions: HandlePositions) -> list[tuple[HandleEnergy, FloatArray]]:
        """Starts of a cold solve, each with the energy to descend in.

        Each kind of rigid motion is tried on its own: a descent that starts with one never switches
        to the other.
        """
        return [
            (energy, x)
            for energy in self.energy.by_rigid_term()
            for x in self._starts(energy, positions)
        ]

    def _starts(self, energy: HandleEnergy, positions: HandlePositions) -> list[FloatArray]:
        """The prior's mean and the training codes that fit the handles best, rigidly moved."""
        if len(self._basis.vertices) == 0:
            return [np.zeros(energy.size)]
        scored = []
        for y in np.vstack([np.zeros((1, energy.components)), self._candidates]):
            x = np.concatenate([y, np.zeros(MOTION)])
            p = positions.at(energy.code(x)).positions
            # The shape is where shapes of the code are, or at the targets' centroid.
            moved = [(energy.value(at, p), at) for at in (x, energy.translated_to_targets(x, p))]
            scored.append(min(moved, key=lambda entry: entry[0]))
        others = sorted(scored[1:], key=lambda entry: entry[0])[:_STARTS]
        return [scored[0][1], *(x for _, x in others)]
