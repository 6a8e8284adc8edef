"""Shapes whose edge lengths and dihedral angles are a linear combination of components."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import sparse

from deformer.acap import PoissonSystem
from deformer.baselines._connection import Connection
from deformer.baselines._gradient_space import least_inverse, weak_prior_precision
from deformer.baselines._shell import DAMPING, SHORTENINGS, Shell
from deformer.editing import schur_inverse
from deformer.geometry import FloatArray, IntArray, procrustes
from deformer.linalg import damped_step, descend
from deformer.model import LatentPrior

# Relative gain of the energy that ends a reconstruction, and its largest number of steps.
_TOLERANCE = 1e-4
_STEPS = 30
# Size of the cache of reconstructions: encoding needs them for the frames, and decoding follows.
_CACHED_SHAPES = 64
# Fit to vertices. Each reconstruction starts from the previous one and has few steps only: when
# converged, it ends in a fold of its own that no change of the weights removes.
_OUTER_STEPS = 12
_INNER_STEPS = 6
_OUTER_TOLERANCE = 1e-3
# Handle fits: number of examples that descents start from, first steps of each, further steps of
# the best one.
_STARTS = 2
_FIRST_STEPS = 4
_HANDLE_STEPS = 30
_HANDLE_TOLERANCE = 1e-3


class EdgeSpace:
    """Features f(w) = base + Σ_k w_k components_k of a `Shell`, and their shapes.

    No mesh may have given features exactly: a shape is then the one closest in the shell's energy.

    Args:
        shell: features of edges.
        poisson: Poisson system of the same reference.
        base: (E, 2) features at weights 0.
        components: (K, E, 2).
    """

    def __init__(
        self, shell: Shell, poisson: PoissonSystem, base: FloatArray, components: FloatArray
    ) -> None:
        """Factor the normal matrix of the components."""
        self.shell, self.poisson = shell, poisson
        self.connection = Connection(shell, poisson)
        self.base, self.components = base, components
        self.flat = components.reshape(len(components), -1)
        self._inverse = least_inverse(self.flat)
        self._cached_shape = lru_cache(_CACHED_SHAPES)(self._reconstruct)

    def features(self, w: FloatArray) -> FloatArray:
        """Features (E, 2) of weights (K,)."""
        return self.base + np.tensordot(w, self.components, axes=1)

    def project(self, features: FloatArray) -> FloatArray:
        """Weights (N, K) whose features are closest to features (N, E, 2): least squares."""
        return (features - self.base).reshape(len(features), -1) @ self.flat.T @ self._inverse

    def decode(self, w: FloatArray) -> FloatArray:
        """Shape (V, 3) of weights (K,), rigidly aligned to the reference."""
        return self._cached_shape(np.asarray(w, dtype=np.float64).tobytes()).copy()

    def _reconstruct(self, weights: bytes) -> FloatArray:
        features = self.features(np.frombuffer(weights))
        p = self.connection.shape(features)
        p = self.shell.closest(features, p, _STEPS, _TOLERANCE)
        return rigidly_aligned(p, self.shell.reference.vertices)

    def tangents(self, p: FloatArray) -> FloatArray:
        """Derivative (K, V, 3) of the decoded shape p (V, 3) with respect to the weights.

        The Gauss–Newton approximation, which neglects the residual of the features. Features do not
        depend on rigid motions, so the derivative has none.
        """
        J, H = self.shell.normal_matrix(p)
        change = self.shell.factor(H).solve(J.T @ self.flat.T).T
        return change.reshape(len(self.flat), -1, 3)

    def closest(self, target: FloatArray, w: FloatArray, prior: LatentPrior) -> FloatArray:
        """Weights (K,) whose shape is closest to `target` (V, 3) after the best rigid motion.

        Damped Gauss–Newton from weights w (K,) through the reconstruction, with a weak prior for
        components that the shape does not determine.
        """
        precision = weak_prior_precision(prior, self.shell.reference.bounding_diagonal)
        start = _Closest(
            self, target, precision, prior.mean, w, rigidly_aligned(self.decode(w), target)
        )
        return descend(start, steps=_OUTER_STEPS, relative_gain=_OUTER_TOLERANCE).point.w


def rigidly_aligned(p: FloatArray, target: FloatArray) -> FloatArray:
    """Points (V, 3) after the rigid motion that brings them closest to the target (V, 3)."""
    R, t = procrustes(p, target)
    return p @ R.T + t


@dataclass(eq=False)
class _Closest:
    """A point of the descent: weights w, their shape p, its squared distance from the target."""

    space: EdgeSpace
    target: FloatArray
    precision: FloatArray
    mean: FloatArray
    w: FloatArray
    p: FloatArray

    def __post_init__(self) -> None:
        self.residual = self.p - self.target
        away = self.w - self.mean
        self.energy = float((self.residual**2).sum() + away @ self.precision @ away)
        self._normal: tuple[FloatArray, FloatArray, FloatArray] | None = None

    def step(self, damping: float) -> FloatArray:
        _, H, gradient = self.normal_equations()
        return damped_step(H, gradient, damping)

    def normal_equations(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Jacobian (K, 3V) of the shape, Gauss–Newton matrix (K, K) and half the gradient (K,)."""
        if self._normal is None:
            J = self.space.tangents(self.p).reshape(len(self.w), -1)
            gradient = J @ self.residual.ravel() + self.precision @ (self.w - self.mean)
            self._normal = J, J @ J.T + self.precision, gradient
        return self._normal

    def moved(self, step: FloatArray) -> _Closest:
        w = self.w + step
        guess = self.p + (step @ self.normal_equations()[0]).reshape(-1, 3)
        p = self.space.shell.closest(self.space.features(w), guess, _INNER_STEPS, _TOLERANCE)
        return _Closest(
            self.space, self.target, self.precision, self.mean, w, rigidly_aligned(p, self.target)
        )


