"""Minimises the energy of a handle fit: from several starts, or for one frame of a drag.

Descents use handle positions by a few landmark vertices (cubature). All vertices then give the
exact energy, and near the minimum their derivative corrects that of the landmarks.
"""

from __future__ import annotations

from collections.abc import Generator
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
# Warm solves with unchanged targets that gain less than this (relative, and in units of the energy)
# search from the starts of a cold solve; the result replaces the state if its energy is lower by
# the share _LOWER.
_RESTING = 1e-2
_RESTING_GAIN = 1e-9
_LOWER = 5e-3
# The relative gain of such a solve that, once all that is searched, is the last.
_STILL = 1e-4
# Noise chosen by the search: the change that is followed, and the most changes in one minimum.
_NOISE_CHANGE, _NOISE_CHANGES = 1.05, 8
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


@dataclass(frozen=True, eq=False)
class _Found:
    """Result of a search.

    Args:
        energy: the energy that was minimised.
        state: the state of its least value.
        correction: of the landmarks' derivative there.
    """

    energy: HandleEnergy
    state: State
    correction: _Correction | None


# Unknowns, energy and steps of a descent by landmarks.
_Coarse = tuple[FloatArray, float, int]
# Yields the steps of its parts, returns the result.
_Search = Generator[int, None, _Found]


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
        search: the search of a cold solve, as far as it has come since the handles are at rest;
            None while they move.
        searched: true once that search has ended.
        settled: true once refinement has ended, too.
    """

    x: FloatArray | None = None
    state: State | None = None
    decoded: State | None = None
    correction: _Correction | None = None
    solved_for: tuple[FloatArray, FloatArray] | None = None
    search: _Search | None = None
    searched: bool = False
    settled: bool = False

    def invalidate(self, *, vertices: bool = False) -> None:
        """Drop the results that a changed energy invalidates; the unknowns x stay.

        Args:
            vertices: true if the handle vertices have changed, too.
        """
        self.correction = self.solved_for = None
        self.forget_search()
        if vertices:
            self.state = None

    def forget_search(self) -> None:
        """Drop what was searched at rest, because the handles have moved."""
        self.search, self.searched, self.settled = None, False, False


class CodeSearch:
    """Minimises a handle energy over the latent code and the rigid motion.

    Args:
        energy: energy of the model without handles.
        basis: the model's handles; its surface has the gradients of the last code decoded.
        codes: (N, K) training codes, some of which are starts of a cold search.

    Attributes:
        jumped: true if the last warm solve ended in another minimum than it began in.
        least_noise: least noise of a search that raises the noise where targets are out of reach
            (`HandleEnergy.noise_within_reach`); None keeps the energy's noise.
    """

    def __init__(self, energy: HandleEnergy, basis: HandleBasis, codes: FloatArray) -> None:
        """Choose the candidates; there is no solution yet."""
        self.energy = energy
        self._basis, self._codes = basis, codes
        self._cache = _Cache()
        self.jumped = False
        self.least_noise: float | None = None
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

    def set_targets(self, targets: FloatArray, weights: FloatArray, misfit: float) -> None:
        """Set targets (H, 3) and weights (H,) of the basis's handles, and the model's misfit."""
        errors = self._basis.model_errors(misfit) if misfit and len(weights) else None
        self.energy = replace(self.energy, targets=targets, weights=weights, errors=errors)

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

    def evaluate(self, x: FloatArray, energy: HandleEnergy | None = None) -> State:
        """State of unknowns x (K+6,): decodes all vertices for the exact energy.

        Args:
            x: unknowns.
            energy: None is the present one.
        """
        energy = energy or self.energy
        p = self._basis.surface.decode(energy.code(x))
        state = State(x, p, energy.value(x, p))
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
        self._cache.x, self._cache.state = x, self.evaluate(x)
        return self._cache.state

    def _keep(self, state: State) -> State:
        """Make a state the solution for the present targets and weights."""
        self._cache.x, self._cache.state = state.x, state
        self._cache.solved_for = self.energy.targets, self.energy.weights
        return state

    def cold(self) -> tuple[State, int]:
        """Minimise from several starts, independent of what was solved before.

        Each start descends by landmarks; the two lowest results are refined with all vertices.

        Returns:
            The state of least energy, and the steps taken.
        """
        search, steps = self._search(), 0
        while True:
            try:
                steps += next(search)
            except StopIteration as ended:
                cache = self._cache
                cache.search, cache.searched, cache.settled = None, True, True
                return self._adopt(ended.value), steps

    def _adopt(self, found: _Found) -> State:
        """Make the result of a search, with its noise, the solution."""
        self.energy, self._cache.correction = found.energy, found.correction
        return self._keep(found.state)

    def _search(self) -> _Search:
        """The search of a cold solve, in parts: of a descent by landmarks, or of a refinement.

        A noise that is chosen is followed by landmarks in the minimum that the least one leads to;
        with another one all starts are tried again, and it is followed in what they lead to.
        """
        least = self.least_noise
        energy = self.energy if least is None else replace(self.energy, noise=least)
        positions = self._basis.landmark_positions()
        coarse = yield from self._coarse(energy, positions)
        if least is None:
            return (yield from self._finished(energy, coarse))
        x = coarse[0][0]
        for _ in range(_NOISE_CHANGES):
            p = positions.at(energy.code(x)).positions
            wanted = energy.noise_within_reach(x, p, least)
            if _alike(wanted, energy.noise):
                break
            energy = replace(energy, noise=wanted)
            x, _, steps = energy.descend(positions, x, _START_STEPS)
            yield steps
        if energy.noise != least:
            coarse = yield from self._coarse(energy, positions)
        found = yield from self._finished(energy, coarse)
        for _ in range(_NOISE_CHANGES):
            energy, state = found.energy, found.state
            wanted = energy.noise_within_reach(state.x, state.p, least)
            if _alike(wanted, energy.noise):
                break
            energy = replace(energy, noise=wanted)
            state = replace(state, energy=energy.value(state.x, state.p))
            found = yield from self._converge(energy, state)
        return found

    def _finished(self, energy: HandleEnergy, coarse: list[_Coarse]) -> _Search:
        """Refine the lowest results of descents by landmarks, and take the lowest."""
        finished = []
        for x, _, _ in coarse[:_FINISHED]:
            finished.append((yield from self._converge(energy, self.evaluate(x, energy))))
        return min(finished, key=lambda found: found.state.energy)

    def _coarse(
        self, energy: HandleEnergy, positions: HandlePositions
    ) -> Generator[int, None, list[_Coarse]]:
        """Descents by landmarks from all starts: unknowns, energy and steps, the lowest first."""
        found = []
        for term, start in self._all_starts(energy, positions):
            found.append(term.descend(positions, start, _START_STEPS))
            yield found[-1][2]
        return sorted(found, key=lambda entry: entry[1])

    def _converge(self, energy: HandleEnergy, state: State) -> _Search:
        """Refine a state until its energy no longer falls."""
        correction = None
        for _ in range(_REFINEMENTS):
            before = state
            state, correction, steps = self._refined(energy, before, correction)
            yield steps
            if state.energy > before.energy * (1.0 - _FINAL_GAIN):
                break
        return _Found(energy, state, correction)

    @property
    def at_rest(self) -> bool:
        """True once warm solves with unchanged targets have nothing left to try or to refine."""
        return self._cache.settled and self._targets_unchanged()

    def current(self) -> State:
        """The state of the last solution, with its energy for the present targets.

        The same object as long as the search is at rest.

        Raises:
            ValueError: there is no last solution.
        """
        cache = self._cache
        if cache.x is None:
            raise ValueError("current: there is no solution; call cold first")
        state = cache.state = cache.state or self.evaluate(cache.x)
        return state if self.at_rest else replace(state, energy=self.energy.value(state.x, state.p))

    def warm(self, explore: bool = True) -> tuple[State, int]:
        """One frame: descend by landmarks from the last solution, then evaluate all vertices.

        If targets and weights are those of the last solve, refine towards the exact minimum. Once
        that is reached, do a cold solve, a part a call: a drag over a long way may have come to a
        minimum that is not the lowest.

        Args:
            explore: false to stay in the minimum of the last solution.

        Returns:
            The state, and the steps taken.

        Raises:
            ValueError: there is no last solution to start from.
        """
        cache, state = self._cache, self.current()
        self.jumped = False
        if self.at_rest:
            return state, 0
        if self._targets_unchanged():
            found, cache.correction, steps = self._refined(self.energy, state, cache.correction)
            gain = state.energy - found.energy
            cache.settled = cache.searched and gain <= _STILL * state.energy + _RESTING_GAIN
            least_gain = _RESTING * state.energy + _RESTING_GAIN
            if explore and not cache.searched and gain <= least_gain:
                found, more = self._explore(found)
                steps += more
            return self._keep(found), steps
        cache.forget_search()
        frame = cache.correction, _FRAME_STEPS, _FRAME_GAIN
        x, estimate, steps = self._descend_by_landmarks(self.energy, state, *frame)
        found = self.evaluate(x)
        if found.energy > estimate + _ESTIMATE_TOLERANCE * (abs(estimate) + 1.0):
            better = found if found.energy < state.energy else state
            x, _, more = self._descend_by_landmarks(self.energy, better, *frame)
            again, steps = self.evaluate(x), steps + more
            found = min((again, found), key=lambda entry: entry.energy)
        return self._keep(min((state, found), key=lambda entry: entry.energy)), steps

    def _explore(self, state: State) -> tuple[State, int]:
        """Do the next part of a cold solve; its result, if that is lower, else `state`; the steps.

        The correction of the landmarks' derivative is then that of the result.
        """
        cache = self._cache
        if cache.search is None:
            cache.search = self._search()
        try:
            return state, next(cache.search)
        except StopIteration as ended:
            cache.searched = True
            found = ended.value
        same = found.energy.noise == self.energy.noise
        if same and found.state.energy >= state.energy * (1.0 - _LOWER):
            return state, 0
        self.jumped = True
        return self._adopt(found), 0

    def _targets_unchanged(self) -> bool:
        """True if the last solution is for the present targets and weights."""
        last, now = self._cache.solved_for, (self.energy.targets, self.energy.weights)
        return last is not None and all(map(np.array_equal, last, now))

    def _refined(
        self, energy: HandleEnergy, state: State, correction: _Correction | None
    ) -> tuple[State, _Correction, int]:
        """Descend by landmarks whose derivative is corrected by that of all vertices.

        Args:
            energy: the energy to lower.
            state: to start from.
            correction: an earlier correction, which is reused if it is that of the state.

        Returns:
            A state whose energy is not higher, the correction used, and the steps taken.
        """
        if correction is None or not np.array_equal(correction.x, state.x):
            z = energy.code(state.x)
            exact, landmarks = self._basis.exact_positions(), self._basis.landmark_positions()
            difference = exact.at(z).derivative() - landmarks.at(z).derivative()
            correction = _Correction(state.x, difference)
        limits = _FINAL_STEPS, _FINAL_GAIN
        x, _, steps = self._descend_by_landmarks(energy, state, correction, *limits)
        step = x - state.x
        # Far from the state the corrected landmarks may be wrong: a shorter step may be better.
        for share in _SHARES if step.any() else ():
            found = self.evaluate(state.x + share * step, energy)
            if found.energy < state.energy:
                return found, correction, steps
        return state, correction, steps

    def _descend_by_landmarks(
        self,
        energy: HandleEnergy,
        state: State,
        correction: _Correction | None,
        steps: int,
        relative_gain: float,
    ) -> tuple[FloatArray, float, int]:
        """Descend from a state with handle positions by landmarks, which are exact at the state."""
        positions = CorrectedHandlePositions(
            self._basis.landmark_positions(), None if correction is None else correction.derivative
        )
        here = positions.match(energy.code(state.x), state.p)
        return energy.descend(positions, state.x, steps, relative_gain, here)

    def _all_starts(
        self, energy: HandleEnergy, positions: HandlePositions
    ) -> list[tuple[HandleEnergy, FloatArray]]:
        """Starts of a cold solve, each with the energy to descend in.

        Each kind of rigid motion is tried on its own: a descent that starts with one never switches
        to the other.
        """
        return [(term, x) for term in energy.by_rigid_term() for x in self._starts(term, positions)]

    def _starts(self, energy: HandleEnergy, positions: HandlePositions) -> list[FloatArray]:
        """The prior's mean and the training codes that fit the handles best, rigidly moved."""
        if len(self._basis.points) == 0:
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


def _alike(wanted: float, noise: float) -> bool:
    """True if a noise need not be changed to the one wanted."""
    return 1 / _NOISE_CHANGE < wanted / noise < _NOISE_CHANGE
