"""The energy of a handle fit and its descent, over the unknowns x = (y, ω, t) of `Unknowns`.

y is the whitened latent code: z = μ + L y, with the prior's covariance Σ = L Lᵀ. The rotation
vector ω (radians) and the translation t (bounding diagonals) are a rigid motion about the
reference's centroid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from deformer.editing.bodies import Freedom, Yielding
from deformer.editing.floor import FloorTerm
from deformer.editing.handle_errors import ModelErrors
from deformer.editing.handle_positions import Evaluation, HandlePositions
from deformer.editing.unknowns import MOTION, Unknowns
from deformer.geometry import FloatArray, log_to_rotation, right_jacobian
from deformer.linalg import Damping, descend
from deformer.model import (
    DIFFUSE_PRIOR,
    BendLimits,
    DeformationModel,
    LatentPrior,
    RigidPrior,
    diffuse_prior_cost,
)

_DAMPING = Damping(initial=1e-3, up=8.0, down=8.0, floor=1e-9, ceiling=1e8)
# A step that lowers the energy by no more than this ends a descent: near an energy of zero the
# relative gain need not become small.
_ABSOLUTE_GAIN = 1e-9
# A step with a predicted gain of less than this share of the gain that ends a descent is the last
# one. Positions are in single precision: steps that gain nothing were tried again and again, each
# with more damping.
_NO_GAIN = 0.1


# Share of the components' variance that a likely code has at most.
_LIKELY = 0.5


@dataclass(frozen=True, eq=False)
class HandleEnergy:
    """Σ_h w_h ‖e_h‖² / (σ D)² + ‖y‖² + ‖b(z)‖² + m(ω, t), e_h = Q (p_h(z) + c(z)) + t − q_h.

    p_h(z) are handle positions relative to the shape's centroid, c(z) is the centroid of shapes of
    the code (`RigidPrior.centroid`), Q = exp(ω), and b(z) is the bending beyond that of every
    example (`BendLimits.excess`). A model with a misfit τ has e ᵀ Σ⁻¹ e in place of the first sum,
    with the covariance Σ of `handle_errors`.

    The rigid motion costs m = min(‖ω‖²/s_ω² + ‖t‖²/s_t², ‖ω‖²/S_ω² + ‖t‖²/S_t² + cost). In the
    first term the standard deviations s are those of the training shapes (`RigidPrior`), in the
    second S are those of `DIFFUSE_PRIOR`, and `diffuse_prior_cost` is the cost. With a `freedom`,
    m = (‖ω‖²/S_ω² + ‖t‖²/S_t²) / freedom²; the freedom of a body that yields has an m of its own
    (`Yielding`). A floor adds the squared depths of its contacts (`FloorTerm`).

    Args:
        prior: Gaussian N(μ, Σ) of the latent code, K dimensions.
        factor: Cholesky factor L (K, K) of Σ.
        centroid: (3,) centroid of the reference.
        diagonal: D, bounding diagonal of the reference.
        noise: σ, standard deviation of the targets, in bounding diagonals.
        rigid: true if ω and t are unknowns; otherwise they stay zero.
        targets: q (H, 3) positions of the handles.
        weights: w (H,) positive factors.
        rigid_prior: s and c; None for models without.
        freedom: factor on the standard deviations S, or `Yielding`; None is the minimum above.
        rigid_term: index of the only term of the minimum that counts, 0 or 1; None is the minimum.
        limits: limits of bends; None for models without.
        errors: the model's own at the handles; None if τ is 0.
        floor: the floor and which handles are its contacts, whose weights are next to zero; None
            without contacts.
    """

    prior: LatentPrior
    factor: FloatArray
    centroid: FloatArray
    diagonal: float
    noise: float
    rigid: bool
    targets: FloatArray
    weights: FloatArray
    rigid_prior: RigidPrior | None = None
    freedom: Freedom = None
    rigid_term: int | None = None
    limits: BendLimits | None = None
    errors: ModelErrors | None = None
    floor: FloorTerm | None = None

    @classmethod
    def of_model(cls, model: DeformationModel, noise: float, rigid: bool) -> HandleEnergy:
        """The energy of a model without handles."""
        return cls(
            prior=model.prior,
            factor=model.prior.factor,
            centroid=model.poisson.centroid,
            diagonal=model.reference.bounding_diagonal,
            noise=noise,
            rigid=rigid,
            targets=np.zeros((0, 3)),
            weights=np.zeros(0),
            rigid_prior=model.rigid_prior,
            limits=model.bend_limits,
        )

    def by_rigid_term(self) -> list[HandleEnergy]:
        """One energy for each term of the minimum m(ω, t); this energy is their minimum."""
        if isinstance(self.freedom, Yielding):
            return [self]
        return [replace(self, rigid_term=term) for term in range(len(self._stiffnesses))]

    @property
    def misfit(self) -> float:
        """τ, standard deviation of the model's own error at a handle, in bounding diagonals."""
        return 0.0 if self.errors is None else self.errors.misfit

    @property
    def components(self) -> int:
        """Dimensions K of the latent code."""
        return len(self.prior.mean)

    @property
    def size(self) -> int:
        """Number of unknowns, K + 6."""
        return self.components + MOTION

    @property
    def active(self) -> int:
        """Number of unknowns that a descent changes: K + 6, or K without rigid motion."""
        return self.size if self.rigid else self.components

    def code(self, x: FloatArray) -> FloatArray:
        """Latent code z (K,) of unknowns (K+6,)."""
        return self.prior.mean + self.factor @ Unknowns(x).code

    def codes(self, X: FloatArray) -> FloatArray:
        """Latent codes (..., K) of unknowns (..., K+6)."""
        return self.prior.mean + Unknowns(X).code @ self.factor.T

    def unknowns(self, z: FloatArray, rotation: FloatArray, translation: FloatArray) -> FloatArray:
        """Unknowns x (K+6,) of a latent code (K,) and a rigid motion; the inverse of `code`.

        Args:
            z: (K,) latent code.
            rotation: (3,) rotation vector, in radians.
            translation: (3,) in bounding diagonals.
        """
        y: FloatArray = np.asarray(np.linalg.solve(self.factor, z - self.prior.mean), np.float64)
        return Unknowns.join(y, rotation, translation)

    def rigid_motion(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotation (3, 3) and origin (3,) for points given relative to the shape's centroid."""
        parts = Unknowns(x)
        Q = log_to_rotation(parts.rotation)
        return Q, self.centroid + self.diagonal * parts.translation + Q @ self.centroid_offset(x)

    def centroids(self, x: FloatArray) -> FloatArray:
        """The shape's centroid after the rigid motion, (..., 3), of unknowns (..., K+6)."""
        parts = Unknowns(x)
        turned = log_to_rotation(parts.rotation) @ self.centroid_offset(x)[..., None]
        return self.centroid + self.diagonal * parts.translation + turned[..., 0]

    def centroid_offset(self, x: FloatArray) -> FloatArray:
        """c(z) (..., 3) of unknowns (..., K+6): the centroid before the rigid motion.

        It is relative to the reference's centroid, in the data's units.
        """
        if self.rigid_prior is None:
            return np.zeros((*x.shape[:-1], 3))
        return self.diagonal * self.rigid_prior.centroid(self.codes(x))

    @cached_property
    def centroid_jacobian(self) -> FloatArray:
        """∂c/∂y (3, K): derivative of `centroid_offset` with respect to the whitened code."""
        if self.rigid_prior is None or self.rigid_prior.gain is None:
            return np.zeros((3, self.components))
        gain = self.diagonal * self.rigid_prior.gain @ self.factor
        return np.asarray(gain, dtype=np.float64)

    def move(self, x: FloatArray, p: FloatArray) -> FloatArray:
        """Points p (n, 3), relative to the shape's centroid, after the rigid motion of x (K+6,)."""
        Q, origin = self.rigid_motion(x)
        return p @ Q.T + origin

    def move_back(self, x: FloatArray, points: FloatArray) -> FloatArray:
        """Points (n, 3) before the rigid motion of x (K+6,): the inverse of `move`."""
        Q, origin = self.rigid_motion(x)
        return (points - origin) @ Q

    def value(self, x: FloatArray, p: FloatArray) -> float:
        """The energy at x (K+6,) with handle positions p (H, 3) relative to the centroid."""
        misfit = self._misfit(x, p)
        stiffness, cost = self.stiffness(x)
        energy = float((misfit**2).sum() + (stiffness * x**2).sum()) + cost
        if self.limits is not None:
            energy += float((self.limits.excess(self.codes(x)) ** 2).sum())
        if self.floor is not None:
            energy += float((self.floor.misfit(self.move(x, p)) ** 2).sum())
        return energy

    def noise_within_reach(self, x: FloatArray, p: FloatArray, least: float) -> float:
        """Noise with which targets out of reach leave the code a likely one.

        σ² + τ² changes by min(e ᵀ Σ⁻¹ e / (3 H), ‖y‖² / (K / 2)): it grows while both the handles
        are farther from their targets than the errors of Σ and the code is unlikely.

        Args:
            x: (K+6,) unknowns of the minimum of this energy.
            p: (H, 3) handle positions there.
            least: the least noise.
        """
        seen = int(np.count_nonzero(self.weights))
        reach = (self._misfit(x, p) ** 2).sum() / max(3 * seen, 1)
        likely = np.square(Unknowns(x).code).sum() / (_LIKELY * self.components)
        variance = (self.noise**2 + self.misfit**2) * min(reach, likely) - self.misfit**2
        return max(least, float(np.sqrt(max(variance, 0.0))))

    def excess_bending(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bending b beyond that of every example, and its derivative ∂b/∂y.

        Args:
            x: (..., K+6) unknowns.

        Returns:
            b (..., m) and ∂b/∂y (..., m, K), for the m bends that exceed their limits at any x.
        """
        if self.limits is None:
            return np.zeros((*x.shape[:-1], 0)), np.zeros((*x.shape[:-1], 0, self.components))
        every = self.limits.excess(self.codes(x))
        some = np.flatnonzero(every.reshape(-1, every.shape[-1]).any(axis=0))
        slope = self.limits.directions[some] @ self.factor / self.limits.slack[some, None]
        b = every[..., some]
        return b, (b != 0)[..., None] * slope

    def translated_to_targets(self, x: FloatArray, p: FloatArray) -> FloatArray:
        """Unknowns with the translation that brings the handles' weighted centroid to the targets'.

        Args:
            x: (K+6,) unknowns.
            p: (H, 3) handle positions relative to the shape's centroid.
        """
        if not self.rigid or len(p) == 0:
            return x
        w = self.weights / self.weights.sum()
        moved = x.copy()
        Unknowns(moved).translation += (w @ self.targets - w @ self.move(x, p)) / self.diagonal
        return moved

    def descend(
        self,
        positions: HandlePositions,
        x: FloatArray,
        steps: int,
        relative_gain: float = 1e-5,
        here: Evaluation | None = None,
    ) -> tuple[FloatArray, float, int]:
        """Minimise by Levenberg–Marquardt from x; the energy never rises.

        Args:
            positions: handle positions as a function of the latent code.
            x: (K+6,) unknowns to start from.
            steps: largest number of steps.
            relative_gain: a step that lowers the energy by a smaller share ends the descent.
            here: the evaluation of `positions` at x, if it is known.

        Returns:
            Unknowns (K+6,), the energy there, and the number of steps taken.
        """
        here = positions.at(self.code(x)) if here is None else here

        def is_last(point: _Point, step: FloatArray) -> bool:
            return point.predicted_gain(step) <= _NO_GAIN * relative_gain * point.energy

        found = descend(
            _Point(self, positions, x, here),
            steps=steps,
            relative_gain=relative_gain,
            absolute_gain=_ABSOLUTE_GAIN,
            damping=_DAMPING,
            is_last=is_last,
            predicted_gain=_Point.predicted_gain,
        )
        return found.point.x, found.point.energy, found.steps

    def stiffness(self, x: FloatArray) -> tuple[FloatArray, float]:
        """Weights (K+6,) of the squared unknowns at x, and the constant of the rigid term there."""
        if isinstance(self.freedom, Yielding):
            weights, constant = self.freedom.stiffness(Unknowns(x).motion)
            return np.concatenate([np.ones(self.components), weights]), constant
        motion = Unknowns(x).motion ** 2
        return min(
            self._stiffnesses, key=lambda entry: Unknowns(entry[0]).motion @ motion + entry[1]
        )

    @cached_property
    def _stiffnesses(self) -> list[tuple[FloatArray, float]]:
        """Weights and constant of each term of the minimum m(ω, t)."""
        code = np.ones(self.components)
        if self.freedom is not None or self.rigid_prior is None:
            share = self.freedom if isinstance(self.freedom, float) else 1.0
            return [(np.concatenate([code, DIFFUSE_PRIOR.stiffness(share)]), 0.0)]
        terms = [
            (np.concatenate([code, self.rigid_prior.stiffness()]), 0.0),
            (
                np.concatenate([code, DIFFUSE_PRIOR.stiffness()]),
                diffuse_prior_cost(self.rigid_prior),
            ),
        ]
        return terms if self.rigid_term is None else [terms[self.rigid_term]]

    def whitening(self, weights: FloatArray) -> FloatArray:
        """Factors on the handles' errors, of weights (..., H): (..., H), or matrices (..., H, H).

        They are matrices where the model has an error of its own.
        """
        if self.errors is None:
            return np.sqrt(weights) / (self.noise * self.diagonal)
        return self.errors.whitening(weights, self.noise) / self.diagonal

    def model_error(self, at: FloatArray) -> FloatArray:
        """Expected error (H, 3) of the model at handles whose positions are `at` (H, 3).

        It points from the positions to where the handles are without their targets' errors.
        """
        if self.errors is None:
            return np.zeros_like(at)
        return self.errors.expected(self.weights, self.noise) @ (self.targets - at)

    @cached_property
    def _whitening(self) -> FloatArray:
        return self.whitening(self.weights)

    def _whitened(self, errors: FloatArray) -> FloatArray:
        """Errors of the handles (H, 3), or their derivatives (H, 3, n), in deviations."""
        if self.errors is None:
            return self._whitening.reshape(-1, *(1,) * (errors.ndim - 1)) * errors
        return np.tensordot(self._whitening, errors, 1)

    def _misfit(self, x: FloatArray, p: FloatArray) -> FloatArray:
        return self._whitened(self.move(x, p) - self.targets)

    def normal_equations(self, x: FloatArray, here: Evaluation) -> tuple[FloatArray, FloatArray]:
        """Gauss–Newton matrix (n, n) and half the gradient (n,) of the n active unknowns.

        Args:
            x: (K+6,) unknowns.
            here: the handle positions at x.
        """
        J = self._jacobian(x, here.positions, here.derivative())[:, : self.active]
        misfit = self._misfit(x, here.positions).ravel()
        H, gradient = self.prior_equations(x)
        H, gradient = H + J.T @ J, gradient + J.T @ misfit
        if self.floor is not None:
            self._add_floor(self.floor, x, here, H, gradient)
        return H, gradient

    def _add_floor(
        self, term: FloorTerm, x: FloatArray, here: Evaluation, H: FloatArray, gradient: FloatArray
    ) -> None:
        """Add the floor's part of the normal equations, that of contacts under it, in place."""
        depths = term.misfit(self.move(x, here.positions))
        under = depths > 0
        rows = term.rows[under]
        if len(rows):
            tangents = self.tangents(x, here.positions[rows], here.derivative()[rows])
            J = term.jacobian(tangents)[:, : self.active]
            H += J.T @ J
            gradient += J.T @ depths[under]

    def prior_equations(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The part of `normal_equations` without handles: that of the prior."""
        n, K = self.active, self.components
        stiffness = self.stiffness(x)[0][:n]
        H, gradient = np.diag(stiffness), stiffness * x[:n]
        excess, slope = self.excess_bending(x)
        H[:K, :K] += slope.T @ slope
        gradient[:K] += slope.T @ excess
        return H, gradient

    def _jacobian(self, x: FloatArray, p: FloatArray, dp: FloatArray) -> FloatArray:
        """Derivative (3H, K+6) of the weighted misfit."""
        J = self._whitened(self.tangents(x, p, dp))
        return J.reshape(3 * len(p), self.size)

    def tangents(self, x: FloatArray, p: FloatArray, dp: FloatArray) -> FloatArray:
        """Derivative (n, 3, K+6) of `move`.

        Args:
            x: (K+6,) unknowns.
            p: (n, 3) points relative to the shape's centroid.
            dp: (n, 3, K) derivative of p with respect to the latent code.
        """
        omega = Unknowns(x).rotation
        Q = log_to_rotation(omega)
        J = Unknowns(np.empty((len(p), 3, self.size)))
        J.code = Q @ (dp @ self.factor + self.centroid_jacobian)
        # ∂(exp(ω) p)/∂ω = −exp(ω) [p]× J_right(ω)
        J.rotation = -Q @ _cross_matrices(p + self.centroid_offset(x)) @ right_jacobian(omega)
        J.translation = self.diagonal * np.eye(3)
        return J.x


class _Point:
    """Unknowns of a handle fit, with the handle positions and the energy there.

    Args:
        function: the energy.
        positions: handle positions as a function of the latent code.
        x: (K+6,) unknowns.
        here: the handle positions at x.
    """

    def __init__(
        self, function: HandleEnergy, positions: HandlePositions, x: FloatArray, here: Evaluation
    ) -> None:
        """Evaluate the energy."""
        self._function, self._positions, self._here = function, positions, here
        self.x = x
        self.energy = function.value(x, here.positions)
        self._equations: tuple[FloatArray, FloatArray, FloatArray] | None = None

    def step(self, damping: float) -> FloatArray:
        """Damped Gauss–Newton step of the active unknowns."""
        if self._equations is None:
            H, gradient = self._function.normal_equations(self.x, self._here)
            self._equations = H, gradient, H.diagonal().copy()
        H, gradient, diagonal = self._equations
        np.einsum("ii->i", H)[:] = diagonal * (1.0 + damping)
        return np.asarray(-np.linalg.solve(H, gradient), dtype=np.float64)

    def predicted_gain(self, step: FloatArray) -> float:
        """By how much a step (n,) lowers the energy of the linearised residuals."""
        assert self._equations is not None
        return float(-self._equations[1] @ step)

    def moved(self, step: FloatArray) -> _Point:
        """The point that a step leads to."""
        x = self.x.copy()
        x[: len(step)] += step
        here = self._positions.at(self._function.code(x))
        return _Point(self._function, self._positions, x, here)


def _cross_matrices(p: FloatArray) -> FloatArray:
    """Matrices (n, 3, 3) with [p]× v = p × v."""
    out = np.zeros((len(p), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -p[:, 2], p[:, 1], -p[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = p[:, 2], -p[:, 1], p[:, 0]
    return out
