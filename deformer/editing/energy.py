"""The energy of a handle fit and its descent, over the unknowns x = (y, ω, t).

y is the whitened latent code, z = μ + L y with Σ = L Lᵀ; ω a rotation vector and t a translation
in bounding diagonals, both of a rigid motion about the reference's centroid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from deformer.editing.handle_positions import Evaluation, Handles
from deformer.geometry import FloatArray, log_to_rotation, right_jacobian
from deformer.model import (
    FREE,
    BendLimits,
    DeformationModel,
    LatentPrior,
    RigidPrior,
    cost_of_freedom,
)


@dataclass(frozen=True, eq=False)
class HandleObjective:
    """Σ_h w_h ‖Q p_h(z) + t − q_h‖² / (σ D)² + ‖y‖² + ‖b(z)‖² + m(ω, t).

    Handles p_h are those of the shape with its centroid where `RigidPrior` has it; b is what bends
    more than in any example (`BendLimits.excess`).

    The rigid motion costs m = min(‖ω‖²/s_ω² + ‖t‖²/s_t², ‖ω‖²/S_ω² + ‖t‖²/S_t² + c): it is as small
    as the training shapes' (`RigidPrior` s), or, at the cost c, anything at all (S). With a
    `freedom` it is ‖ω‖²/S_ω² + ‖t‖²/S_t² over freedom².

    Args:
        prior: of the latent code.
        factor: its Cholesky factor L (K, K).
        centroid: (3,) of the reference.
        diagonal: D, bounding diagonal of the reference.
        noise: σ.
        rigid: whether ω and t are unknowns; otherwise they stay zero.
        targets: (H, 3).
        weights: (H,).
        rigid_prior: s, or None where it is not known.
        freedom: factor on the deviations S of the rigid motion; None is the minimum above.
        sole: the one of the minimum's terms that counts, 0 or 1; None is the minimum.
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
    sole: int | None = None
    limits: BendLimits | None = None

    @classmethod
    def of(cls, model: DeformationModel, noise: float, rigid: bool) -> HandleObjective:
        """For a model, without handles."""
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

    def apart(self) -> list[HandleObjective]:
        """One energy for each term of the rigid motion's minimum; this is the least of them."""
        return [replace(self, sole=term) for term in range(len(self._stiffnesses))]

    @property
    def size(self) -> int:
        """Number of unknowns, K + 6."""
        return len(self.prior.mean) + 6

    def code(self, x: FloatArray) -> FloatArray:
        """Latent code z (K,) of the unknowns."""
        return self.prior.mean + self.factor @ x[:-6]

    def unknowns(self, z: FloatArray, rotation: FloatArray, move: FloatArray) -> FloatArray:
        """Unknowns x of a latent code (K,) and a rigid motion; the inverse of `code`."""
        y = np.linalg.solve(self.factor, z - self.prior.mean)
        return np.asarray(np.concatenate([y, rotation, move]), dtype=np.float64)

    def motion(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rigid motion of points given relative to the centroid: rotation (3, 3), origin (3,)."""
        return log_to_rotation(x[-6:-3]), self.origins(x)

    def origins(self, x: FloatArray) -> FloatArray:
        """Where the centroid goes, (..., 3), of unknowns (..., K+6)."""
        turned = log_to_rotation(x[..., -6:-3]) @ self.stands(x)[..., None]
        return self.centroid + self.diagonal * x[..., -3:] + turned[..., 0]

    def stands(self, x: FloatArray) -> FloatArray:
        """Where the centroid is before the rigid motion, (..., 3), from the reference's."""
        if self.rigid_prior is None:
            return np.zeros((*x.shape[:-1], 3))
        return self.diagonal * self.rigid_prior.centroid(
            self.prior.mean + x[..., :-6] @ self.factor.T
        )

    @cached_property
    def drift(self) -> FloatArray:
        """Derivative (3, K) of `stands` by the whitened code."""
        if self.rigid_prior is None or self.rigid_prior.gain is None:
            return np.zeros((3, self.size - 6))
        return np.asarray(self.diagonal * self.rigid_prior.gain @ self.factor, dtype=np.float64)

    def move(self, x: FloatArray, p: FloatArray) -> FloatArray:
        """Rigid motion of points (n, 3) given relative to the centroid."""
        Q, place = self.motion(x)
        return p @ Q.T + place

    def move_back(self, x: FloatArray, points: FloatArray) -> FloatArray:
        """Inverse of `move`."""
        Q, place = self.motion(x)
        return (points - place) @ Q

    def energy(self, x: FloatArray, p: FloatArray) -> float:
        """Value at x with handle positions p (H, 3) relative to the centroid."""
        misfit = self._misfit(x, p)
        stiffness, cost = self.stiffness(x)
        beyond, _ = self.beyond(x)
        return float((misfit**2).sum() + (stiffness * x**2).sum() + (beyond**2).sum()) + cost

    def beyond(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What bends more than any example, b (..., m), and its derivative (..., m, K) by y.

        Of unknowns (..., K+6); m counts the bends that are outside in any of them.
        """
        if self.limits is None:
            return np.zeros((*x.shape[:-1], 0)), np.zeros((*x.shape[:-1], 0, self.size - 6))
        every = self.limits.excess(self.prior.mean + x[..., :-6] @ self.factor.T)
        some = np.flatnonzero(every.reshape(-1, every.shape[-1]).any(axis=0))
        slope = self.limits.directions[some] @ self.factor / self.limits.slack[some, None]
        b = every[..., some]
        return b, (b != 0)[..., None] * slope

    def placed(self, x: FloatArray, p: FloatArray) -> FloatArray:
        """The unknowns x, translated so that the handles' weighted centroid is the targets'."""
        if not self.rigid or len(p) == 0:
            return x
        w = self.weights / self.weights.sum()
        moved = x.copy()
        moved[-3:] += (w @ self.targets - w @ self.move(x, p)) / self.diagonal
        return moved

    def descend(
        self,
        handles: Handles,
        x: FloatArray,
        limit: int,
        tolerance: float = 1e-5,
        here: Evaluation | None = None,
    ) -> tuple[FloatArray, float, int]:
        """Levenberg–Marquardt from x; the energy never rises.

        Args:
            handles: their positions and derivatives.
            x: unknowns to start from.
            limit: most steps.
            tolerance: relative gain of a step that ends the descent.
            here: the evaluation of `handles` at x, if it is known.

        Returns:
            x, energy, and the steps taken; it ends after `limit` steps, or when a step gains less
            than `tolerance` of the energy.
        """
        active = self.size if self.rigid else self.size - 6
        if here is None:
            here = handles.at(self.code(x))
        energy = self.energy(x, here.positions)
        damping = 1e-3
        for count in range(limit):
            J = self._jacobian(x, here.positions, here.derivative())[:, :active]
            misfit = self._misfit(x, here.positions).ravel()
            stiffness, _ = self.stiffness(x)
            H = J.T @ J
            diagonal = np.einsum("ii->i", H)
            diagonal += stiffness[:active]
            gradient = J.T @ misfit + stiffness[:active] * x[:active]
            beyond, slope = self.beyond(x)
            H[: self.size - 6, : self.size - 6] += slope.T @ slope
            gradient[: self.size - 6] += slope.T @ beyond
            plain = diagonal.copy()
            while True:
                diagonal[:] = plain * (1.0 + damping)
                trial = x.copy()
                trial[:active] -= np.linalg.solve(H, gradient)
                there = handles.at(self.code(trial))
                value = self.energy(trial, there.positions)
                if value <= energy:
                    break
                damping *= 8.0
                if damping > 1e8:
                    return x, energy, count
            gain = energy - value
            x, energy, here = trial, value, there
            damping = max(damping / 8.0, 1e-9)
            if gain <= tolerance * energy + 1e-9:
                return x, energy, count + 1
        return x, energy, limit

    def stiffness(self, x: FloatArray) -> tuple[FloatArray, float]:
        """Weights (K+6,) of the squared unknowns at x, and what it costs to have these."""
        motion = x[-6:] ** 2
        return min(self._stiffnesses, key=lambda entry: entry[0][-6:] @ motion + entry[1])

    @cached_property
    def _stiffnesses(self) -> list[tuple[FloatArray, float]]:
        """What `stiffness` chooses from."""
        code = np.ones(self.size - 6)
        if self.freedom is not None or self.rigid_prior is None:
            return [(np.concatenate([code, FREE.stiffness(self.freedom or 1.0)]), 0.0)]
        terms = [
            (np.concatenate([code, self.rigid_prior.stiffness()]), 0.0),
            (np.concatenate([code, FREE.stiffness()]), cost_of_freedom(self.rigid_prior)),
        ]
        return terms if self.sole is None else [terms[self.sole]]

    def _row_weights(self) -> FloatArray:
        return np.sqrt(self.weights) / (self.noise * self.diagonal)

    def _misfit(self, x: FloatArray, p: FloatArray) -> FloatArray:
        return self._row_weights()[:, None] * (self.move(x, p) - self.targets)

    def posterior(self, x: FloatArray, p: FloatArray, dp: FloatArray) -> FloatArray:
        """Covariance (n, n) of the unknowns given the handles: Laplace's approximation at x.

        n is K+6, or K where the rigid motion is no unknown; p (H, 3) and dp (H, 3, K) are the
        handle positions and their derivative.
        """
        active = self.size if self.rigid else self.size - 6
        J = self._jacobian(x, p, dp)[:, :active]
        H = J.T @ J + np.diag(self.stiffness(x)[0][:active])
        _, slope = self.beyond(x)
        H[: self.size - 6, : self.size - 6] += slope.T @ slope
        return np.asarray(np.linalg.inv(H), dtype=np.float64)

    def _jacobian(self, x: FloatArray, p: FloatArray, dp: FloatArray) -> FloatArray:
        """Derivative (3H, K+6) of the misfit."""
        J = self.tangents(x, p, dp) * self._row_weights()[:, None, None]
        return J.reshape(3 * len(p), self.size)

    def tangents(self, x: FloatArray, p: FloatArray, dp: FloatArray) -> FloatArray:
        """Derivative (H, 3, K+6) of moved points p (H, 3) with derivative dp (H, 3, K)."""
        H = len(p)
        omega = x[-6:-3]
        Q = log_to_rotation(omega)
        J = np.empty((H, 3, self.size))
        J[:, :, :-6] = Q @ (dp @ self.factor + self.drift)
        # ∂(exp(ω) p)/∂ω = −exp(ω) [p]× J_right(ω)
        J[:, :, -6:-3] = -Q @ _cross_matrices(p + self.stands(x)) @ right_jacobian(omega)
        J[:, :, -3:] = self.diagonal * np.eye(3)
        return J


def _cross_matrices(p: FloatArray) -> FloatArray:
    """Matrices (n, 3, 3) with [p]× v = p × v."""
    out = np.zeros((len(p), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -p[:, 2], p[:, 1], -p[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = p[:, 2], -p[:, 1], p[:, 0]
    return out
