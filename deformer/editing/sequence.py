"""A model fitted to a sequence of handle frames, such as motion-capture markers.

All frames are solved for together: the energy is the sum of the frames' own (see `objective`) and
of squared accelerations of the unknowns, which takes jitter away and, looking both ways in time,
adds no lag. A frame in which no handle is seen is bridged: little of the prior pulls at it. Key
frames are solved one after the other, the frames between them start from interpolation, and a
Gauss–Newton step over the whole sequence costs one banded Cholesky.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from deformer.editing.acceleration import Roughness
from deformer.editing.batch_numba import Boolean, Frames, NumbaFrames
from deformer.editing.energy import HandleObjective
from deformer.editing.green_functions import HandleBasis
from deformer.editing.handles import check_handles
from deformer.editing.solver import HandleSolver
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, log_to_rotation, right_jacobian
from deformer.linalg import in_parallel, one_blas_thread, resolve_device, split
from deformer.model import DeformationModel

# Every so many frames one is solved on its own, as a start for those around it.
_KEY = 12
# Frames whose Jacobians stay in a core's cache.
_CACHED = 8
# Frames solved for together, and frames looked ahead that are solved for again with the next ones.
_WINDOW = 512
_AHEAD = 32
# What is left of the prior in a frame that sees no handle: neighbours say more about it.
_UNSEEN = 1e-4
# Every so many frames handle positions are measured by all vertices.
_MEASURED = 4
# Most joint steps before and after handle positions are measured, and the relative gains that a
# step promises which is the last one.
_STEPS = 10
_ROUGH_GAIN = 2e-2
_GAIN = 1e-3
# A step that has gained more than this went far enough to ask for a new Jacobian.
_FAR = 5e-3


@dataclass(frozen=True, eq=False)
class SequenceFit:
    """A fitted sequence of F frames.

    Args:
        vertices: (F, V, 3) positions.
        z: (F, K) latent codes.
        rotation: (F, 3) rotation vectors of the rigid motion, about the reference's centroid.
        translation: (F, 3) of the rigid motion.
        residual: (F, H) distances from handle to target; NaN where a handle has no weight.
        prior_distance: (F,) Mahalanobis distances of the codes from the training codes' mean.
        iterations: joint Gauss–Newton steps taken.
    """

    vertices: FloatArray
    z: FloatArray
    rotation: FloatArray
    translation: FloatArray
    residual: FloatArray
    prior_distance: FloatArray
    iterations: int


def fit_sequence(
    model: DeformationModel,
    vertices: ArrayLike,
    targets: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    hard: ArrayLike = False,
    smoothness: float = 10.0,
    rigid: bool = True,
    noise: float = 0.007,
    relaxation: int = 2,
    device: str = "cpu",
    backend: str | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> SequenceFit:
    """Fit a model to frames of handle targets.

    Args:
        model: the prior.
        vertices: (H,) different handle vertices.
        targets: (F, H, 3) positions, frame by frame.
        weights: (F, H) or (H,) factors; 0 is a handle that is not seen in that frame, whose
            target is not looked at. None is ones.
        hard: one for all, or (H,): meet the targets exactly wherever the weight is not 0.
        smoothness: weight of squared accelerations, from frame to frame; 0 fits every frame on
            its own. Motion that is slow for its frame rate bears 100 and more.
        rigid: as in `HandleSolver`.
        noise: as in `HandleSolver`; markers are less certain than shapes.
        relaxation: rounds of rigid relaxation for hard handles, in every frame.
        device: "cpu", "cuda", "mps" or "auto" (cuda or mps if there is one, else cpu).
        backend: "numba", which uses all cores of the CPU, or "torch", which computes many frames
            at once on any device; None is numba on the CPU and torch on every other device.
        on_progress: called with the frames done and their number.

    Raises:
        InputError: shapes that differ, an index out of range, a target that is not finite, an
            unknown or missing device, or a backend that cannot use it.
    """
    index, goals, factors, held = _checked(model, vertices, targets, weights, hard)
    if not (np.isfinite(smoothness) and smoothness >= 0):
        raise InputError(f"smoothness: expected 0 or a positive number, got {smoothness}")
    # Motion goes places: the shape may stand anywhere.
    solver = HandleSolver(model, rigid=rigid, noise=noise, freedom=1.0)
    basis = solver.basis
    basis.take(index.tolist())
    batch = _backend(basis, device, backend)
    objective = solver.objective
    problem = _Problem(objective, batch, goals, factors, smoothness)
    F = len(goals)
    X = np.zeros((F, objective.size))
    out = np.empty((F, len(model.reference.vertices), 3))
    steps = 0
    with one_blas_thread():
        for start in range(0, F, _WINDOW):
            stop, seen = min(start + _WINDOW, F), min(start + _WINDOW + _AHEAD, F)
            guess = X[start - 1] if start else _first(solver, objective, index, goals, factors)
            basis.take(index.tolist())
            before = X[max(0, start - 2) : start]
            found, taken = problem.solve(slice(start, seen), guess, before)
            X[start:stop] = found[: stop - start]
            steps += taken
            part = slice(start, stop)
            Q, origin = log_to_rotation(X[part, -6:-3]), objective.origins(X[part])
            z = problem.codes(X[part])
            batch.shapes(z, Q, origin, goals[part], held[part], relaxation, out[part])
            if on_progress is not None:
                on_progress(stop, F)
    residual = np.linalg.norm(out[:, index] - goals, axis=2)
    residual[factors == 0] = np.nan
    return SequenceFit(
        vertices=out,
        z=problem.codes(X),
        rotation=X[:, -6:-3].copy(),
        translation=objective.diagonal * X[:, -3:],
        residual=residual,
        prior_distance=np.linalg.norm(X[:, :-6], axis=1),
        iterations=steps,
    )


class _Problem:
    """Energy of a sequence, and its descent window by window.

    Args:
        objective: of the model, without handles.
        backend: of its handles.
        goals: (F, H, 3).
        factors: (F, H), ≥ 0.
        smoothness: weight of squared accelerations.
    """

    def __init__(
        self,
        objective: HandleObjective,
        backend: Frames,
        goals: FloatArray,
        factors: FloatArray,
        smoothness: float,
    ) -> None:
        """Fix the weights."""
        self._objective, self._backend = objective, backend
        self._goals = goals
        self._factors = factors
        self._rows = np.sqrt(factors) / (objective.noise * objective.diagonal)
        self._smoothness = smoothness
        self._active = objective.size if objective.rigid else objective.size - 6
        self._seen: Boolean = np.asarray((factors > 0).any(axis=1))
        # Without smoothness there are no neighbours.
        share = _UNSEEN if smoothness > 0 else 1.0
        self._prior = np.where(self._seen, 1.0, share)[:, None]
        self._stiffness = objective.stiffness(np.zeros(objective.size))[0][: self._active]

    def codes(self, X: FloatArray) -> FloatArray:
        """Latent codes (m, K) of unknowns (m, n)."""
        return self._objective.prior.mean + X[:, :-6] @ self._objective.factor.T

    def solve(self, window: slice, guess: FloatArray, before: FloatArray) -> tuple[FloatArray, int]:
        """Unknowns (m, n) of the frames of a window, and the joint steps taken.

        Args:
            window: of the frames.
            guess: (n,) unknowns to start the first frame from.
            before: up to two rows of unknowns of the frames before, which stay.
        """
        X, offset = self._key_frames(window, guess)
        P = self._backend.by_landmarks(self.codes(X)) + offset
        X, P, steps = self._descend(window, X, P, offset, before, _ROUGH_GAIN)
        more = self._offsets(X, P)
        X, P, taken = self._descend(window, X, P + more, offset + more, before, _GAIN)
        return X, steps + taken

    def _key_frames(self, window: slice, guess: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unknowns and offsets: key frames one after the other, interpolated between."""
        m = window.stop - window.start
        keys = np.append(np.arange(0, m, _KEY), m - 1)
        seen = np.flatnonzero(self._seen[window])
        if len(seen):
            keys = seen[np.abs(seen[:, None] - keys).argmin(axis=0)]
        keys = np.unique(keys)
        handles = _Single(self._backend)
        found, offsets = [], []
        x = guess
        for key in keys:
            frame = window.start + int(key)
            objective = replace(
                self._objective, targets=self._goals[frame], weights=self._factors[frame]
            )
            handles.pin(objective.code(x))
            x, _, _ = objective.descend(handles, x, 20, 1e-2)
            found.append(x)
            offsets.append(handles.offset)
        return _between(keys, np.array(found), m), _between(keys, np.array(offsets), m)

    def _offsets(self, X: FloatArray, P: FloatArray) -> FloatArray:
        """What positions P lack to the exact ones (m, H, 3), from some frames to all."""
        frames = np.unique(np.append(np.arange(0, len(X), _MEASURED), len(X) - 1))
        return _between(frames, self._backend.by_all(self.codes(X[frames])) - P[frames], len(X))

    def _descend(
        self,
        window: slice,
        X: FloatArray,
        P: FloatArray,
        offset: FloatArray,
        before: FloatArray,
        enough: float,
    ) -> tuple[FloatArray, FloatArray, int]:
        """Levenberg–Marquardt over all frames of a window; the energy never rises.

        Args:
            window: the frames.
            X: (m, n) unknowns to start from.
            P: (m, H, 3) handle positions there.
            offset: (m, H, 3) that is added to those by landmarks.
            before: unknowns of the frames before.
            enough: a step that promises a relative gain below this is the last one.

        Returns:
            X, P, and the steps taken.
        """
        roughness = Roughness(len(before), len(X), self._smoothness)
        energy = self._energy(window, X, P, roughness, before)
        damping, n = 1e-6, self._active
        J, far = self._backend.jacobians(self.codes(X)), False
        for count in range(_STEPS):
            A, gradient = self._normal_equations(window, X, P, J)
            gradient += self._stiffness * roughness.times(before[:, :n], X[:, :n])
            step = roughness.solve(A, gradient, self._stiffness, damping)
            # The last step is taken too: the sum over all frames promises little, one of them
            # may still have much to gain, and all that it costs is an evaluation.
            last = (gradient * step).sum() <= enough * energy
            if far and not last:
                J, far = self._backend.jacobians(self.codes(X)), False
                A, gradient = self._normal_equations(window, X, P, J)
                gradient += self._stiffness * roughness.times(before[:, :n], X[:, :n])
                step = roughness.solve(A, gradient, self._stiffness, damping)
            while True:
                trial = X.copy()
                trial[:, :n] -= step
                there = self._backend.by_landmarks(self.codes(trial)) + offset
                value = self._energy(window, trial, there, roughness, before)
                if value <= energy:
                    break
                damping *= 30.0
                if last or damping > 1e6:
                    return X, P, count
                step = roughness.solve(A, gradient, self._stiffness, damping)
            far = energy - value > _FAR * energy
            X, P, energy, damping = trial, there, value, max(damping / 30.0, 1e-9)
            if last:
                return X, P, count + 1
        return X, P, _STEPS

    def _misfit(self, window: slice, X: FloatArray, P: FloatArray) -> FloatArray:
        Q = log_to_rotation(X[:, -6:-3])
        moved = P @ Q.transpose(0, 2, 1) + self._objective.origins(X)[:, None]
        return self._rows[window, :, None] * (moved - self._goals[window])

    def _energy(
        self,
        window: slice,
        X: FloatArray,
        P: FloatArray,
        roughness: Roughness,
        before: FloatArray,
    ) -> float:
        n = self._active
        own = (self._misfit(window, X, P) ** 2).sum()
        own += (self._prior[window] * X[:, :n] ** 2 @ self._stiffness).sum()
        own += (self._prior[window] * self._objective.beyond(X)[0] ** 2).sum()
        return float(own + roughness.energy(before[:, :n], X[:, :n], self._stiffness))

    def _normal_equations(
        self, window: slice, X: FloatArray, P: FloatArray, slope: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Gauss–Newton matrices (m, n, n) and gradients (m, n) of the frames' own energies.

        Args:
            window: the frames.
            X: (m, n) unknowns.
            P: (m, H, 3) handle positions.
            slope: (m, H, 3, K) their derivatives with respect to the code.
        """
        n = self._active
        A, gradient = np.empty((len(X), n, n)), np.empty((len(X), n))

        def some(part: range) -> None:
            for start in range(part.start, part.stop, _CACHED):
                at = slice(start, min(start + _CACHED, part.stop))
                frames = slice(window.start + at.start, window.start + at.stop)
                A[at], gradient[at] = self._some_equations(frames, X[at], P[at], slope[at])

        list(in_parallel(some, split(len(X))))
        return A, gradient

    def _some_equations(
        self, frames: slice, X: FloatArray, P: FloatArray, slope: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """`_normal_equations` of so few frames that all of it stays in the cache."""
        objective, n = self._objective, self._active
        omega = X[:, -6:-3]
        Q = log_to_rotation(omega)
        J = np.empty((*P.shape, objective.size))
        np.matmul(Q[:, None], slope @ objective.factor + objective.drift, out=J[..., :-6])
        # ∂(exp(ω) p)/∂ω = −exp(ω) [p]× J_right(ω) = exp(ω) (J_right columns × p)
        columns = right_jacobian(omega).transpose(0, 2, 1)
        standing = P + objective.stands(X)[:, None]
        turned = np.cross(columns[:, None], standing[:, :, None])
        J[..., -6:-3] = Q[:, None] @ turned.transpose(0, 1, 3, 2)
        J[..., -3:] = objective.diagonal * np.eye(3)
        J *= self._rows[frames, :, None, None]
        J = J.reshape(len(X), -1, objective.size)[:, :, :n]
        misfit = self._misfit(frames, X, P).reshape(len(X), -1, 1)
        stiffness = self._prior[frames] * self._stiffness
        gradient = (J.transpose(0, 2, 1) @ misfit)[..., 0] + stiffness * X[:, :n]
        A = J.transpose(0, 2, 1) @ J
        np.einsum("mii->mi", A)[:] += stiffness
        beyond, slope = objective.beyond(X)
        weighed = (self._prior[frames, :, None] * slope).transpose(0, 2, 1)
        K = objective.size - 6
        A[:, :K, :K] += weighed @ slope
        gradient[:, :K] += (weighed @ beyond[..., None])[..., 0]
        return A, gradient


class _Single:
    """One frame of a backend as `objective.Handles`, exact where it was pinned."""

    def __init__(self, backend: Frames) -> None:
        """Begin without an offset."""
        self._backend = backend
        self.offset = np.zeros(3)

    def pin(self, z: FloatArray) -> None:
        """Let the positions at z be those of all vertices."""
        self.offset = (self._backend.by_all(z[None]) - self._backend.by_landmarks(z[None]))[0]

    def at(self, z: FloatArray) -> _SingleEvaluation:
        """Positions, and their derivative if it is asked for."""
        return _SingleEvaluation(self._backend, z, self.offset)


class _SingleEvaluation:
    """`_Single` at one code."""

    def __init__(self, backend: Frames, z: FloatArray, offset: FloatArray) -> None:
        """Evaluate the positions (H, 3)."""
        self._backend, self._z = backend, z
        self.positions = backend.by_landmarks(z[None])[0] + offset

    def derivative(self) -> FloatArray:
        """Derivative (H, 3, K) of the positions with respect to the code."""
        return self._backend.jacobians(self._z[None])[0]


def _first(
    solver: HandleSolver,
    objective: HandleObjective,
    index: IntArray,
    goals: FloatArray,
    factors: FloatArray,
) -> FloatArray:
    """Unknowns to begin with, by a solve from several starts.

    They are those of the first frame, or if that sees few handles, of the first that sees at least
    half as many as any.
    """
    counts = (factors[:_WINDOW] > 0).sum(axis=1)
    frame = int((2 * counts >= counts.max()).argmax())
    seen = factors[frame] > 0
    solver.set_handles(index[seen], goals[frame, seen], factors[frame, seen])
    pose = solver.solve()
    y = np.linalg.solve(objective.factor, pose.z - objective.prior.mean)
    x = np.concatenate([y, pose.rotation, pose.translation / objective.diagonal])
    return np.asarray(x, dtype=np.float64)


def _between(keys: IntArray, values: FloatArray, count: int) -> FloatArray:
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


def _backend(basis: HandleBasis, device: str, backend: str | None) -> Frames:
    """`Frames` of a backend on a device; see `fit_sequence`."""
    if backend not in (None, "numba", "torch"):
        raise InputError(f"backend: expected numba or torch, got {backend!r}")
    if device == "auto" and (backend == "numba" or not basis.model.decoder.pointwise):
        device = "cpu"  # torch knows networks of one layer only
    if device != "cpu":
        device = str(resolve_device(device))
    if backend == "torch" or (backend is None and device != "cpu"):
        # torch takes seconds to import.
        from deformer.editing.batch_torch import TorchFrames

        return TorchFrames(basis, device)
    if device != "cpu":
        raise InputError(f"backend 'numba' computes on the CPU, got device {device!r}; use 'torch'")
    return NumbaFrames(basis)


def _checked(
    model: DeformationModel,
    vertices: ArrayLike,
    targets: ArrayLike,
    weights: ArrayLike | None,
    hard: ArrayLike,
) -> tuple[IntArray, FloatArray, FloatArray, Boolean]:
    """Handle vertices (H,), targets (F, H, 3), factors (F, H), and which are held (F, H)."""
    goals = np.asarray(targets, dtype=np.float64)
    count = np.size(vertices)
    if goals.ndim != 3 or goals.shape[1:] != (count, 3) or len(goals) == 0:
        raise InputError(f"targets: expected (F, {count}, 3), one frame or more, got {goals.shape}")
    F, H, _ = goals.shape
    factors = np.ones(H) if weights is None else np.asarray(weights, dtype=np.float64)
    if factors.shape not in ((H,), (F, H)):
        raise InputError(f"weights: expected ({F}, {H}) or ({H},), got {factors.shape}")
    factors = np.broadcast_to(factors, (F, H))
    if not (np.isfinite(factors) & (factors >= 0)).all():
        frame, h = np.argwhere(~(np.isfinite(factors) & (factors >= 0)))[0]
        raise InputError(f"frame {frame}, handle {h}: weight {factors[frame, h]} is not 0 or more")
    unseen = factors == 0
    bad = ~np.isfinite(goals).all(axis=2) & ~unseen
    if bad.any():
        frame, h = np.argwhere(bad)[0]
        raise InputError(
            f"frame {frame}, handle {h}: target {goals[frame, h].tolist()} is not finite; "
            "give a marker that is not seen the weight 0"
        )
    goals = np.where(unseen[:, :, None], 0.0, goals)
    index, _, _, exact = check_handles(model, vertices, goals[0], None, hard)
    if len(np.unique(index)) < H:
        repeated = np.flatnonzero(np.bincount(index) > 1)[0]
        raise InputError(f"vertex {repeated} is given twice; a sequence wants different vertices")
    return index, goals, factors, ~unseen & exact
