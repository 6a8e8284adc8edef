"""Minimises the energy of a handle fit: from several starts, or for one frame of a drag.

Descents use handle positions by a few landmark vertices (cubature). All vertices then give the
exact energy, and near the minimum their derivative corrects that of the landmarks.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field, replace

import numpy as np

from deformer.editing.energy import HandleEnergy
from deformer.editing.floor import FloorTerm
from deformer.editing.green_functions import HandleBasis
from deformer.editing.handle_positions import HandlePositions
from deformer.editing.lifted_surface import Surface
from deformer.editing.refinement import Correction, Minimum, Refinement, State
from deformer.editing.unknowns import MOTION, Unknowns
from deformer.geometry import FloatArray, spread
from deformer.model import LatentPrior

# A cold solve evaluates _CANDIDATES training codes spread over the latent space, descends from the
# prior's mean and the _STARTS codes of least energy, and refines the _FINISHED lowest results.
_CANDIDATES = 32
_STARTS = 3
_START_STEPS = 40
_FINISHED = 2
# Descents by landmarks that end with energies and unknowns that differ by no more than this (a
# share, and standard deviations) have found the same minimum: one of them is refined. Other minima
# are mostly two deviations away.
_SAME_ENERGY, _SAME_MINIMUM = 2e-3, 0.3
# A frame of a drag: steps, the relative gain that ends them, and how far (relative, and in units
# of the energy) the exact energy may lie above the landmarks' estimate. Most frames need two or
# three steps; one that stops early leaves a part of the way for the next frames, or for the rest.
# Targets out of reach make the energy large: with a gain of 1e-3 drags stopped short of a bend in
# its valley, and the pose at rest was up to half a diagonal away.
_FRAME_STEPS = 16
_FRAME_GAIN = 1e-4
_ESTIMATE_TOLERANCE = 0.05
# Warm solves with unchanged targets that gain less than this (relative, and in units of the energy)
# search from the starts of a cold solve; the result replaces the state if its energy is lower by
# the share _LOWER.
_RESTING = 1e-2
_RESTING_GAIN = 1e-9
_LOWER = 9e-3
# A refinement at rest whose relative gain is at most this is not adopted: the state is a minimum.
# A restored state is one up to the second number, and stays as it is to the last digit: the descent
# that led to it may have used other landmarks.
_STILL, _STILL_RESTORED = 1e-4, 1e-3
# Noise chosen by the search: the change that is followed, and the most changes in one minimum.
_NOISE_CHANGE, _NOISE_CHANGES = 1.05, 8


# Unknowns, energy and steps of a descent by landmarks.
_Coarse = tuple[FloatArray, float, int]
# Yields the steps of its parts, returns the result.
_Search = Generator[int, None, Minimum]


@dataclass(eq=False)
class _Cache:
    """Results of one solve that the next one reuses.

    Args:
        x: (K+6,) unknowns of the last solution.
        state: these unknowns with the positions of the present handles; None after the handle
            vertices have changed.
        decoded: for each surface, the state whose deformation gradients it has.
        correction: correction of the landmarks' derivative.
        solved_for: targets and weights of the last solve.
        search: the search of a cold solve, as far as it has come since the handles are at rest;
            None while they move.
        searched: true once that search has ended.
        refined: true once refinement of the last solution has ended.
        still: relative gain up to which the state is a minimum.
    """

    x: FloatArray | None = None
    state: State | None = None
    decoded: dict[Surface, State] = field(default_factory=dict)
    correction: Correction | None = None
    solved_for: tuple[FloatArray, FloatArray] | None = None
    search: _Search | None = None
    searched: bool = False
    refined: bool = False
    still: float = _STILL

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
        self.search, self.searched, self.refined = None, False, False
        self.still = _STILL


class CodeSearch:
    """Minimises a handle energy over the latent code and the rigid motion.

    Args:
        energy: energy of the model without handles.
        basis: the model's handles; its surface has the gradients of the last code decoded.
        codes: (N, K) training codes, some of which are starts of a cold search.

    Attributes:
        jumped: true if the last warm solve ended in another minimum than it began in.
        stayed: true if the last warm solve, for unchanged targets, left the solution as it was.
        least_noise: least noise of a search that raises the noise where targets are out of reach
            (`HandleEnergy.noise_within_reach`); None keeps the energy's noise.
    """

    def __init__(self, energy: HandleEnergy, basis: HandleBasis, codes: FloatArray) -> None:
        """Choose the candidates; there is no solution yet."""
        self.energy = energy
        self._limits = energy.limits
        self._basis, self._codes = basis, codes
        self._refinement = Refinement(basis, self.evaluate)
        self._cache = _Cache()
        self.jumped = self.stayed = False
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

    def set_targets(
        self,
        targets: FloatArray,
        weights: FloatArray,
        misfit: float,
        floor: FloorTerm | None = None,
    ) -> None:
        """Set targets (H, 3) and weights (H,) of the basis's handles, and the model's misfit.

        With a floor, its contacts are among the handles.
        """
        errors = self._basis.model_errors(misfit) if misfit and len(weights) else None
        self.energy = replace(
            self.energy, targets=targets, weights=weights, errors=errors, floor=floor
        )

    def vertices_changed(self) -> None:
        """Drop what depends on the handle vertices; to be called after the basis's have changed."""
        self._cache.invalidate(vertices=True)

    def energy_changed(self) -> None:
        """Drop what depends on the energy; to be called after its floor has changed."""
        self._cache.invalidate()

    def set_prior(self, energy: HandleEnergy, mean: FloatArray | None) -> None:
        """Change the energy's parameters; the last solution keeps its code and rigid motion.

        Args:
            energy: the new energy; its prior has the old mean.
            mean: (K,) new mean of the prior, or None to keep the old one. It may bend more than any
                example: bends as far as its own cost nothing then, so that handles on its surface
                move nothing.
        """
        before, cache = self.energy, self._cache
        self.energy = energy
        if mean is not None:
            prior = LatentPrior(mean, before.prior.covariance)
            limits = self._limits and self._limits.including(mean)
            self.energy = replace(energy, prior=prior, limits=limits)
            self._candidates = self._choose_candidates()
        cache.invalidate()
        if cache.x is None:
            return
        last = Unknowns(cache.x)
        cache.x = self.energy.unknowns(before.code(cache.x), last.rotation, last.translation)
        if cache.state is not None:
            p = cache.state.p
            surface = cache.state.surface
            state = State(cache.x, p, self.energy.value(cache.x, p), surface)
            # The code has not changed, so the surface's gradients are still those of the state.
            same = cache.decoded.get(surface) is cache.state
            cache.decoded = {surface: state} if same else {}
            cache.state = state

    def evaluate(
        self, x: FloatArray, energy: HandleEnergy | None = None, surface: Surface | None = None
    ) -> State:
        """State of unknowns x (K+6,): decodes a surface for the energy.

        Args:
            x: unknowns.
            energy: None is the present one.
            surface: of the basis; None is that of all vertices.
        """
        energy, surface = energy or self.energy, surface or self._basis.surface
        p = surface.decode(energy.code(x))
        state = State(x, p, energy.value(x, p), surface)
        self._cache.decoded[surface] = state
        return state

    def decode(self, state: State) -> None:
        """Give a state's surface its deformation gradients."""
        if self._cache.decoded.get(state.surface) is not state:
            state.surface.decode(self.energy.code(state.x))
            self._cache.decoded[state.surface] = state

    def restart(self, x: FloatArray) -> State:
        """Make x (K+6,) the solution for the present handles, whatever was solved before."""
        self._cache.invalidate()
        self._cache.still = _STILL_RESTORED
        return self._keep(self.evaluate(x))

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
                cache.search, cache.searched, cache.refined = None, True, True
                return self._adopt(ended.value), steps

    def _adopt(self, found: Minimum) -> State:
        """Make the result of a search, with its noise, the solution."""
        self.energy, self._cache.correction = found.energy, found.correction
        return self._keep(found.state)

    def _search(self, known: State | None = None) -> _Search:
        """The search of a cold solve, in parts: of a descent by landmarks, or of a refinement.

        Args:
            known: a refined state of this energy. It stands for all starts whose descents by
                landmarks end where the one from this state does: they are not refined.

        A noise that is chosen is followed by landmarks in the minimum that the least one leads to;
        with another one all starts are tried again, and it is followed in what they lead to.
        """
        least = self.least_noise
        energy = self.energy if least is None else replace(self.energy, noise=least)
        positions = self._basis.landmark_positions()
        coarse = yield from self._coarse(energy, positions)
        if least is None:
            return (yield from self._finished(energy, coarse, known))
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
            found = yield from self._refinement.converge(energy, state)
        return found

    def _finished(
        self, energy: HandleEnergy, coarse: list[_Coarse], known: State | None = None
    ) -> _Search:
        """Refine the lowest minima of descents by landmarks, and take the lowest."""
        minima, finished = _different(coarse)[:_FINISHED], []
        if known is not None:
            positions = self._basis.landmark_positions()
            own = energy.descend(positions, known.x, _START_STEPS)
            yield own[2]
            minima = [entry for entry in minima if not _same(entry, own)]
            finished.append(Minimum(energy, known, self._cache.correction))
        for x, _, _ in minima:
            lowest = min((found.state.energy for found in finished), default=np.inf)
            state = self.evaluate(x, energy)
            finished.append((yield from self._refinement.converge(energy, state, lowest)))
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

    @property
    def at_rest(self) -> bool:
        """True once warm solves with unchanged targets have nothing left to try or to refine."""
        cache = self._cache
        return cache.refined and cache.searched and self._targets_unchanged()

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

    def exact(self) -> State:
        """The state of the last solution by all vertices; see `current`."""
        state = self.current()
        if state.surface is not self._basis.surface:
            state = self._cache.state = self.evaluate(state.x)
        return state

    def warm(self, explore: bool = True) -> tuple[State, int]:
        """One frame: descend by landmarks from the last solution, then evaluate the moving surface.

        If targets and weights are those of the last solve, evaluate all vertices, and refine
        towards the exact minimum; a state that is one remains, to the last digit. Once that is
        reached, do a cold solve, a part a call, if asked to: a drag over a long way may have come
        to a minimum that is not the lowest.

        Args:
            explore: false to stay in the minimum of the last solution.

        Returns:
            The state, and the steps taken.

        Raises:
            ValueError: there is no last solution to start from.
        """
        cache, state = self._cache, self.current()
        self.jumped, self.stayed = False, self.at_rest
        if self.at_rest:
            return state, 0
        if self._targets_unchanged():
            state = found = self.exact()
            gain, steps = 0.0, 0
            if not cache.refined:
                cache.correction = self._refinement.correction(self.energy, state, cache.correction)
                found, steps = self._refinement.refine(self.energy, state, cache.correction)
                gain = state.energy - found.energy
                if gain <= cache.still * state.energy + _RESTING_GAIN:
                    found, cache.refined = state, True
                else:
                    cache.still = _STILL
            if explore and not cache.searched and gain <= _RESTING * state.energy + _RESTING_GAIN:
                found, more = self._explore(found)
                steps += more
            self.stayed = found.x is cache.x
            return self._keep(found), steps
        cache.forget_search()
        moving = self._basis.moving
        if state.surface is not moving:
            state = self.evaluate(state.x, surface=moving)
        frame = cache.correction, _FRAME_STEPS, _FRAME_GAIN
        x, estimate, steps = self._refinement.descend(self.energy, state, *frame)
        found = self.evaluate(x, surface=moving)
        if found.energy > estimate + _ESTIMATE_TOLERANCE * (abs(estimate) + 1.0):
            better = found if found.energy < state.energy else state
            x, _, more = self._refinement.descend(self.energy, better, *frame)
            again, steps = self.evaluate(x, surface=moving), steps + more
            found = min((again, found), key=lambda entry: entry.energy)
        return self._keep(min((state, found), key=lambda entry: entry.energy)), steps

    def _explore(self, state: State) -> tuple[State, int]:
        """Do the next part of a cold solve; its result, if that is lower, else `state`; the steps.

        The correction of the landmarks' derivative is then that of the result.
        """
        cache = self._cache
        if cache.search is None:
            cache.search = self._search(state)
        try:
            return state, next(cache.search)
        except StopIteration as ended:
            cache.searched = True
            found = ended.value
        same = found.energy.noise == self.energy.noise
        if same and found.state.energy >= state.energy * (1.0 - _LOWER):
            return state, 0
        self.jumped, cache.refined = True, False
        return self._adopt(found), 0

    def _targets_unchanged(self) -> bool:
        """True if the last solution is for the present targets and weights."""
        last, now = self._cache.solved_for, (self.energy.targets, self.energy.weights)
        return last is not None and all(map(np.array_equal, last, now))

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


def _different(coarse: list[_Coarse]) -> list[_Coarse]:
    """One result, the lowest, of each minimum that descents have found."""
    found: list[_Coarse] = []
    for entry in coarse:
        if not any(_same(entry, other) for other in found):
            found.append(entry)
    return found


def _same(one: _Coarse, other: _Coarse) -> bool:
    """True if two descents have found the same minimum."""
    (x, a, _), (y, b, _) = one, other
    near = float(np.linalg.norm(x - y)) <= _SAME_MINIMUM
    return near and abs(a - b) <= _SAME_ENERGY * min(a, b) + _RESTING_GAIN


def _alike(wanted: float, noise: float) -> bool:
    """True if a noise need not be changed to the one wanted."""
    return 1 / _NOISE_CHANGE < wanted / noise < _NOISE_CHANGE
