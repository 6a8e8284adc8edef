"""The energy of a sequence of handle frames, and its descent over a window of frames.

The energy is the sum of the frames' own energies (`HandleEnergy`) and of squared accelerations of
the unknowns. Key frames are solved one after the other, the frames between them start from
interpolation, and a Gauss–Newton step over the whole window costs one banded Cholesky.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deformer.editing.acceleration import Roughness
from deformer.editing.batch_numba import Boolean, Frames
from deformer.editing.energy import HandleEnergy
from deformer.editing.unknowns import Unknowns
from deformer.geometry import FloatArray, IntArray, log_to_rotation, right_jacobian
from deformer.linalg import Damping, descend, over_parts

# Every so many frames one is solved on its own, as a start for those around it.
_KEY = 12
_KEY_STEPS = 20
_KEY_GAIN = 1e-2
# Frames whose Jacobians stay in a core's cache.
_CACHED = 8
# What is left of the prior in a frame that sees no handle: neighbours say more about it.
_UNSEEN = 1e-4
# Every so many frames handle positions are measured by all vertices.
_MEASURED = 4
# Most joint steps before and after handle positions are measured. A step that promises a relative
# gain below this is the last one: the step is taken, as it costs no more than an evaluation, and
# a single frame may still have much to gain where the sum over all frames promises little.
_STEPS = 10
_ROUGH_GAIN = 2e-2
_GAIN = 1e-3
# A step that has gained more than this went far enough to need a new Jacobian.
_FAR = 5e-3
_DAMPING = Damping(initial=1e-6, up=30.0, down=30.0, floor=1e-9, ceiling=1e6)


@dataclass(frozen=True, eq=False)
class _Window:
    """Frames that are solved for together.

    Args:
        frames: m of the sequence.
        before: (b, n) active unknowns of up to two frames before, which stay.
        roughness: of the window after those.
    """

    frames: slice
    before: FloatArray
    roughness: Roughness


class SequenceEnergy:
    """Energy of a sequence of F frames, and its descent window by window.

    Args:
        energy: of the model, without handles.
        backend: of the model's H handles.
        targets: (F, H, 3).
        weights: (F, H), ≥ 0; 0 is a handle that is not seen.
        smoothness: weight of squared accelerations.
    """

    def __init__(
        self,
        energy: HandleEnergy,
        backend: Frames,
        targets: FloatArray,
        weights: FloatArray,
        smoothness: float,
    ) -> None:
        """Fix the weights."""
        self.function, self.backend = energy, backend
        self._targets, self._weights = targets, weights
        self._row_weights = np.sqrt(weights) / (energy.noise * energy.diagonal)
        self._smoothness = smoothness
        self.active = energy.active
        self._seen: Boolean = np.asarray((weights > 0).any(axis=1))
        # Without smoothness there are no neighbours.
        share = _UNSEEN if smoothness > 0 else 1.0
        self._prior = np.where(self._seen, 1.0, share)[:, None]
        self.stiffness = energy.stiffness(np.zeros(energy.size))[0][: self.active]

    def solve(self, frames: slice, guess: FloatArray, before: FloatArray) -> tuple[FloatArray, int]:
        """Unknowns (m, K+6) of the frames of a window, and the joint steps taken.

        Args:
            frames: m of the sequence.
            guess: (K+6,) unknowns to start the first frame from.
            before: (b, K+6) unknowns of up to two frames before, which stay.
        """
        m = frames.stop - frames.start
        roughness = Roughness(len(before), m, self._smoothness)
        window = _Window(frames, before[:, : self.active], roughness)
        X, offset = self._key_frames(frames, guess)
        P = self.backend.by_landmarks(self.function.codes(X)) + offset
        rough, steps = self._descend(_Point(self, window, X, P, offset, _ROUGH_GAIN))
        X, missing = rough.X, self._measured_difference(rough.X, rough.P)
        fine, more = self._descend(
            _Point(self, window, X, rough.P + missing, offset + missing, _GAIN)
        )
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
            positions.measure(energy.code(x))
            x, _, _ = energy.descend(positions, x, _KEY_STEPS, _KEY_GAIN)
            found.append(x)
            offsets.append(positions.offset)
        return _interpolated(keys, np.array(found), m), _interpolated(keys, np.array(offsets), m)

    def _measured_difference(self, X: FloatArray, P: FloatArray) -> FloatArray:
        """Exact handle positions minus P (m, H, 3): measured at some frames, else interpolated."""
        frames = np.unique(np.append(np.arange(0, len(X), _MEASURED), len(X) - 1))
        exact = self.backend.by_all(self.function.codes(X[frames]))
        return _interpolated(frames, exact - P[frames], len(X))

    def _descend(self, start: _Point) -> tuple[_Point, int]:
        """Levenberg–Marquardt over all frames of a window, and the joint steps taken."""
        found = descend(
            start,
            steps=_STEPS,
            relative_gain=0.0,
            damping=_DAMPING,
            is_last=lambda point, step: point.promises_little(step),
        )
        return found.point, found.steps

    def value(self, window: _Window, X: FloatArray, P: FloatArray) -> float:
        """The energy of a window with unknowns X (m, K+6) and handle positions P (m, H, 3)."""
        n, frames = self.active, window.frames
        own = (self._misfit(frames, X, P) ** 2).sum()
        own += (self._prior[frames] * X[:, :n] ** 2 @ self.stiffness).sum()
        own += (self._prior[frames] * self.function.excess_bending(X)[0] ** 2).sum()
        return float(own + window.roughness.energy(window.before, X[:, :n], self.stiffness))

    def _misfit(self, frames: slice, X: FloatArray, P: FloatArray) -> FloatArray:
        Q = log_to_rotation(Unknowns(X).rotation)
        moved = P @ Q.transpose(0, 2, 1) + self.function.centroids(X)[:, None]
        return self._row_weights[frames, :, None] * (moved - self._targets[frames])

    def normal_equations(
        self, window: _Window, X: FloatArray, P: FloatArray, dP: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Gauss–Newton matrices (m, n, n) of the frames' own energies, and the whole gradient.

        Args:
            window: of m frames.
            X: (m, K+6) unknowns.
            P: (m, H, 3) handle positions.
            dP: (m, H, 3, K) their derivatives by the code.

        Returns:
            The matrices, without the coupling of frames by accelerations (`Roughness.solve` adds
            it), and half the gradient (m, n) of all, n active unknowns a frame.
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
        """`normal_equations` of so few frames that all of it stays in the cache."""
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
        J = derivative.x
        J *= self._row_weights[frames, :, None, None]
        J = J.reshape(len(X), -1, energy.size)[:, :, :n]
        misfit = self._misfit(frames, X, P).reshape(len(X), -1, 1)
        stiffness = self._prior[frames] * self.stiffness
        gradient = (J.transpose(0, 2, 1) @ misfit)[..., 0] + stiffness * X[:, :n]
        A = J.transpose(0, 2, 1) @ J
        np.einsum("mii->mi", A)[:] += stiffness
        excess, slope = energy.excess_bending(X)
        weighed = (self._prior[frames, :, None] * slope).transpose(0, 2, 1)
        A[:, :K, :K] += weighed @ slope
        gradient[:, :K] += (weighed @ excess[..., None])[..., 0]
        return A, gradient


class _Point:
    """Unknowns of a window's frames, with the handle positions and the energy there.

    Args:
        function: the energy.
        window: of m frames.
        X: (m, K+6) unknowns.
        P: (m, H, 3) handle positions.
        offset: (m, H, 3) that is added to positions by landmarks.
        enough: a step that promises a smaller relative gain needs no new Jacobian.
        J: (m, H, 3, K) derivatives of the positions by the code, of a point before; None if there
            is none.
    """

    def __init__(
        self,
        function: SequenceEnergy,
        window: _Window,
        X: FloatArray,
        P: FloatArray,
        offset: FloatArray,
        enough: float,
        J: FloatArray | None = None,
    ) -> None:
        """Evaluate the energy."""
        self._function, self._window = function, window
        self.X, self.P = X, P
        self._offset, self._enough, self._J = offset, enough, J
        self._far = False
        self._equations: tuple[FloatArray, FloatArray] | None = None
        self.energy = function.value(window, X, P)

    def step(self, damping: float) -> FloatArray:
        """Damped Gauss–Newton step (m, n) of all active unknowns.

        Steps are shorter and shorter; far from where the Jacobian was taken, and with much to
        gain, it is taken anew.
        """
        if self._equations is None:
            step = self._solved(damping)
            if not self._far or self.promises_little(step):
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

    def promises_little(self, step: FloatArray) -> bool:
        """True if a step (m, n) promises a relative gain that is not worth another one."""
        assert self._equations is not None
        return bool(-(self._equations[1] * step).sum() <= self._enough * self.energy)

    def moved(self, step: FloatArray) -> _Point:
        """The point that a step leads to."""
        function, X = self._function, self.X.copy()
        X[:, : step.shape[1]] += step
        P = function.backend.by_landmarks(function.function.codes(X)) + self._offset
        there = _Point(function, self._window, X, P, self._offset, self._enough, self._J)
        there._far = self.energy - there.energy > _FAR * self.energy
        return there


class _FramePositions:
    """`HandlePositions` of one frame of a backend, exact where they were measured."""

    def __init__(self, backend: Frames) -> None:
        """Begin without an offset."""
        self._backend = backend
        self.offset = np.zeros(3)

    def measure(self, z: FloatArray) -> None:
        """Choose the offset that makes the positions at z (K,) those of all vertices."""
        self.offset = (self._backend.by_all(z[None]) - self._backend.by_landmarks(z[None]))[0]

    def at(self, z: FloatArray) -> _FrameEvaluation:
        """Positions, and their derivative if it is asked for."""
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
    """Linear interpolation of values (k, …) at frames `keys` to frames 0…count − 1.

    Before the first key and after the last the values stay.
    """
    frames = np.arange(count)
    after = np.minimum(np.searchsorted(keys, frames), len(keys) - 1)
    start = np.maximum(after - 1, 0)
    gap = np.maximum(keys[after] - keys[start], 1)
    share: FloatArray = np.clip((frames - keys[start]) / gap, 0.0, 1.0)
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((1.0 - share) * values[start] + share * values[after])