class EdgeDeformation:
    """Poses a mesh by a few handles, with edge lengths and dihedral angles of the components.

    With handles h, `fit` minimises over positions p and weights w

        ‖f(p) − f(w)‖² / (σ² E) + (w − μ)ᵀ Σ⁻¹ (w − μ)      where p_h = q_h

    (Σ_h ‖p_h − q_h‖² / ε² in place of the constraint, for targets with errors ε) by damped
    Gauss–Newton on both together; rigid motions are free. It starts from the training shapes that,
    rigidly aligned to the targets, need the least energy to reach them.

    Args:
        space: components, and features of weights.
        prior: Gaussian prior of the weights.
        examples: (N, V, 3) training shapes.
        codes: (N, K) their weights.
    """

    def __init__(
        self, space: EdgeSpace, prior: LatentPrior, examples: FloatArray, codes: FloatArray
    ) -> None:
        """Whiten the weights."""
        self.space, self.prior, self.examples = space, prior, examples
        self.factor = prior.factor
        white = np.linalg.solve(self.factor, (codes - prior.mean).T).T
        self.white = np.asarray(white, dtype=np.float64)
        # Derivative (K, 2E) of the features with respect to the whitened weights.
        self.slopes = self.factor.T @ space.flat

    def fit(
        self, vertices: IntArray, targets: FloatArray, noise: float, error: float = 0.0
    ) -> FloatArray:
        """Vertices (V, 3) of the fitted mesh.

        Args:
            vertices: (H,) int64 handles, all different, H ≥ 1.
            targets: (H, 3) positions.
            noise: σ, the root mean square residual of an edge's feature that adds as much energy as
                one standard deviation of the prior; no unit.
            error: ε, standard deviation of the targets' coordinates, in the data's units; with 0
                the handles are exactly at their targets.
        """
        poisson = self.space.poisson
        green = poisson.green_rows(vertices)
        inverse = schur_inverse(green[:, vertices])
        moved, energy = [], []
        for shape in self.examples:
            R, t = procrustes(shape[vertices], targets)
            aligned = shape @ R.T + t
            d = targets - aligned[vertices]
            correction = inverse[:-1, :-1] @ d
            moved.append(aligned + green.T @ correction + inverse[-1, :-1] @ d)
            energy.append(float(np.vdot(correction, d)))
        goals, pull = np.zeros(self.examples.shape[1:]), np.zeros(self.examples.shape[1:])
        goals[vertices], pull[vertices] = targets, np.inf if error == 0 else error**-2
        weight = 1.0 / (noise**2 * len(self.space.base))
        found = []
        for n in np.argsort(energy, kind="stable")[:_STARTS]:
            p = moved[n]
            p[vertices] = targets
            start = FitIterate(self, goals.ravel(), pull.ravel(), weight, p, self.white[n])
            found.append(_descend_handle_fit(start, _FIRST_STEPS))
        best = min(found, key=lambda point: point.energy)
        return _descend_handle_fit(best, _HANDLE_STEPS).p


