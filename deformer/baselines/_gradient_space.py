"""Shapes whose features are a linear combination of components.

Features are those of `deformer.acap`: rotation vector and stretch of each vertex. They are linear
in the weights; the Poisson solve computes vertices from them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.acap import PoissonSystem, features_to_gradients, gradient_tangents
from deformer.geometry import FloatArray
from deformer.linalg import damped_step, descend
from deformer.model import LatentPrior

# Number of components whose vertex derivatives one solve computes; bounds the memory.
_BATCH = 16

# Fit to vertices: a residual of this share of the bounding diagonal at one vertex adds as much
# energy as one standard deviation of the prior, as in `DeformationModel.fit`.
_WEAK_PRIOR = 1e-3
_STEPS = 20
_TOLERANCE = 1e-5


def weak_prior_precision(prior: LatentPrior, diagonal: float) -> FloatArray:
    """Precision (K, K) of the prior in fits to vertices; `diagonal` bounds the reference."""
    return (_WEAK_PRIOR * diagonal) ** 2 * np.asarray(np.linalg.inv(prior.covariance), np.float64)


def least_inverse(components: FloatArray) -> FloatArray:
    """(A Aᵀ)⁺ (K, K) of components A (K, n): least squares with the least weights."""
    gram = components @ components.T
    return np.asarray(np.linalg.pinv(gram, rcond=1e-10, hermitian=True), dtype=np.float64)


class GradientSpace:
    """Features q(w) = base + Σ_k w_k components_k, and the vertices rebuilt from them.

    Args:
        poisson: Poisson system of the reference.
        base: (V, 9) features at weights 0.
        components: (K, V, 9).
        gain: (9,) unit of each feature; `project` fits features divided by it.
    """

    def __init__(
        self, poisson: PoissonSystem, base: FloatArray, components: FloatArray, gain: FloatArray
    ) -> None:
        """Factor the normal matrix of the components."""
        self.poisson = poisson
        self.base, self.components, self.gain = base, components, gain
        K = len(components)
        self._scaled = (components / gain).reshape(K, -1)
        self._inverse = least_inverse(self._scaled)

    def features(self, w: FloatArray) -> FloatArray:
        """Features (V, 9) of weights (K,)."""
        return self.base + np.tensordot(w, self.components, axes=1)

    def project(self, q: FloatArray) -> FloatArray:
        """Weights (N, K) whose features are closest to features q (N, V, 9): least squares."""
        away = ((q - self.base) / self.gain).reshape(len(q), -1)
        return away @ self._scaled.T @ self._inverse

    def decode(self, w: FloatArray) -> FloatArray:
        """Vertices (N, V, 3) of weights (N, K), centroids at the reference's."""
        V = len(self.base)
        p = np.empty((len(w), V, 3))
        for n, row in enumerate(w):
            p[n] = self.poisson.reconstruct(self.features(row))
        return p

    def tangents(self, w: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Gradients T (V, 3, 3), and the derivatives of T (K, V, 3, 3) and of b(T) (K, V, 3)."""
        q = self.features(w)
        dT = gradient_tangents(q, self.components)
        db = np.stack([self.poisson.rhs(t) for t in dT])
        return features_to_gradients(q), dT, db

    def solve(self, b: FloatArray) -> FloatArray:
        """Centred solutions (K, V, 3) of the Poisson system for right-hand sides (K, V, 3)."""
        x = np.empty_like(b)
        for start in range(0, len(b), _BATCH):
            part = b[start : start + _BATCH]
            columns = part.transpose(1, 0, 2).reshape(part.shape[1], -1)
            solved = self.poisson.back_substitute(columns)
            solved -= solved.mean(axis=0)
            x[start : start + _BATCH] = solved.reshape(-1, len(part), 3).transpose(1, 0, 2)
        return x

    def closest(self, target: FloatArray, w: FloatArray, prior: LatentPrior) -> FloatArray:
        """Weights (K,) whose vertices are closest to `target` (V, 3), centroids aligned.

        Damped Gauss–Newton from weights w (K,), with a weak prior for components that the shape
        does not determine.
        """
        goal = target - target.mean(axis=0) + self.poisson.centroid
        precision = weak_prior_precision(prior, self.poisson.reference.bounding_diagonal)
        start = _Closest(self, goal, precision, prior.mean, w)
        return descend(start, steps=_STEPS, relative_gain=_TOLERANCE).point.w


@dataclass(eq=False)
class _Closest:
    """A point of the descent: weights, and the squared distance of their vertices from a goal."""

    space: GradientSpace
    goal: FloatArray
    precision: FloatArray
    mean: FloatArray
    w: FloatArray

    def __post_init__(self) -> None:
        self.residual = self.space.decode(self.w[None])[0] - self.goal
        away = self.w - self.mean
        self.energy = float((self.residual**2).sum() + away @ self.precision @ away)
        self._normal: tuple[FloatArray, FloatArray] | None = None

    def step(self, damping: float) -> FloatArray:
        if self._normal is None:
            J = self.space.solve(self.space.tangents(self.w)[2]).reshape(len(self.w), -1)
            gradient = J @ self.residual.ravel() + self.precision @ (self.w - self.mean)
            self._normal = J @ J.T + self.precision, gradient
        H, gradient = self._normal
        return damped_step(H, gradient, damping)

    def moved(self, step: FloatArray) -> _Closest:
        return _Closest(self.space, self.goal, self.precision, self.mean, self.w + step)
