"""DeformationModel: a trained prior with everything needed to use it, in memory and on disk."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deformer.acap import (
    FeatureExtractor,
    FeatureScaler,
    PoissonSystem,
    extract_all,
    gradient_tangents,
)
from deformer.errors import InputError
from deformer.geometry import FloatArray, Geodesics, IntArray, Mesh, align, one_rings
from deformer.model.bend_limits import BendLimits
from deformer.model.component_names import check_names, find_component
from deformer.model.latent_prior import LatentPrior
from deformer.model.rigid_prior import Placement
from deformer.network import Decoder, Encoder, ModelConfig, NetworkWeights

# Latent components whose tangents are solved at once in `DeformationModel.fit`: bounds memory.
_TANGENT_BATCH = 10


@dataclass(frozen=True, eq=False)
class DeformationModel:
    """A deformation prior learned from example shapes.

    Args:
        reference: the undeformed mesh; all shapes share its connectivity.
        config: what it was trained with.
        scaler: linear feature scaling.
        weights: of the trained network.
        codes: (N, K) latent codes of the training shapes.
        prior: mean and full covariance of the codes.
        split: {"train": indices, "test": indices} into the shapes it was trained from.
        summary: facts about the training, for people (JSON values).
        placement: how the training shapes stand; None if that is not known.
        names: component → name, of those that people have named.
        handle_noise: σ of handle fits (`HandleSolver`), in bounding diagonals.
        limits: how far parts bend against each other in the examples; None if that is not known.
    """

    reference: Mesh
    config: ModelConfig
    scaler: FeatureScaler
    weights: NetworkWeights
    codes: FloatArray
    prior: LatentPrior
    split: dict[str, list[int]]
    summary: dict[str, Any] = field(default_factory=dict)
    placement: Placement | None = None
    names: dict[int, str] = field(default_factory=dict)
    handle_noise: float = 0.007
    limits: BendLimits | None = None

    def __post_init__(self) -> None:
        """Check the names."""
        object.__setattr__(self, "names", check_names(self.names, self.components))

    def named(self, names: Mapping[int, str]) -> DeformationModel:
        """The same model with names for some components; an empty one takes a name away.

        Raises:
            InputError: no such component, a name that is none, or one given twice.
        """
        merged = {**self.names, **names}
        return replace(self, names={k: name for k, name in merged.items() if name.strip()})

    def component(self, key: int | str) -> int:
        """Index of the component with a name, or with an index (a number, or one as text).

        Raises:
            InputError: there is none.
        """
        return find_component(key, self.names, self.components)

    def label(self, component: int) -> str:
        """What people read for a component: its name, or "component 3"."""
        return self.names.get(component, f"component {component}")

    @property
    def components(self) -> int:
        """Dimensions K of the latent code."""
        return self.config.components

    @property
    def latent_mean(self) -> FloatArray:
        """Mean (K,) of the training codes."""
        return self.prior.mean

    @property
    def latent_covariance(self) -> FloatArray:
        """Shrunk covariance (K, K) of the training codes."""
        return self.prior.covariance

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of all that decides a pose: reference, network, scaling and statistics."""
        digest = hashlib.sha256()
        scaler = self.scaler
        bounds = [scaler.r_min, scaler.r_max, scaler.s_min, scaler.s_max]
        arrays = [self.reference.vertices, self.reference.faces, self.codes, np.array(bounds)]
        arrays += [self.prior.mean, self.prior.covariance]
        if self.placement is not None:
            arrays.append(np.array([self.placement.rotation, self.placement.translation]))
            arrays += self.placement.arrays.values()
        if self.limits is not None:
            arrays += self.limits.arrays.values()
        arrays += self.weights.arrays.values()
        for array in arrays:
            digest.update(f"{array.dtype.str} {array.shape}\n".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    @cached_property
    def extractor(self) -> FeatureExtractor:
        """Feature extraction against the reference."""
        return FeatureExtractor(self.reference)

    @cached_property
    def _rings(self) -> tuple[IntArray, IntArray]:
        return one_rings(self.reference.faces, len(self.reference.vertices))

    @cached_property
    def poisson(self) -> PoissonSystem:
        """The factored Poisson system of the reference."""
        return PoissonSystem(self.reference)

    @cached_property
    def geodesics(self) -> Geodesics:
        """Geodesic distances over the reference."""
        return Geodesics(self.reference)

    @cached_property
    def decoder(self) -> Decoder:
        """The decoder as float64 arrays."""
        return Decoder(self.weights, self.scaler, *self._rings)

    @cached_property
    def encoder(self) -> Encoder:
        """The encoder that the configuration names."""
        projection = self.decoder if self.config.projects else None
        return Encoder(self.weights, self.scaler, *self._rings, projection)

    def decoder_at(self, vertices: IntArray) -> Decoder:
        """The decoder restricted to some vertices."""
        return Decoder(self.weights, self.scaler, *self._rings, vertices)

    def encode(self, vertices: ArrayLike) -> FloatArray:
        """Latent codes of shapes: (V, 3) to (K,), or (N, V, 3) to (N, K).

        A model trained on aligned shapes first removes each shape's rigid motion against the
        reference.
        """
        shapes, single = self._checked(vertices)
        if self.config.align:
            shapes = align(shapes, self.reference.vertices)
        codes = self.encoder.encode(extract_all(self.extractor, shapes))
        return codes[0] if single else codes

    def decode(self, z: ArrayLike) -> FloatArray:
        """Shapes of latent codes: (K,) to (V, 3), or (N, K) to (N, V, 3).

        They stand where training shapes of such codes do; without a `placement`, with their
        centroids at the reference's.
        """
        codes = np.asarray(z, dtype=np.float64)
        if codes.ndim not in (1, 2) or codes.shape[-1] != self.components:
            raise InputError(
                f"z: expected ({self.components},) or (N, {self.components}), got {codes.shape}"
            )
        flat = codes.reshape(-1, self.components)
        p = np.stack([self._centred(row) for row in flat])
        p += self.standing(flat)[:, None]
        return p[0] if codes.ndim == 1 else p

    def standing(self, z: FloatArray) -> FloatArray:
        """How far shapes of codes (..., K) stand from the reference: centroids (..., 3)."""
        if self.placement is None:
            return np.zeros((*z.shape[:-1], 3))
        return self.reference.bounding_diagonal * self.placement.at(z)

    def _centred(self, z: FloatArray) -> FloatArray:
        """Shape (V, 3) of a code (K,), its centroid at the reference's."""
        return self.poisson.reconstruct(self.decoder.features(z))

    def fit(self, vertices: ArrayLike, iterations: int = 20) -> FloatArray:
        """Latent codes whose decoded shapes are closest to the given ones.

        Minimises Σ_i ‖p_i(z) − q_i‖² over all vertices, centroids aligned, by damped
        Gauss–Newton from the encoder's code, with a faint pull to the prior for components that
        the shape does not determine.

        Args:
            vertices: (V, 3) or (N, V, 3).
            iterations: at most this many steps a shape.

        Returns:
            (K,) or (N, K).
        """
        shapes, single = self._checked(vertices)
        if self.config.align:
            shapes = align(shapes, self.reference.vertices)
        codes = np.stack(
            [
                self._fit_one(shape, z, iterations)
                for shape, z in zip(shapes, self.encode(shapes), strict=True)
            ]
        )
        return codes[0] if single else codes

    def _fit_one(self, target: FloatArray, z: FloatArray, iterations: int) -> FloatArray:
        goal = target - target.mean(axis=0) + self.poisson.centroid
        precision = np.linalg.inv(self.prior.covariance)
        # One thousandth of the bounding diagonal of residual a vertex weighs as much as one
        # standard deviation of the prior weighs in all.
        pull = (1e-3 * self.reference.bounding_diagonal) ** 2 * precision

        def energy(z: FloatArray) -> tuple[float, FloatArray]:
            residual = self._centred(z) - goal
            away = z - self.prior.mean
            return float((residual**2).sum() + away @ pull @ away), residual

        value, residual = energy(z)
        damping = 1e-4
        for _ in range(iterations):
            J = self.tangents(z)
            H = J @ J.T + pull
            gradient = J @ residual.ravel() + pull @ (z - self.prior.mean)
            while damping < 1e6:
                step = np.linalg.solve(H + damping * np.diag(np.diag(H)), -gradient)
                new_value, new_residual = energy(z + step)
                if new_value < value:
                    break
                damping *= 10.0
            else:
                return z
            gain = (value - new_value) / value
            z, value, residual = z + step, new_value, new_residual
            damping = max(damping / 10.0, 1e-8)
            if gain < 1e-5:
                break
        return z

    def tangents(self, z: FloatArray) -> FloatArray:
        """Derivative (K, 3V) of the decoded positions by the latent code z (K,), centroid fixed."""
        q, dq = self.decoder.differential(z)
        rows = []
        for start in range(0, len(dq), _TANGENT_BATCH):
            dT = gradient_tangents(q, dq[start : start + _TANGENT_BATCH])
            b = np.concatenate([self.poisson.rhs(t) for t in dT], axis=1)
            x = self.poisson.back_substitute(b)
            x -= x.mean(axis=0)
            rows.append(x.reshape(len(x), -1, 3).transpose(1, 0, 2).reshape(len(dT), -1))
        return np.concatenate(rows)

    def _checked(self, vertices: ArrayLike) -> tuple[FloatArray, bool]:
        shapes = np.asarray(vertices, dtype=np.float64)
        single = shapes.ndim == 2
        if single:
            shapes = shapes[None]
        V = len(self.reference.vertices)
        if shapes.ndim != 3 or shapes.shape[1:] != (V, 3):
            raise InputError(
                f"vertices: expected ({V}, 3) or (N, {V}, 3) as the model's reference has, got "
                f"{np.asarray(vertices).shape}"
            )
        if not np.isfinite(shapes).all():
            raise InputError("vertices: not all positions are finite; repair the shape")
        return shapes, single

    def save(self, path: str | Path) -> None:
        """Write the model as a directory; see `save_model`."""
        # Storage stands on this class, so it cannot be imported before it.
        from deformer.model.storage import save_model

        save_model(self, path)
