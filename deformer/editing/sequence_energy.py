"""The energy of a sequence of handle frames, and its descent over a window of frames.

The energy is the sum of each frame's energy (`HandleEnergy`) and of the squared accelerations of
the unknowns. Key frames are solved one after the other; the frames between them start from
interpolated unknowns. A Gauss–Newton step of the whole window costs one banded Cholesky
factorisation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from deformer.checks import check_memory
from deformer.editing.acceleration import Roughness
from deformer.editing.batch_numba import Boolean, Frames
from deformer.editing.bodies import Yielding
from deformer.editing.energy import HandleEnergy
from deformer.editing.unknowns import MOTION, Unknowns
from deformer.geometry import FloatArray, IntArray, log_to_rotation, right_jacobian
from deformer.linalg import Damping, descend, over_parts

# Key frames, solved on their own as starts for the others: distance between two, the most steps of
# each, and the relative gain that ends them.
_KEY = 12
_KEY_STEPS = 20
_KEY_GAIN = 1e-2
# Number of frames whose Jacobians fit into a core's cache.
_CACHED = 8
# Factor on the prior in a frame that sees no handle: its neighbours say more about it.
_UNSEEN = 1e-4
# Distance between two frames whose handle positions are computed by all vertices.
_MEASURED = 4
# Most steps of a window, once before and once after handle positions are computed by all vertices.
# A step with a predicted relative gain below _ROUGH_GAIN (before) or _GAIN (after) is the last one.
# It is still taken: it costs no more than an evaluation, and may lower the energy of a single frame
# much while the sum over all frames falls little.
_STEPS = 10
_ROUGH_GAIN = 2e-2
_GAIN = 1e-3
# After a step with a larger relative gain than this, the Jacobian is computed anew.
_FAR = 5e-3
_DAMPING = Damping(initial=1e-6, up=30.0, down=30.0, floor=1e-9, ceiling=1e6)


@dataclass(frozen=True, eq=False)
class _Window:
    """Frames that are solved for together.

    Args:
        frames: range of the m frames in the sequence.
        before: (b, n) active unknowns of up to two fixed frames before them.
        roughness: squared accelerations of these frames and the window.
    """

    frames: slice
    before: FloatArray
    roughness: Roughness


class SequenceEnergy:
    """Energy of a sequence of F frames, and its descent window by window.

    Args:
        energy: energy of the model without handles.
        backend: evaluates the model's H handles.
        targets: (F, H, 3) positions.
        weights: (F, H) factors, 0 or more; 0 is a handle that is not seen.
        smoothness: weight of squared accelerations, positive.
        means: (F, K) whitened codes that are the prior's means of the frames; None is zero for
            all. With means, a frame that sees no handle has the prior in full.
        on_step: called before each step of a descent; what it raises ends the descent.
    """

    def __init__(
        self,
        energy: HandleEnergy,
        backend: Frames,
        targets: FloatArray,
        weights: FloatArray,
        smoothness: float,
        means: FloatArray | None = None,
        on_step: Callable[[], None] = lambda: None,
    ) -> None:
        """Store the handles, and the weights of the prior in each frame."""
        self.function, self.backend = energy, backend
        self._on_step = on_step
        self._targets, self._weights = targets, weights
        patterns, self._pattern = np.unique(weights, axis=0, return_inverse=True)
        if energy.errors is not None:
            P, H = patterns.shape
            check_memory(16 * P * H * H, f"weights: {P} sets of {H} handles that are seen")
        self._whitening = energy.whitening(patterns)
        self._smoothness = smoothness
        self.active = energy.active
        self._seen: Boolean = np.asarray((weights > 0).any(axis=1))
        share = _UNSEEN if means is None else 1.0
        self._prior = np.where(self._seen, 1.0, share)[:, None]
        # Weights of squared unknowns. A body that yields has weights of its own in each frame
        # (`_prior_terms`); its accelerations are those of one that may go anywhere.
        self._yielding = energy.freedom if isinstance(energy.freedom, Yielding) else None
        steady = replace(energy, freedom=1.0) if self._yielding else energy
        self.stiffness = steady.stiffness(np.zeros(energy.size))[0][: self.active]
        # The prior's minimum in each frame, as unknowns.
        self._centres = np.zeros((len(weights), energy.size))
        if means is not None:
            Unknowns(self._centres).code = means

    @property
    def means(self) -> FloatArray:
        """Whitened codes (F, K) that are the prior's means."""
        return Unknowns(self._centres).code

    def solve(
        self,
        frames: slice,
        guess: FloatArray,
        before: FloatArray,
        known: FloatArray | None = None,
    ) -> tuple[FloatArray, int]:
        """Solve for the m frames of a window together.

        Args:
            frames: range of the m frames in the sequence.
            guess: (K+6,) unknowns to start the first frame from.
            before: (b, K+6) unknowns of up to two fixed frames before them.
            known: (m, K+6) unknowns near the minimum, from which all frames start; None solves key
                frames first.

        Returns:
            Unknowns (m, K+6), and the number of steps of the whole window.
        """
        m = frames.stop - frames.start
        roughness = Roughness(len(before), m, self._smoothness)
        window = _Window(frames, before[:, : self.active], roughness)
        if known is not None:
            X, steps = known, 0
            offset: FloatArray = np.zeros((m, self._targets.shape[1], 3))
            P = self.backend.by_landmarks(self.function.codes(X))
        else:
            X, offset = self._key_frames(frames, guess)
            P = self.backend.by_landmarks(self.function.codes(X)) + offset
            rough, steps = self._descend(_Point(self, window, X, P, offset, _ROUGH_GAIN))
            X, P = rough.X, rough.P
        missing = self._measured_difference(X, P)
        fine, more = self._descend(_Point(self, window, X, P + missing, offset + missing, _GAIN))
        return fine.X, steps + more

    def _key_frames(self, frames: slice, guess: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unknowns (m, K+6) and offsets (m, H, 3), interpolated between solved key frames."""
        m = frames.stop - frames.start
        keys = np.append(np.arange(0, m, _KEY), m - 1)
        seen = np.flatnonzero(self._seen[frames])
        if len(seen):
            keys = seen[np.abs(seen[:, None] - keys).argmin(axis=0)]
        keys = np.unique(keys)
        positions = _FramePositions(self.backend)
        found, offsets = [], []
        x = guess
        for key in keys:
            frame = frames.start + int(key)
            energy = replace(
                self.function, targets=self._targets[frame], weights=self._weights[frame]
            )
            centre = self._centres[frame]
            energy = replace(energy, prior=replace(energy.prior, mean=energy.code(centre)))
            self._on_step()
            positions.measure(energy.code(x - centre))
            x, _, _ = energy.descend(positions, x - centre, _KEY_STEPS, _KEY_GAIN)
            x = x + centre
            found.append(x)
            offsets.append(positions.offset)
        return _interpolated(keys, np.array(found), m), _interpolated(keys, np.array(offsets), m)

    def _measured_difference(self, X: FloatArray, P: FloatArray) -> FloatArray:
        """Handle positions by all vertices minus P (m, H, 3): interpolated between some frames."""
        frames = np.unique(np.append(np.arange(0, len(X), _MEASURED), len(X) - 1))
        exact = self.backend.by_all(self.function.codes(X[frames]))
        return _interpolated(frames, exact - P[frames], len(X))

    def _descend(self, start: _Point) -> tuple[_Point, int]:
        """Levenberg–Marquardt over all frames of a window: the last point, and the steps taken."""
        found = descend(
            start,
            steps=_STEPS,
            relative_gain=0.0,
            damping=_DAMPING,
            is_last=self._is_last,
        )
        return found.point, found.steps

    def _is_last(self, point: _Point, step: FloatArray) -> bool:
        self._on_step()
        return point.gains_little(step)

    def value(self, window: _Window, X: FloatArray, P: FloatArray) -> float:
        """The energy of a window with unknowns X (m, K+6) and handle positions P (m, H, 3)."""
        n, frames = self.active, window.frames
        moved = self._moved(X, P)
        own = (self._whitened(frames, moved - self._targets[frames]) ** 2).sum()
        if self.function.floor is not None:
            own += (self.function.floor.misfit(moved) ** 2).sum()
        apart = X[:, :n] - self._centres[frames, :n]
        stiffness, constants = self._prior_terms(X)
        own += (self._prior[frames] * (stiffness * apart**2 + constants)).sum()
        own += (self._prior[frames] * self.function.excess_bending(X)[0] ** 2).sum()
        return float(own + window.roughness.energy(window.before, X[:, :n], self.stiffness))

    def _prior_terms(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Weights (m, n) of the squared unknowns X (m, K+6), and constants (m, n) beside them."""
        weights = np.tile(self.stiffness, (len(X), 1))
        constants = np.zeros_like(weights)
        if self._yielding and self.active == self.function.size:
            for row, constant, motion in zip(weights, constants, Unknowns(X).motion, strict=True):
                row[-MOTION:], constant[-1] = self._yielding.stiffness(motion)
        return weights, constants

    def _moved(self, X: FloatArray, P: FloatArray) -> FloatArray:
        """Handle positions P (m, H, 3) after the rigid motions of unknowns X (m, K+6)."""
        Q = log_to_rotation(Unknowns(X).rotation)
        return P @ Q.transpose(0, 2, 1) + self.function.centroids(X)[:, None]

    def _whitened(self, frames: slice, errors: FloatArray) -> FloatArray:
        """Errors of frames (m, H, 3), or their derivatives (m, H, 3, n), in deviations."""
        W = self._whitening[self._pattern[frames]]
        if self.function.errors is None:
            return W.reshape(*W.shape, *(1,) * (errors.ndim - 2)) * errors
        return (W @ errors.reshape(*W.shape[:2], -1)).reshape(errors.shape)

    def normal_equations(
        self, window: _Window, X: FloatArray, P: FloatArray, dP: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Gauss–Newton matrices of the frames' own energies, and the gradient of the whole energy.

        Args:
            window: the m frames.
            X: (m, K+6) unknowns.
            P: (m, H, 3) handle positions.
            dP: (m, H, 3, K) their derivatives with respect to the codes.

        Returns:
            Matrices (m, n, n) for n active unknowns a frame, without the accelerations, which
            `Roughness.solve` adds; half the gradient (m, n), with the accelerations.
        """
        n, first = self.active, window.frames.start
        A, gradient = np.empty((len(X), n, n)), np.empty((len(X), n))

        def assemble(part: range) -> None:
            for start in range(part.start, part.stop, _CACHED):
                at = slice(start, min(start + _CACHED, part.stop))
                frames = slice(first + at.start, first + at.stop)
                A[at], gradient[at] = self._own_equations(frames, X[at], P[at], dP[at])

        over_parts(assemble, len(X))
        gradient += self.stiffness * window.roughness.half_gradient(window.before, X[:, :n])
        return A, gradient

    def _own_equations(
        self, frames: slice, X: FloatArray, P: FloatArray, dP: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Matrices and half gradients of frames' own energies; the frames should fit the cache."""
        energy, n, K = self.function, self.active, self.function.components
        omega = Unknowns(X).rotation
        Q = log_to_rotation(omega)
        derivative = Unknowns(np.empty((*P.shape, energy.size)))
        np.matmul(Q[:, None], dP @ energy.factor + energy.centroid_jacobian, out=derivative.code)
        # ∂(exp(ω) p)/∂ω = −exp(ω) [p]× J_right(ω) = exp(ω) (J_right columns × p)
        columns = right_jacobian(omega).transpose(0, 2, 1)
        from_centroid = P + energy.centroid_offset(X)[:, None]
        turned = np.cross(columns[:, None], from_centroid[:, :, None])
        derivative.rotation = Q[:, None] @ turned.transpose(0, 1, 3, 2)
        derivative.translation = energy.diagonal * np.eye(3)
        J = self._whitened(frames, derivative.x)
        J = J.reshape(len(X), -1, energy.size)[:, :, :n]
        moved = self._moved(X, P)
        misfit = self._whitened(frames, moved - self._targets[frames]).reshape(len(X), -1, 1)
        stiffness = self._prior[frames] * self._prior_terms(X)[0]
        gradient = (J.transpose(0, 2, 1) @ misfit)[..., 0]
        gradient += stiffness * (X[:, :n] - self._centres[frames, :n])
        A = J.transpose(0, 2, 1) @ J
        np.einsum("mii->mi", A)[:] += stiffness
        excess, slope = energy.excess_bending(X)
        weighed = (self._prior[frames, :, None] * slope).transpose(0, 2, 1)
        A[:, :K, :K] += weighed @ slope
        gradient[:, :K] += (weighed @ excess[..., None])[..., 0]
        if energy.floor is not None:
            depths = energy.floor.misfit(moved)
            J = energy.floor.jacobian(derivative.x[:, energy.floor.rows])[..., :n]
            J = np.where(depths[..., None] > 0, J, 0.0).transpose(0, 2, 1)
            A += J @ J.transpose(0, 2, 1)
            gradient += (J @ depths[..., None])[..., 0]
        return A, gradient


class _Point:
    """Unknowns of a window's frames, with the handle positions and the energy there.

    Args:
        function: the energy.
        window: the m frames.
        X: (m, K+6) unknowns.
        P: (m, H, 3) handle positions.
        offset: (m, H, 3) correction that is added to positions by landmarks.
        relative_gain: a step with a smaller predicted relative gain needs no new Jacobian.
        J: (m, H, 3, K) derivatives of the positions with respect to the codes, at an earlier point;
            None computes them here.
    """

    def __init__(
        self,
        function: SequenceEnergy,
        window: _Window,
        X: FloatArray,
        P: FloatArray,
        offset: FloatArray,
        relative_gain: float,
        J: FloatArray | None = None,
    ) -> None:
        """Evaluate the energy."""
        self._function, self._window = function, window
        self.X, self.P = X, P
        self._offset, self._relative_gain, self._J = offset, relative_gain, J
        self._far = False
        self._equations: tuple[FloatArray, FloatArray] | None = None
        self.energy = function.value(window, X, P)

    def step(self, damping: float) -> FloatArray:
        """Damped Gauss–Newton step (m, n) of all active unknowns.

        Steps become shorter, so the Jacobian of an earlier point serves again. It is computed anew
        if the last step gained much and this one would, too.
        """
        if self._equations is None:
            step = self._solved(damping)
            if not self._far or self.gains_little(step):
                return step
            self._J = self._equations = None
        return self._solved(damping)

    def _solved(self, damping: float) -> FloatArray:
        function = self._function
        if self._J is None:
            self._J = function.backend.jacobians(function.function.codes(self.X))
        if self._equations is None:
            self._equations = function.normal_equations(self._window, self.X, self.P, self._J)
        A, gradient = self._equations
        return -self._window.roughness.solve(A, gradient, function.stiffness, damping)

    def gains_little(self, step: FloatArray) -> bool:
        """True if the predicted relative gain of a step (m, n) is at most `relative_gain`."""
        assert self._equations is not None
        return bool(-(self._equations[1] * step).sum() <= self._relative_gain * self.energy)

    def moved(self, step: FloatArray) -> _Point:
        """The point that a step leads to."""
        function, X = self._function, self.X.copy()
        X[:, : step.shape[1]] += step
        P = function.backend.by_landmarks(function.function.codes(X)) + self._offset
        there = _Point(function, self._window, X, P, self._offset, self._relative_gain, self._J)
        there._far = self.energy - there.energy > _FAR * self.energy
        return there


class _FramePositions:
    """`HandlePositions` of one frame: a backend's positions by landmarks plus an offset."""

    def __init__(self, backend: Frames) -> None:
        """Start with an offset of zero."""
        self._backend = backend
        self.offset = np.zeros(3)

    def measure(self, z: FloatArray) -> None:
        """Choose the offset with which the positions at z (K,) are those by all vertices."""
        self.offset = (self._backend.by_all(z[None]) - self._backend.by_landmarks(z[None]))[0]

    def at(self, z: FloatArray) -> _FrameEvaluation:
        """Evaluate at a latent code z (K,); the derivative is computed when it is asked for."""
        return _FrameEvaluation(self._backend, z, self.offset)


class _FrameEvaluation:
    """`_FramePositions` at one code."""

    def __init__(self, backend: Frames, z: FloatArray, offset: FloatArray) -> None:
        """Evaluate the positions (H, 3)."""
        self._backend, self._z = backend, z
        self.positions = backend.by_landmarks(z[None])[0] + offset

    def derivative(self) -> FloatArray:
        """Derivative (H, 3, K) of the positions with respect to the code."""
        return self._backend.jacobians(self._z[None])[0]


def _interpolated(keys: IntArray, values: FloatArray, count: int) -> FloatArray:
    """Linear interpolation of values (k, …), given at frames `keys` (k,), to frames 0…count − 1.

    Before the first key and after the last one the values are constant.
    """
    frames = np.arange(count)
    after = np.minimum(np.searchsorted(keys, frames), len(keys) - 1)
    start = np.maximum(after - 1, 0)
    gap = np.maximum(keys[after] - keys[start], 1)
    share: FloatArray = np.clip((frames - keys[start]) / gap, 0.0, 1.0)
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((1.0 - share) * values[start] + share * values[after])