@dataclass(eq=False)
class FitIterate:
    """One iterate of a handle fit: positions p and whitened weights y, and their energy.

    Args:
        deformation: components, prior and training shapes.
        goals: (3V,) targets of the handles' coordinates.
        pull: (3V,) weights of the squared distances from them: infinite for coordinates that stay
            where they are, 0 for those of no handle.
        weight: 1 / (σ² E) of the energy of `EdgeDeformation`.
        p: (V, 3) positions.
        y: (K,) whitened weights, w = μ + L y.

    Attributes:
        free: (n,) int64 indices of the coordinates that may move.
        residual: (2E,) features of p minus features of w.
        energy: value of the energy of `EdgeDeformation`.
    """

    deformation: EdgeDeformation
    goals: FloatArray
    pull: FloatArray
    weight: float
    p: FloatArray
    y: FloatArray

    def __post_init__(self) -> None:
        deformation = self.deformation
        w = deformation.prior.mean + deformation.factor @ self.y
        space = deformation.space
        self.residual = space.shell.difference(self.p, space.features(w)).ravel()
        self.free = np.flatnonzero(np.isfinite(self.pull))
        self.energy = float(self.weight * (self.residual**2).sum() + (self.y**2).sum())
        pull, away = self._pulled()
        self.energy += float(pull @ away**2)
        self._normal: tuple[sparse.csr_array, FloatArray, FloatArray, FloatArray] | None = None

    def _pulled(self) -> tuple[FloatArray, FloatArray]:
        """Weights (n,) of the free coordinates' squared distances from their goals; these (n,)."""
        return self.pull[self.free], self.p.ravel()[self.free] - self.goals[self.free]

    def step(self, damping: float) -> FloatArray:
        """Damped step of the free coordinates, then of y, as one vector."""
        H, B, rhs_p, rhs_y = self.normal_equations()
        slopes = self.deformation.slopes
        damped = H + sparse.diags_array(damping * H.diagonal())
        # H x + B y = rhs_p, Bᵀ x + D y = rhs_y: x is eliminated.
        factor = self.deformation.space.shell.factor(damped, self.free)
        solved = factor.solve(np.column_stack([B, rhs_p]))
        D = slopes @ slopes.T + np.eye(len(slopes)) / self.weight
        D += damping * np.diag(np.diag(D))
        y = np.linalg.solve(D - B.T @ solved[:, :-1], rhs_y - B.T @ solved[:, -1])
        step = np.concatenate([solved[:, -1] - solved[:, :-1] @ y, y])
        return np.asarray(step, dtype=np.float64)

    def normal_equations(self) -> tuple[sparse.csr_array, FloatArray, FloatArray, FloatArray]:
        """Gauss–Newton equations H x + B y = rhs_p, Bᵀ x + D y = rhs_y of a step (x, y).

        Everything is divided by `weight`; D = slopes slopesᵀ + 1 / weight does not depend on p.

        Returns:
            H (n, n), B (n, K), and half the negative gradients rhs_p (n,) and rhs_y (K,).
        """
        if self._normal is None:
            slopes = self.deformation.slopes
            J, H = self.deformation.space.shell.normal_matrix(self.p)
            J = sparse.csc_array(J)[:, self.free]
            pull, away = self._pulled()
            rhs_p = -(J.T @ self.residual) - pull * away / self.weight
            rhs_y = slopes @ self.residual - self.y / self.weight
            H = H[self.free][:, self.free] + sparse.diags_array(pull / self.weight)
            self._normal = sparse.csr_array(H), -(J.T @ slopes.T), rhs_p, rhs_y
        return self._normal

    def moved(self, step: FloatArray) -> FitIterate:
        p = self.p.copy()
        p.reshape(-1)[self.free] += step[: len(self.free)]
        y = self.y + step[len(self.free) :]
        return FitIterate(self.deformation, self.goals, self.pull, self.weight, p, y)


def _descend_handle_fit(start: FitIterate, steps: int) -> FitIterate:
    """The last point of a descent; each of its steps costs a factorisation."""
    found = descend(
        start,
        steps=steps,
        relative_gain=_HANDLE_TOLERANCE,
        damping=DAMPING,
        shortenings=SHORTENINGS,
    )
    return found.point
