"""Shapes whose edge lengths and dihedral angles are a linear combination of components."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import sparse

from deformer.acap import PoissonSystem
from deformer.baselines._connection import Connection
from deformer.baselines._gradient_space import faint_pull, least_inverse
from deformer.baselines._shell import DAMPING, SHORTENINGS, Shell
from deformer.editing import schur_inverse
from deformer.geometry import FloatArray, IntArray, procrustes
from deformer.linalg import damped_step, descend
from deformer.model import LatentPrior

# Energies' relative gain that ends a reconstruction, and its most steps.
_TOLERANCE = 1e-4
_STEPS = 30
# Reconstructions that are kept: encoding needs them for the frames, and decoding comes next.
_KEPT = 64
# Fit to vertices. Its reconstructions go on from each other and take few steps each: taken to the
# end they settle in folds of their own, which no change of the weights leads out of.
_OUTER_STEPS = 12
_INNER_STEPS = 6
_OUTER_TOLERANCE = 1e-3
# Handle fits: examples that are started from, steps from each, and of the best one.
_STARTS = 2
_FIRST_STEPS = 4
_HANDLE_STEPS = 30
_HANDLE_TOLERANCE = 1e-3


class EdgeSpace:
    """Features f(w) = base + Σ_k w_k components_k of a `Shell`, and the shapes that have them.

    Features that belong to no mesh are met as well as a mesh can, in the shell's energy.

    Args:
        shell: the measures.
        poisson: of the same reference.
        base: (E, 2) features where all weights are zero.
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
        self._kept = lru_cache(_KEPT)(self._reconstruct)

    def features(self, w: FloatArray) -> FloatArray:
        """Features (E, 2) of weights (K,)."""
        return self.base + np.tensordot(w, self.components, axes=1)

    def project(self, features: FloatArray) -> FloatArray:
        """Weights (N, K) whose features are closest to features (N, E, 2): least squares."""
        return (features - self.base).reshape(len(features), -1) @ self.flat.T @ self._inverse

    def decode(self, w: FloatArray) -> FloatArray:
        """Shape (V, 3) of weights (K,), laid as close to the reference as it goes."""
        return self._kept(np.asarray(w, dtype=np.float64).tobytes()).copy()

    def _reconstruct(self, weights: bytes) -> FloatArray:
        features = self.features(np.frombuffer(weights))
        p = self.connection.shape(features)
        p = self.shell.closest(features, p, _STEPS, _TOLERANCE)
        return laid_on(p, self.shell.reference.vertices)

    def tangents(self, p: FloatArray) -> FloatArray:
        """Change (K, V, 3) of the decoded shape p with the weights.

        Gauss–Newton's: what is left of the features' misfit is taken as small. No feature's change
        pushes along a rigid motion, so there is none in it.
        """
        J, H = self.shell.normal_matrix(p)
        change = self.shell.factor(H).solve(J.T @ self.flat.T).T
        return change.reshape(len(self.flat), -1, 3)

    def closest(self, target: FloatArray, w: FloatArray, prior: LatentPrior) -> FloatArray:
        """Weights (K,) whose shape is closest to `target` (V, 3) after the best rigid motion.

        Damped Gauss–Newton from weights w through the reconstruction, with a faint pull to the
        prior for components that the shape does not determine.
        """
        pull = faint_pull(prior, self.shell.reference.bounding_diagonal)
        start = _Closest(self, target, pull, prior.mean, w, laid_on(self.decode(w), target))
        return descend(start, steps=_OUTER_STEPS, relative_gain=_OUTER_TOLERANCE).point.w


def laid_on(p: FloatArray, target: FloatArray) -> FloatArray:
    """Points (V, 3) moved rigidly to lie as close as possible to the target (V, 3)."""
    R, t = procrustes(p, target)
    return p @ R.T + t


