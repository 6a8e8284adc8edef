"""Handles: the latent code, and the pose, that meet what the user asks for."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deformer.differentials import arm_positions, arm_sensitivities
from deformer.errors import InputError
from deformer.mesh import FloatArray, IntArray
from deformer.model import DeformationModel
from deformer.relaxation import relax
from deformer.rotations import log_to_rotation, right_jacobian

# Prior standard deviations of the rigid motion: radians, and bounding diagonals.
_ROTATION_SCALE = 0.3
_TRANSLATION_SCALE = 1.0
# Cold solves try this many of the training codes (spread over the latent space) and keep the
# most promising few as starts beside the mean.
_CANDIDATES = 32
_STARTS = 3


@dataclass(frozen=True)
class Handle:
    """A vertex that the user controls.

    Args:
        vertex: index.
        target: (3,) position asked for.
        weight: factor on its squared distance; 1 is a normal handle.
        hard: meet the target exactly.
    """

    vertex: int
    target: tuple[float, float, float]
    weight: float = 1.0
    hard: bool = False


@dataclass(frozen=True, eq=False)
class Pose:
    """A solution.

    Args:
        vertices: (V, 3) positions.
        z: (K,) latent code.
        rotation: (3,) rotation vector of the rigid motion, about the reference's centroid.
        translation: (3,) of the rigid motion.
        residual: (H,) distances from handle to target, in the order of the handles.
        iterations: Gauss–Newton steps taken, all starts together.
        milliseconds: time of the solve.
        prior_distance: Mahalanobis distance of z from the training codes' mean.
        energy: minimised value.
    """

    vertices: FloatArray
    z: FloatArray
    rotation: FloatArray
    translation: FloatArray
    residual: FloatArray
    iterations: int
    milliseconds: float
    prior_distance: float
    energy: float


@dataclass(frozen=True, eq=False)
class _State:
    """Unknowns x = (y, ω, t): whitened code, rotation vector, translation in diagonals."""

    x: FloatArray
    energy: float
    q: FloatArray


class HandleSolver:
    """Finds the latent code and rigid motion whose mesh meets the handles.

    Minimises Σ_h w_h ‖Q p_h(z) + t − q_h‖² / (σ D)² + (z−μ)ᵀ Σ⁻¹ (z−μ), with D the reference's
    bounding diagonal, plus weak quadratic terms on rotation and translation, by damped
    Gauss–Newton. Handle positions come from the features through one Green row a handle, kept
    while the handle lives; nothing is factored when handles come, move or go.

    Args:
        model: the prior.
        rigid: let the whole shape rotate and translate; otherwise it stays where the reference is.
        noise: σ, the distance from handle to target (in bounding diagonals) that weighs as much
            as one standard deviation of the prior.
        relaxation: local/global rounds of rigid relaxation for hard handles; 0 is the Schur
            complement alone.
    """

    def __init__(
        self,
        model: DeformationModel,
        *,
        rigid: bool = True,
        noise: float = 0.005,
        relaxation: int = 10,
    ) -> None:
        """Prepare the model's factorisations; handles are set later."""
        if not noise > 0:
            raise InputError(f"noise: expected a positive number, got {noise}")
        self.model = model
        self.relaxation = relaxation
        self._rigid = rigid
        self._scale = noise * model.reference.bounding_diagonal
        self._decoder = model.decoder
        self._poisson = model.poisson
        self._factor = model.prior.factor
        self._candidates = _spread(
            np.asarray(
                np.linalg.solve(self._factor, (model.codes - model.prior.mean).T).T,
                dtype=np.float64,
            ),
            _CANDIDATES,
        )
        self._green: dict[int, FloatArray] = {}
        self._arms: dict[int, FloatArray] = {}
        self._state: _State | None = None
        self._assign([])

    @property
    def handles(self) -> list[Handle]:
        """The present handles, in the order in which they were set."""
        return list(self._handles)

    def set_handles(
        self,
        vertices: ArrayLike,
        targets: ArrayLike,
        weights: ArrayLike | None = None,
        hard: bool | Sequence[bool] = False,
    ) -> None:
        """Replace all handles.

        Args:
            vertices: (H,) vertex indices; H may be 0. A vertex given twice asks for the weighted
                mean of its targets.
            targets: (H, 3) positions.
            weights: (H,) positive factors, or None for ones.
            hard: one for all, or (H,): meet the target exactly.

        Raises:
            InputError: an index out of range, a target that is not finite, lengths that differ.
        """
        index = np.asarray(vertices)
        if index.size == 0:
            index = index.astype(np.int64).reshape(0)
        goals = (
            np.asarray(targets, dtype=np.float64).reshape(-1, 3)
            if index.size == 0
            else (np.asarray(targets, dtype=np.float64))
        )
        V = len(self.model.reference.vertices)
        if index.ndim != 1 or not np.issubdtype(index.dtype, np.integer):
            raise InputError(f"vertices: expected (H,) integers, got {index.dtype} {index.shape}")
        H = len(index)
        if goals.shape != (H, 3):
            raise InputError(f"targets: expected ({H}, 3), one a handle, got {goals.shape}")
        factors = np.ones(H) if weights is None else np.asarray(weights, dtype=np.float64)
        exact = (
            np.broadcast_to(np.asarray(hard, dtype=bool), (H,))
            if np.ndim(hard) == 0
            else (np.asarray(hard, dtype=bool))
        )
        for name, array in (("weights", factors), ("hard", exact)):
            if array.shape != (H,):
                raise InputError(f"{name}: expected ({H},), one a handle, got {array.shape}")
        for h in range(H):
            if not 0 <= index[h] < V:
                raise InputError(
                    f"handle {h}: vertex {index[h]} does not exist; the mesh has 0…{V - 1}"
                )
            if not np.isfinite(goals[h]).all():
                raise InputError(f"handle {h}: target {goals[h].tolist()} is not finite")
            if not (np.isfinite(factors[h]) and factors[h] > 0):
                raise InputError(f"handle {h}: weight {factors[h]} is not a positive number")
        self._assign(
            [
                Handle(int(v), (float(t[0]), float(t[1]), float(t[2])), float(w), bool(e))
                for v, t, w, e in zip(index, goals, factors, exact, strict=True)
            ]
        )

    def solve(self, warm: bool = False) -> Pose:
        """Pose for the present handles.

        Args:
            warm: start from the last solution only (a frame of a drag). Otherwise several starts
                are tried, and the result does not depend on what was solved before.
        """
        begun = time.perf_counter()
        if warm and self._state is not None:
            best, steps = self._descend(self._state.x, 12)
        else:
            found = [self._descend(x, 40) for x in self._starts()]
            steps = sum(count for _, count in found)
            best = min((state for state, _ in found), key=lambda state: state.energy)
        self._state = best
        return self._pose(best, steps, begun)

    def drag(self, vertex: int, position: ArrayLike) -> Pose:
        """Move the target of one handle and solve from the last solution.

        Raises:
            InputError: `vertex` has no handle.
        """
        position = np.asarray(position, dtype=np.float64)
        places = [h for h, handle in enumerate(self._handles) if handle.vertex == vertex]
        if not places:
            raise InputError(
                f"vertex {vertex} has no handle; handles are at "
                f"{[handle.vertex for handle in self._handles]}"
            )
        if position.shape != (3,) or not np.isfinite(position).all():
            raise InputError(f"position: expected 3 finite numbers, got {position.tolist()}")
        target = (float(position[0]), float(position[1]), float(position[2]))
        moved = self.handles
        for h in places:
            moved[h] = Handle(vertex, target, moved[h].weight, moved[h].hard)
        self._assign(moved)
        return self.solve(warm=True)

    def _assign(self, handles: list[Handle]) -> None:
        """Take over the handles; Green rows of vertices that stay are kept."""
        self._handles = handles
        vertices = sorted({handle.vertex for handle in handles})
        new = [v for v in vertices if v not in self._green]
        if new:
            rows = self._poisson.green_rows(new)
            for vertex, row, arm in zip(new, rows, self._poisson.arms(rows), strict=True):
                self._green[vertex], self._arms[vertex] = row, arm
        for gone in [v for v in self._green if v not in set(vertices)]:
            del self._green[gone], self._arms[gone]
        V = len(self.model.reference.vertices)
        self._vertices: IntArray = np.array(vertices, dtype=np.int64)
        self._arm_array = (
            np.stack([self._arms[v] for v in vertices]) if vertices else np.empty((0, V, 3))
        )
        place = {v: n for n, v in enumerate(vertices)}
        self._weights = np.zeros(len(vertices))
        self._targets = np.zeros((len(vertices), 3))
        self._hard = np.zeros(len(vertices), dtype=bool)
        for handle in handles:
            n = place[handle.vertex]
            self._weights[n] += handle.weight
            self._targets[n] += handle.weight * np.array(handle.target)
            self._hard[n] |= handle.hard
        if vertices:
            self._targets /= self._weights[:, None]

    def _features(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Latent code and features (V, 9) of the unknowns."""
        z = self.model.prior.mean + self._factor @ x[: self.model.components]
        return z, self._decoder.features(z)

    def _prior_terms(self, x: FloatArray) -> FloatArray:
        terms = x.copy()
        K = self.model.components
        terms[K : K + 3] /= _ROTATION_SCALE
        terms[K + 3 :] /= _TRANSLATION_SCALE
        return terms

    def _move(self, x: FloatArray, p: FloatArray) -> FloatArray:
        """Rigid motion of points (n, 3) given relative to the reference's centroid."""
        K = self.model.components
        D = self.model.reference.bounding_diagonal
        return p @ log_to_rotation(x[K : K + 3]).T + self._poisson.centroid + D * x[K + 3 :]

    def _misfit(self, x: FloatArray, p: FloatArray) -> FloatArray:
        """Weighted handle residuals (H, 3) of handle positions p relative to the centroid."""
        return (np.sqrt(self._weights) / self._scale)[:, None] * (self._move(x, p) - self._targets)

    def _evaluate(self, x: FloatArray) -> _State:
        _, q = self._features(x)
        misfit = self._misfit(x, arm_positions(q, self._arm_array))
        prior = self._prior_terms(x)
        return _State(x, float((misfit**2).sum() + prior @ prior), q)

    def _descend(self, x: FloatArray, limit: int) -> tuple[_State, int]:
        """Levenberg–Marquardt from x; the energy never rises."""
        state = self._evaluate(x)
        K = self.model.components
        active = np.arange(K + 6 if self._rigid else K)
        scale = np.ones(K + 6)
        scale[K : K + 3] = _ROTATION_SCALE**-2
        scale[K + 3 :] = _TRANSLATION_SCALE**-2
        damping = 1e-3
        for step_count in range(limit):
            J, misfit = self._jacobian(state)
            H = J.T @ J + np.diag(scale)
            gradient = J.T @ misfit + scale * state.x
            H, gradient = H[np.ix_(active, active)], gradient[active]
            accepted = None
            while damping < 1e8:
                step = np.zeros(K + 6)
                step[active] = np.linalg.solve(H + damping * np.diag(np.diag(H)), -gradient)
                trial = self._evaluate(state.x + step)
                if trial.energy <= state.energy:
                    accepted = trial
                    break
                damping *= 8.0
            if accepted is None:
                return state, step_count
            gain = state.energy - accepted.energy
            state = accepted
            damping = max(damping / 8.0, 1e-9)
            if gain <= 1e-5 * state.energy + 1e-9:
                return state, step_count + 1
        return state, limit

    def _jacobian(self, state: _State) -> tuple[FloatArray, FloatArray]:
        """Derivative (3H, K+6) of the weighted misfit and the misfit (3H,)."""
        K = self.model.components
        D = self.model.reference.bounding_diagonal
        H = len(self._vertices)
        z = self.model.prior.mean + self._factor @ state.x[:K]
        p, g = arm_sensitivities(state.q, self._arm_array)
        V = len(self.model.reference.vertices)
        latent = self._decoder.pull_back(z, g.reshape(3 * H, V, 9)) @ self._factor
        omega = state.x[K : K + 3]
        Q = log_to_rotation(omega)
        J = np.empty((H, 3, K + 6))
        J[:, :, :K] = np.einsum("ab,hbk->hak", Q, latent.reshape(H, 3, K))
        # ∂(exp(ω) p)/∂ω = −exp(ω) [p]× J_right(ω)
        J[:, :, K : K + 3] = -Q @ _cross_matrices(p) @ right_jacobian(omega)
        J[:, :, K + 3 :] = D * np.eye(3)
        J *= (np.sqrt(self._weights) / self._scale)[:, None, None]
        return J.reshape(3 * H, K + 6), self._misfit(state.x, p).ravel()

    def _starts(self) -> list[FloatArray]:
        """The prior's mean and the training codes that fit the handles best, rigidly placed."""
        K = self.model.components
        mean = self._place(np.zeros(K + 6))
        if len(self._vertices) == 0:
            return [mean]
        scored = []
        for y in self._candidates:
            x = self._place(np.concatenate([y, np.zeros(6)]))
            scored.append((self._evaluate(x).energy, x))
        scored.sort(key=lambda entry: entry[0])
        return [mean, *(x for _, x in scored[:_STARTS])]

    def _place(self, x: FloatArray) -> FloatArray:
        """Translate the shape of x so that the handles' weighted centroid is the targets'."""
        if not self._rigid or len(self._vertices) == 0:
            return x
        _, q = self._features(x)
        w = self._weights / self._weights.sum()
        offset = w @ self._targets - w @ self._move(x, arm_positions(q, self._arm_array))
        placed = x.copy()
        placed[-3:] += offset / self.model.reference.bounding_diagonal
        return placed

    def _pose(self, state: _State, steps: int, begun: float) -> Pose:
        z, q = self._features(state.x)
        K = self.model.components
        D = self.model.reference.bounding_diagonal
        free = self._poisson.reconstruct(q) - self._poisson.centroid
        p = self._move(state.x, free)
        if self._hard.any():
            chosen = np.flatnonzero(self._hard)
            green = np.stack([self._green[int(v)] for v in self._vertices[chosen]])
            p = relax(
                self._poisson,
                p,
                green,
                self._vertices[chosen],
                self._targets[chosen],
                self.relaxation,
            )
        targets = np.array([handle.target for handle in self._handles]).reshape(-1, 3)
        index = np.array([handle.vertex for handle in self._handles], dtype=np.int64)
        return Pose(
            vertices=p,
            z=z,
            rotation=state.x[K : K + 3].copy(),
            translation=D * state.x[K + 3 :],
            residual=np.linalg.norm(p[index] - targets, axis=1),
            iterations=steps,
            milliseconds=1000.0 * (time.perf_counter() - begun),
            prior_distance=float(np.linalg.norm(state.x[:K])),
            energy=state.energy,
        )


def _cross_matrices(p: FloatArray) -> FloatArray:
    """Matrices (n, 3, 3) with [p]× v = p × v."""
    out = np.zeros((len(p), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -p[:, 2], p[:, 1], -p[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = p[:, 2], -p[:, 1], p[:, 0]
    return out


def _spread(points: FloatArray, count: int) -> FloatArray:
    """Up to `count` of the points (N, K), each the farthest from those before it."""
    chosen = [int(np.linalg.norm(points, axis=1).argmin())]
    nearest = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen]
