"""Latent codes of shapes whose vertices are all given: encoding and fitting."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from deformer.acap import extract_all, gradient_tangents
from deformer.checks import checked_array, checked_integer
from deformer.errors import InputError
from deformer.geometry import FARTHEST, FloatArray, align
from deformer.linalg import Damping, damped_step, descend

if TYPE_CHECKING:
    from deformer.model.model import DeformationModel

# Latent components whose tangents are solved for at once: bounds memory.
_TANGENT_BATCH = 10
# The descent of `fit_shapes`: its damping, and the relative gain of a step below which it ends.
_DAMPING = Damping(initial=1e-4, up=10.0, down=10.0, floor=1e-8, ceiling=1e6)
_GAIN = 1e-5


def encode_shapes(model: DeformationModel, vertices: ArrayLike) -> FloatArray:
    """Codes of `vertices` by the encoder of `model`; see `DeformationModel.encode`."""
    shapes, single = _prepared(model, vertices)
    codes = _encode(model, shapes)
    return codes[0] if single else codes


def fit_shapes(model: DeformationModel, vertices: ArrayLike, iterations: int) -> FloatArray:
    """Codes of `model` that fit `vertices` in at most `iterations`; see `DeformationModel.fit`."""
    checked_integer(iterations, "iterations", least=0)
    shapes, single = _prepared(model, vertices)
    codes = np.stack(
        [
            _fit_shape(model, shape, z, iterations)
            for shape, z in zip(shapes, _encode(model, shapes), strict=True)
        ]
    )
    return codes[0] if single else codes


def _encode(model: DeformationModel, shapes: FloatArray) -> FloatArray:
    """Codes (N, K) of prepared shapes (N, V, 3) by the encoder of `model`."""
    return model.encoder.encode(extract_all(model.extractor, shapes, links=True))


def _fit_shape(
    model: DeformationModel, target: FloatArray, z: FloatArray, iterations: int
) -> FloatArray:
    """Code (K,) of the shape `target` (V, 3), by a descent from the code z (K,)."""
    centred = target - target.mean(axis=0) + model.poisson.centroid
    precision: FloatArray = np.asarray(np.linalg.inv(model.prior.covariance), dtype=np.float64)
    # A residual of a thousandth of the bounding diagonal at one vertex costs as much as one
    # standard deviation of the code.
    weight = (1e-3 * model.reference.bounding_diagonal) ** 2 * precision
    descent = descend(
        _Point(model, centred, weight, z),
        steps=iterations,
        relative_gain=_GAIN,
        damping=_DAMPING,
    )
    return descent.point.z


class _Point:
    """A code z (K,), with the energy ‖p(z) − target‖² + (z − μ)ᵀ weight (z − μ)."""

    def __init__(
        self, model: DeformationModel, target: FloatArray, weight: FloatArray, z: FloatArray
    ) -> None:
        """Evaluate the energy."""
        self._model, self._target, self._weight, self.z = model, target, weight, z
        self._residual = model.decode_centred(z) - target
        self._deviation = z - model.prior.mean
        prior_energy = self._deviation @ weight @ self._deviation
        self.energy = float((self._residual**2).sum() + prior_energy)
        self._equations: tuple[FloatArray, FloatArray] | None = None

    def step(self, damping: float) -> FloatArray:
        """Damped Gauss–Newton step (K,)."""
        if self._equations is None:
            J = tangents(self._model, self.z)
            gradient = J @ self._residual.ravel() + self._weight @ self._deviation
            self._equations = J @ J.T + self._weight, gradient
        return damped_step(*self._equations, damping)

    def moved(self, step: FloatArray) -> _Point:
        """The code that a step leads to."""
        return _Point(self._model, self._target, self._weight, self.z + step)


def tangents(model: DeformationModel, z: FloatArray) -> FloatArray:
    """Derivative (K, 3V) of positions decoded by `model` by the code z (K,), centroid fixed."""
    q, dq = model.decoder.differential(z)
    rows = []
    for start in range(0, len(dq), _TANGENT_BATCH):
        dT = gradient_tangents(q, dq[start : start + _TANGENT_BATCH])
        b = np.concatenate([model.poisson.rhs(t) for t in dT], axis=1)
        x = model.poisson.back_substitute(b)
        x -= x.mean(axis=0)
        rows.append(x.reshape(len(x), -1, 3).transpose(1, 0, 2).reshape(len(dT), -1))
    return np.concatenate(rows)


def _prepared(model: DeformationModel, vertices: ArrayLike) -> tuple[FloatArray, bool]:
    """Shapes (N, V, 3), checked and aligned as `model` wants them; True if only one was given."""
    shapes = checked_array(vertices, "vertices", finite=False)
    single = shapes.ndim == 2
    if single:
        shapes = shapes[None]
    V = len(model.reference.vertices)
    if shapes.ndim != 3 or shapes.shape[1:] != (V, 3):
        raise InputError(
            f"vertices: expected ({V}, 3) or (N, {V}, 3) as the model's reference has, got "
            f"{np.asarray(vertices).shape}"
        )
    if not len(shapes):
        raise InputError("vertices: expected at least one shape, got none; give one")
    if not (np.abs(shapes) <= FARTHEST).all():
        raise InputError(
            f"vertices: not all positions are finite and within ±{FARTHEST:g}; repair the shape"
        )
    if model.config.align:
        shapes = align(shapes, model.reference.vertices)
    return shapes, single