@dataclass(eq=False)
class _Closest:
    """Weights with their shape p, and its squared distance from the target."""

    space: EdgeSpace
    target: FloatArray
    pull: FloatArray
    mean: FloatArray
    w: FloatArray
    p: FloatArray

    def __post_init__(self) -> None:
        self.residual = self.p - self.target
        away = self.w - self.mean
        self.energy = float((self.residual**2).sum() + away @ self.pull @ away)
        self._normal: tuple[FloatArray, FloatArray, FloatArray] | None = None

    def step(self, damping: float) -> FloatArray:
        _, H, gradient = self._system()
        return damped_step(H, gradient, damping)

    def _system(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        if self._normal is None:
            J = self.space.tangents(self.p).reshape(len(self.w), -1)
            gradient = J @ self.residual.ravel() + self.pull @ (self.w - self.mean)
            self._normal = J, J @ J.T + self.pull, gradient
        return self._normal

    def moved(self, step: FloatArray) -> _Closest:
        w = self.w + step
        guess = self.p + (step @ self._system()[0]).reshape(-1, 3)
        p = self.space.shell.closest(self.space.features(w), guess, _INNER_STEPS, _TOLERANCE)
        return _Closest(self.space, self.target, self.pull, self.mean, w, laid_on(p, self.target))


class EdgeDeformation:
    """Poses a mesh by a few vertices: edge lengths and dihedral angles of the components.

    With h the controlled vertices, minimises over positions p and weights w

        ‖f(p) − f(w)‖² / (σ² E) + (w − μ)ᵀ Σ⁻¹ (w − μ)      where p_h = q_h

    by damped Gauss–Newton on both together; the frame is free. The starts are the training shapes
    that, laid rigidly on the targets, need the least force to meet them.

    Args:
        space: the components.
        prior: of the weights.
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
        # Features' change with the whitened weights.
        self.slopes = self.factor.T @ space.flat

    def fit(self, vertices: IntArray, targets: FloatArray, noise: float) -> FloatArray:
        """The mesh (V, 3) with vertices (H,), all different, at targets (H, 3).

        Args:
            vertices: at least one.
            targets: positions.
            noise: σ, the root mean square misfit of an edge's feature that weighs as much as one
                standard deviation of the prior.
        """
        poisson = self.space.poisson
        green = poisson.green_rows(vertices)
        inverse = schur_inverse(green[:, vertices])
        moved, force = [], []
        for shape in self.examples:
            R, t = procrustes(shape[vertices], targets)
            laid = shape @ R.T + t
            d = targets - laid[vertices]
            pull = inverse[:-1, :-1] @ d
            moved.append(laid + green.T @ pull + inverse[-1, :-1] @ d)
            force.append(float(np.vdot(pull, d)))
        held = np.zeros(self.space.shell.reference.vertices.size, dtype=bool)
        held.reshape(-1, 3)[vertices] = True
        weight = 1.0 / (noise**2 * len(self.space.base))
        found = []
        for n in np.argsort(force, kind="stable")[:_STARTS]:
            p = moved[n]
            p[vertices] = targets
            start = _Fit(self, np.flatnonzero(~held), weight, p, self.white[n])
            found.append(_descended(start, _FIRST_STEPS))
        best = min(found, key=lambda point: point.energy)
        return _descended(best, _HANDLE_STEPS).p


@dataclass(eq=False)
class _Fit:
    """Positions and whitened weights, with the energy of a handle fit."""

    deformation: EdgeDeformation
    free: IntArray
    weight: float
    p: FloatArray
    y: FloatArray

    def __post_init__(self) -> None:
        deformation = self.deformation
        w = deformation.prior.mean + deformation.factor @ self.y
        space = deformation.space
        self.residual = space.shell.difference(self.p, space.features(w)).ravel()
        self.energy = float(self.weight * (self.residual**2).sum() + (self.y**2).sum())
        self._normal: tuple[sparse.csr_array, FloatArray, FloatArray, FloatArray] | None = None

    def step(self, damping: float) -> FloatArray:
        """Changes of the free coordinates, then of y."""
        H, B, right, below = self._system()
        slopes = self.deformation.slopes
        damped = H + sparse.diags_array(damping * H.diagonal())
        # H x + B y = right, Bᵀ x + D y = below: x is eliminated.
        factor = self.deformation.space.shell.factor(damped, self.free)
        solved = factor.solve(np.column_stack([B, right]))
        D = slopes @ slopes.T + np.eye(len(slopes)) / self.weight
        D += damping * np.diag(np.diag(D))
        y = np.linalg.solve(D - B.T @ solved[:, :-1], below - B.T @ solved[:, -1])
        step = np.concatenate([solved[:, -1] - solved[:, :-1] @ y, y])
        return np.asarray(step, dtype=np.float64)

    def _system(self) -> tuple[sparse.csr_array, FloatArray, FloatArray, FloatArray]:
        if self._normal is None:
            slopes = self.deformation.slopes
            J, H = self.deformation.space.shell.normal_matrix(self.p)
            J = sparse.csc_array(J)[:, self.free]
            right = -(J.T @ self.residual)
            below = slopes @ self.residual - self.y / self.weight
            self._normal = H[self.free][:, self.free], -(J.T @ slopes.T), right, below
        return self._normal

    def moved(self, step: FloatArray) -> _Fit:
        p = self.p.copy()
        p.reshape(-1)[self.free] += step[: len(self.free)]
        y = self.y + step[len(self.free) :]
        return _Fit(self.deformation, self.free, self.weight, p, y)


def _descended(start: _Fit, steps: int) -> _Fit:
    """The end of a descent whose steps cost a factorisation each."""
    found = descend(
        start,
        steps=steps,
        relative_gain=_HANDLE_TOLERANCE,
        damping=DAMPING,
        shortenings=SHORTENINGS,
    )
    return found.point
