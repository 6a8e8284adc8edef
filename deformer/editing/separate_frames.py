"""Frames of a sequence without smoothness: each is fitted on its own, to the minimum of its energy.

The other frames decide only where the descent of a frame starts: halfway between two that are
solved. Key frames are solved first: those that the user tells from several starts, as poses are;
others one after the other.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from deformer.editing.arap import DecodedSurface
from deformer.editing.energy import HandleEnergy
from deformer.editing.green_functions import HandleBasis
from deformer.editing.refinement import Correction, Refinement, State
from deformer.editing.search import CodeSearch
from deformer.editing.unknowns import Unknowns
from deformer.geometry import FloatArray
from deformer.linalg import in_parallel
from deformer.model import LatentPrior

# Key frames where none are told: number of frames from one to the next. A start between frames that
# are farther apart takes so many steps by landmarks at most first, as a key frame does.
_KEY, _KEY_STEPS = 12, 40
# Refinements of a frame: the most of them, the relative gain that ends them, and how far (in
# standard deviations) from its state a correction of the landmarks' derivative serves.
_REFINEMENTS, _GAIN, _NEAR = 20, 1e-6, 0.1
# A change of the noise that a frame chooses by a smaller factor than this is not followed; the most
# changes by landmarks.
_NOISE_CHANGE, _NOISE_CHANGES = 1.01, 8


@dataclass(frozen=True, eq=False)
class _Solution:
    """Unknowns x (K+6,) of a frame about its own mean, and its noise.

    Args:
        x: the unknowns.
        noise: σ.
        correction: (H, 3, K) of the landmarks' derivative there; None if it is not known.
        steps: taken.
    """

    x: FloatArray
    noise: float
    correction: FloatArray | None = None
    steps: int = 0

    def halfway(self, other: _Solution) -> _Solution:
        """Return where a frame between two starts."""
        assert self.correction is not None and other.correction is not None
        noise, correction = np.sqrt(self.noise * other.noise), self.correction + other.correction
        return _Solution(0.5 * (self.x + other.x), float(noise), 0.5 * correction)


class SeparateFrames:
    """Fits frames, each on its own.

    Args:
        energy: of a frame, without handles; its noise is that of all frames, or the least one.
        basis: the model's H handles; they must not change while the frames are in use.
        targets: (F, H, 3) positions.
        weights: (F, H) factors, 0 or more; 0 is a handle that is not seen.
        means: (F, K) whitened codes that are the prior's means of the frames; None is zeros.
        keys: frames that are solved from several starts; without any, some are chosen.
        own_noise: true to raise the noise of each frame whose targets are out of reach
            (`HandleEnergy.noise_within_reach`).
        on_step: called after each frame; what it raises ends the fit.
    """

    def __init__(
        self,
        energy: HandleEnergy,
        basis: HandleBasis,
        targets: FloatArray,
        weights: FloatArray,
        means: FloatArray | None,
        keys: Sequence[int],
        own_noise: bool,
        on_step: Callable[[], None] = lambda: None,
    ) -> None:
        """Store the handles."""
        self._energy, self._basis = energy, basis
        self._targets, self._weights = targets, weights
        self._centres = np.zeros((len(targets), energy.size))
        if means is not None:
            Unknowns(self._centres).code = means
        self._keys, self._own_noise, self._on_step = keys, own_noise, on_step
        self._landmarks = basis.landmark_positions()
        basis.exact_positions()  # the threads below only read it
        self._thread = threading.local()

    def solve(
        self, guess: FloatArray, known: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, int]:
        """Solve for all frames.

        Args:
            guess: (K+6,) unknowns to start the first frame from.
            known: (F, K+6) unknowns from which the frames start; None solves key frames first.

        Returns:
            Unknowns (F, K+6), the noise of each frame (F,), and the most steps of a frame.
        """
        F, noise = len(self._targets), self._energy.noise
        if known is not None:
            starts = [_Solution(x, noise) for x in known - self._centres]
            found = self._all(list(enumerate(starts)), far=True)
        else:
            found = self._between_keys(guess)
            still = _Solution(np.zeros(self._energy.size), noise)
            found |= self._all([(f, still) for f in range(F) if f not in found])
        solutions = [found[frame] for frame in range(F)]
        X = self._centres + np.array([solution.x for solution in solutions])
        noises = np.array([solution.noise for solution in solutions])
        return X, noises, max(solution.steps for solution in solutions)

    def _between_keys(self, guess: FloatArray) -> dict[int, _Solution]:
        """Solutions of the frames that see a handle."""
        seen = np.flatnonzero((self._weights > 0).any(axis=1)).tolist()
        told = sorted(set(self._keys) & set(seen))
        found = self._from_many_starts(told) if told else self._one_after_the_other(seen, guess)
        # Before the first key frame and after the last one the next one is the start.
        ends = [(frame, found[key]) for frame, key in _beyond(seen, sorted(found))]
        found |= self._all(ends, far=True)
        while len(found) < len(seen):
            solved = [n for n, frame in enumerate(seen) if frame in found]
            gaps = [(a, b) for a, b in pairwise(solved) if b > a + 1]
            for far in (True, False):
                found |= self._all(
                    [
                        (seen[(a + b) // 2], found[seen[a]].halfway(found[seen[b]]))
                        for a, b in gaps
                        if (b - a > _KEY) == far
                    ],
                    far,
                )
        return found

    def _from_many_starts(self, frames: Sequence[int]) -> dict[int, _Solution]:
        """Solutions of key frames, each by the search of a cold solve."""
        found = {}
        for frame in frames:
            energy = self._of(frame, self._energy.noise)
            search = CodeSearch(energy, self._basis, self._basis.model.codes)
            search.least_noise = energy.noise if self._own_noise else None
            state, steps = search.cold()
            start = _Solution(state.x, search.energy.noise, steps=steps)
            found |= self._all([(frame, start)])
        return found

    def _one_after_the_other(self, seen: list[int], guess: FloatArray) -> dict[int, _Solution]:
        """Solutions of key frames, each from the one before."""
        found: dict[int, _Solution] = {}
        x = guess
        for frame in (*seen[:-1:_KEY], *seen[-1:]):
            start = _Solution(x - self._centres[frame], self._energy.noise)
            found |= self._all([(frame, start)], far=True)
            x = found[frame].x + self._centres[frame]
        return found

    def _all(
        self, starts: Sequence[tuple[int, _Solution]], far: bool = False
    ) -> dict[int, _Solution]:
        """Solve for frames, each from its start, on all cores.

        Args:
            starts: frames, and where they start.
            far: true for starts that need not be near the minima.
        """
        found = {}
        if not starts:
            return found
        solutions = in_parallel(lambda entry: self._solved(*entry, far), starts)
        for (frame, _), solution in zip(starts, solutions, strict=True):
            found[frame] = solution
            self._on_step()
        return found

    def _solved(self, frame: int, start: _Solution, far: bool) -> _Solution:
        """The minimum of a frame's energy, and the noise with which it is that."""
        energy, x = self._of(frame, start.noise), start.x
        surface = self._surface()

        def evaluate(x: FloatArray, energy: HandleEnergy) -> State:
            p = surface.decode(energy.code(x))
            return State(x, p, energy.value(x, p), surface)

        total = 0
        if far:
            energy, x, total = self._by_landmarks(energy, x)
        refinement, state = Refinement(self._basis, evaluate, _GAIN), evaluate(x, energy)
        if start.correction is None:
            correction = refinement.correction(energy, state)
        else:
            correction = Correction(np.full_like(x, np.inf), start.correction)
        for _ in range(_REFINEMENTS):
            before = state.energy
            state, steps = refinement.refine(energy, state, correction)
            total += steps
            changed = self._with_noise(energy, state.x, state.p)
            if changed is not energy:
                energy = changed
                state = replace(state, energy=energy.value(state.x, state.p))
            elif before - state.energy <= _GAIN * before:
                if np.abs(state.x - correction.x).max() <= _NEAR:
                    break
                correction = refinement.correction(energy, state)
        return _Solution(state.x, energy.noise, correction.derivative, total)

    def _by_landmarks(
        self, energy: HandleEnergy, x: FloatArray
    ) -> tuple[HandleEnergy, FloatArray, int]:
        """Descend from x by landmarks alone: the energy with its noise, unknowns, and steps."""
        total = 0
        for _ in range(1 + _NOISE_CHANGES):
            x, _, steps = energy.descend(self._landmarks, x, _KEY_STEPS)
            total += steps
            p = self._landmarks.at(energy.code(x)).positions
            changed = self._with_noise(energy, x, p)
            if changed is energy:
                break
            energy = changed
        return energy, x, total

    def _with_noise(self, energy: HandleEnergy, x: FloatArray, p: FloatArray) -> HandleEnergy:
        """The energy with the noise that its minimum x (K+6,) asks for, or the same object."""
        if not self._own_noise:
            return energy
        wanted = energy.noise_within_reach(x, p, self._energy.noise)
        if 1 / _NOISE_CHANGE < wanted / energy.noise < _NOISE_CHANGE:
            return energy
        return replace(energy, noise=wanted)

    def _of(self, frame: int, noise: float) -> HandleEnergy:
        """The energy of a frame, whose unknowns are about its own mean."""
        energy, limits = self._energy, self._basis.model.bend_limits
        mean = energy.code(self._centres[frame])
        return replace(
            energy,
            prior=LatentPrior(mean, energy.prior.covariance),
            limits=limits and limits.including(mean),
            targets=self._targets[frame],
            weights=self._weights[frame],
            noise=noise,
        )

    def _surface(self) -> DecodedSurface:
        """The calling thread's own copy of the surface."""
        if not hasattr(self._thread, "surface"):
            self._thread.surface = self._basis.surface.copy()
        return self._thread.surface


def _beyond(seen: Sequence[int], keys: Sequence[int]) -> list[tuple[int, int]]:
    """The first and the last frame, if they are no key frames, each with the key nearest to it."""
    ends = [(seen[0], keys[0]), (seen[-1], keys[-1])] if seen else []
    return [(frame, key) for frame, key in ends if frame != key]
