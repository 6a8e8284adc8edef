"""The energy of a handle fit and its descent, over the unknowns x = (y, ω, t).

y is the whitened latent code, z = μ + L y with Σ = L Lᵀ; ω a rotation vector and t a translation
in bounding diagonals, both of a rigid motion about the shape's centroid (`Unknowns`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

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
# A step that gains less than this of an energy near zero ends a descent.
_ABSOLUTE_GAIN = 1e-9


@dataclass(frozen=True, eq=False)
class HandleEnergy:
    """Σ_h w_h ‖Q (p_h(z) + c(z)) + t − q_h‖² / (σ D)² + ‖y‖² + ‖b(z)‖² + m(ω, t).

    p_h are handle positions relative to the shape's centroid, c is the centroid that shapes of the
    code have (`RigidPrior.centroid`), Q = exp(ω), and b is what bends more than in any example
    (`BendLimits.excess`).

    The rigid motion costs m = min(‖ω‖²/s_ω² + ‖t‖²/s_t², ‖ω‖²/S_ω² + ‖t‖²/S_t² + cost): it is as
    small as the training shapes' (deviations s of the rigid prior), or, at a cost, anything at all
    (S). With a `freedom` it is ‖ω‖²/S_ω² + ‖t‖²/S_t² over freedom².

    Args:
        prior: of the latent code, K dimensions.
        factor: its Cholesky factor L (K, K).
        centroid: (3,) of the reference.
        diagonal: D, bounding diagonal of the reference.
        noise: σ, in bounding diagonals.
        rigid: whether ω and t are unknowns; otherwise they stay zero.
        targets: q (H, 3).
        weights: w (H,).
        rigid_prior: s and c, or None where they are not known.
        freedom: factor on the deviations S of the rigid motion; None is the minimum above.
        rigid_term: the one of the minimum's terms that counts, 0 or 1; None is the minimum.
        limits: of bends, or None where they are not known.
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
    freedom: float | None = None
    rigid_term: int | None = None
    limits: BendLimits | None = None

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
        """One energy for each term of the rigid motion's minimum; this is the least of them."""
        return [replace(self, rigid_term=term) for term in range(len(self._stiffnesses))]

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
        return log_to_rotation(Unknowns(x).rotation), self.centroids(x)

    def centroids(self, x: FloatArray) -> FloatArray:
        """The shape's centroid after the rigid motion, (..., 3), of unknowns (..., K+6)."""
        parts = Unknowns(x)
        turned = log_to_rotation(parts.rotation) @ self.centroid_offset(x)[..., None]
        return self.centroid + self.diagonal * parts.translation + turned[..., 0]

    def centroid_offset(self, x: FloatArray) -> FloatArray:
        """c(z) (..., 3): the centroid before the rigid motion, relative to the reference's."""
        if self.rigid_prior is None:
            return np.zeros((*x.shape[:-1], 3))
        return self.diagonal * self.rigid_prior.centroid(self.codes(x))

    @cached_property
    def centroid_jacobian(self) -> FloatArray:
        """∂c/∂y (3, K): derivative of `centroid_offset` by the whitened code."""
        if self.rigid_prior is None or self.rigid_prior.gain is None:
            return np.zeros((3, self.components))
        gain = self.diagonal * self.rigid_prior.gain @ self.factor
        return np.asarray(gain, dtype=np.float64)

    def move(self, x: FloatArray, p: FloatArray) -> FloatArray:
        """Rigid motion of points (n, 3) given relative to the shape's centroid."""
        Q, origin = self.rigid_motion(x)
        return p @ Q.T + origin

    def move_back(self, x: FloatArray, points: FloatArray) -> FloatArray:
        """Inverse of `move`."""
        Q, origin = self.rigid_motion(x)
        return (points - origin) @ Q

    def value(self, x: FloatArray, p: FloatArray) -> float:
        """The energy at x (K+6,) with handle positions p (H, 3) relative to the centroid."""
        misfit = self._misfit(x, p)
        stiffness, cost = self.stiffness(x)
        excess, _ = self.excess_bending(x)
        return float((misfit**2).sum() + (stiffness * x**2).sum() + (excess**2).sum()) + cost

    def excess_bending(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What bends more than any example, b (..., m), and ∂b/∂y (..., m, K).

        Of unknowns (..., K+6); m counts the bends that are outside in any of them.
        """
        if self.limits is None:
            return np.zeros((*x.shape[:-1], 0)), np.zeros((*x.shape[:-1], 0, self.components))
        every = self.limits.excess(self.codes(x))
        some = np.flatnonzero(every.reshape(-1, every.shape[-1]).any(axis=0))
        slope = self.limits.directions[some] @ self.factor / self.limits.slack[some, None]
        b = every[..., some]
        return b, (b != 0)[..., None] * slope

    def translated_to_targets(self, x: FloatArray, p: FloatArray) -> FloatArray:
        """x, translated so that the handles' weighted centroid is that of the targets."""
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
        """Levenberg–Marquardt from x; the energy never rises.

        Args:
            positions: of the handles, with their derivatives.
            x: (K+6,) unknowns to start from.
            steps: most steps.
            relative_gain: a step that gains less of the energy ends the descent.
            here: the evaluation of `positions` at x, if it is known.

        Returns:
            x (K+6,), the energy there, and the steps taken.
        """
        here = positions.at(self.code(x)) if here is None else here
        found = descend(
            _Point(self, positions, x, here),
            steps=steps,
            relative_gain=relative_gain,
            absolute_gain=_ABSOLUTE_GAIN,
            damping=_DAMPING,
        )
        return found.point.x, found.point.energy, found.steps

    def stiffness(self, x: FloatArray) -> tuple[FloatArray, float]:
        """Weights (K+6,) of the squared unknowns at x, and the cost of having these."""
        motion = Unknowns(x).motion ** 2
        return min(
            self._stiffnesses, key=lambda entry: Unknowns(entry[0]).motion @ motion + entry[1]
        )

    @cached_property
    def _stiffnesses(self) -> list[tuple[FloatArray, float]]:
        """The terms of which `stiffness` takes the least."""
        code = np.ones(self.components)
        if self.freedom is not None or self.rigid_prior is None:
            return [(np.concatenate([code, DIFFUSE_PRIOR.stiffness(self.freedom or 1.0)]), 0.0)]
        terms = [
            (np.concatenate([code, self.rigid_prior.stiffness()]), 0.0),
            (
                np.concatenate([code, DIFFUSE_PRIOR.stiffness()]),
                diffuse_prior_cost(self.rigid_prior),
            ),
        ]
        return terms if self.rigid_term is None else [terms[self.rigid_term]]

    def _row_weights(self) -> FloatArray:
        return np.sqrt(self.weights) / (self.noise * self.diagonal)

    def _misfit(self, x: FloatArray, p: FloatArray) -> FloatArray:
        return self._row_weights()[:, None] * (self.move(x, p) - self.targets)

    def normal_equations(self, x: FloatArray, here: Evaluation) -> tuple[FloatArray, FloatArray]:
        """Gauss–Newton matrix (n, n) and half the gradient (n,) of the active unknowns at x."""
        n, K = self.active, self.components
        J = self._jacobian(x, here.positions, here.derivative())[:, :n]
        misfit = self._misfit(x, here.positions).ravel()
        stiffness, _ = self.stiffness(x)
        H = J.T @ J
        np.einsum("ii->i", H)[:] += stiffness[:n]
        gradient = J.T @ misfit + stiffness[:n] * x[:n]
        excess, slope = self.excess_bending(x)
        H[:K, :K] += slope.T @ slope
        gradient[:K] += slope.T @ excess
        return H, gradient

    def posterior(self, x: FloatArray, here: Evaluation) -> FloatArray:
        """Covariance (n, n) of the active unknowns given the handles: Laplace's approximation at x.

        Args:
            x: (K+6,) unknowns.
            here: the handle positions there.
        """
        return np.asarray(np.linalg.inv(self.normal_equations(x, here)[0]), dtype=np.float64)

    def _jacobian(self, x: FloatArray, p: FloatArray, dp: FloatArray) -> FloatArray:
        """Derivative (3H, K+6) of the misfit."""
        J = self.tangents(x, p, dp) * self._row_weights()[:, None, None]
        return J.reshape(3 * len(p), self.size)

    def tangents(self, x: FloatArray, p: FloatArray, dp: FloatArray) -> FloatArray:
        """Derivative (H, 3, K+6) of moved points p (H, 3) with derivative dp (H, 3, K)."""
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
        positions: of the handles.
        x: (K+6,) unknowns.
        here: the positions at x.
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
