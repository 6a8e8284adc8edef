"""DeformationModel: a trained prior with everything needed to use it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from deformer.acap import FeatureScaler
from deformer.checks import (
    LARGEST,
    check_memory,
    checked_array,
    checked_instance,
    checked_integer,
    checked_number,
    shortened,
)
from deformer.documents import Document, checked_document
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, Mesh, Seams, no_seams, site_rings
from deformer.model.bend_limits import BendLimits
from deformer.model.component_names import check_names, find_component
from deformer.model.latent_prior import LatentPrior
from deformer.model.rigid_prior import RigidPrior, shrunk_deviation
from deformer.network import ModelConfig, NetworkWeights

if TYPE_CHECKING:
    from deformer.acap import FeatureExtractor, PoissonSystem
    from deformer.geometry import Geodesics
    from deformer.network import Decoder, Encoder

# Modules that need numba, whose import takes as long as all others together, are imported by the
# properties that use them: `deformer info` computes nothing and never loads it.

# Examples that `DeformationModel.travel` decodes, evenly spread.
_TRAVELLERS = 24
# Numbers of handles that `DeformationModel.handle_misfits` are for.
HANDLE_COUNTS = (5, 40)


@dataclass(frozen=True, eq=False, repr=False)
class DeformationModel:
    """A deformation prior learned from example shapes.

    Args:
        reference: the undeformed mesh of V vertices; all shapes share its connectivity.
        config: configuration of the training.
        scaler: linear scaling of features.
        weights: weights of the trained network.
        codes: (N, K) latent codes of the training shapes.
        prior: mean and full covariance of the codes.
        split: {"train": indices, "test": indices} into the shapes it was trained from.
        summary: facts about the training, for people (JSON values).
        rigid_prior: centroids and rigid motions of training shapes, given their codes; None if
            unknown.
        component_names: component → name, for the components that have one.
        handle_noise: σ of handle fits (`HandleSolver`), in bounding diagonals.
        bend_limits: range of the bends between neighbouring parts in the training shapes; None if
            unknown.
        handle_misfits: τ of handle fits, the model's own error at a handle, in bounding diagonals,
            with few handles and with many (`misfit_of`); 0 for a model that has learned enough to
            be trusted with every target.
        seams: vertices of the reference that coincide in all shapes: they are one to `closed`,
            the model of the surface without seams, in which everything is computed. Shapes that
            are given and returned have all of them, in the reference's order. None is none.
        document: the file that shapes are written like; None for positions and triangles alone.

    Raises:
        InputError: parts that do not fit each other, or names that `check_names` rejects.
    """

    reference: Mesh
    config: ModelConfig
    scaler: FeatureScaler
    weights: NetworkWeights
    codes: FloatArray
    prior: LatentPrior
    split: dict[str, list[int]]
    summary: dict[str, Any] = field(default_factory=dict)
    rigid_prior: RigidPrior | None = None
    component_names: dict[int, str] = field(default_factory=dict)
    handle_noise: float = 0.007
    bend_limits: BendLimits | None = None
    handle_misfits: tuple[float, float] = (0.0, 0.0)
    seams: Seams = field(default=None)  # type: ignore[assignment]
    document: Document | None = None

    def __post_init__(self) -> None:
        """Check that the parts fit each other, and the names."""
        for name, kind in (
            ("reference", Mesh),
            ("config", ModelConfig),
            ("scaler", FeatureScaler),
            ("weights", NetworkWeights),
            ("prior", LatentPrior),
        ):
            checked_instance(getattr(self, name), name, kind, remedy="make one")
        V = len(self.reference.vertices)
        if self.seams is None:
            object.__setattr__(self, "seams", no_seams(V))
        checked_instance(self.seams, "seams", Seams, remedy="leave it out")
        if len(self.seams.closed) != V:
            raise InputError(f"seams: expected {V} vertices, got {len(self.seams.closed)}; retrain")
        if (document := checked_document(self.document, "document")) is not None:
            document.check_fits(V, self.reference.faces)
        K = self.components
        surface = self.closed.reference
        sites = len(surface.vertices) + len(surface.links)
        if self.weights.layers != self.config.layers:
            raise InputError(
                f"network: expected layers {self.config.layers} as in the config, got "
                f"{self.weights.layers}; retrain"
            )
        for name, array, shape in (
            ("network.C", self.weights.C, (sites, self.config.layers[-1], K)),
            ("latent_mean", self.prior.mean, (K,)),
            ("rigid_prior_gain", self.rigid_prior and self.rigid_prior.gain, (3, K)),
            (
                "bend_limits_directions",
                self.bend_limits and self.bend_limits.directions,
                (len(self.bend_limits.directions) if self.bend_limits else 0, K),
            ),
        ):
            if array is not None and array.shape != shape:
                raise InputError(f"{name}: expected {shape}, got {array.shape}; retrain")
        if not len(checked_array(self.codes, "codes", ("N", K), largest=LARGEST)):
            raise InputError("codes: expected those of at least one training shape; retrain")
        checked_number(self.handle_noise, "handle_noise", above=0, most=LARGEST)
        misfits = checked_array(self.handle_misfits, "handle_misfits", (2,), largest=LARGEST)
        for number in misfits.tolist():
            checked_number(number, "handle_misfits", least=0)
        object.__setattr__(self, "handle_misfits", tuple(misfits.tolist()))
        checked = check_names(self.component_names, self.components)
        object.__setattr__(self, "component_names", checked)

    def misfit_of(self, handles: int) -> float:
        """τ of fits to so many handles, in bounding diagonals.

        It is that of few handles up to 5, that of many from 40 on, and between them their geometric
        mean, weighed by the logarithm of the number: 0 if one of them is.
        """
        few, many = self.handle_misfits
        share = float(np.interp(np.log(max(handles, 1)), np.log(HANDLE_COUNTS), (0.0, 1.0)))
        return few ** (1.0 - share) * many**share

    def __repr__(self) -> str:
        """One line: how many vertices, components and training shapes."""
        return (
            f"DeformationModel({len(self.reference.vertices)} vertices, {self.components} "
            f"components, {len(self.codes)} training shapes)"
        )

    def with_component_names(self, names: Mapping[int, str]) -> DeformationModel:
        """A copy with names for some components; the others keep theirs.

        The copy shares everything that this model has computed, which depends on no name.

        Args:
            names: component → name; an empty name removes the component's.

        Raises:
            InputError: names that `check_names` rejects.
        """
        if not isinstance(names, Mapping):
            raise InputError(f"names: expected component → name, got {shortened(names)}")
        merged = {**self.component_names, **names}
        kept = {k: name for k, name in merged.items() if not isinstance(name, str) or name.strip()}
        named = copy(self)
        checked = check_names(kept, self.components)
        object.__setattr__(named, "component_names", checked)
        if named.__dict__.get("closed") is self:
            del named.__dict__["closed"]  # without seams it is the model itself
        return named

    def component(self, key: int | str) -> int:
        """Index of the component with a name or an index.

        Args:
            key: a name, or an index as a number or as text.

        Raises:
            InputError: no component has that name or index.
        """
        return find_component(key, self.component_names, self.components)

    def label(self, component: int) -> str:
        """Display name of a component: its name, or "component 3"."""
        k = self.component(component)
        return self.component_names.get(k, f"component {k}")

    @cached_property
    def closed(self) -> DeformationModel:
        """The model of the surface without seams; the model itself if it has none."""
        if not self.seams:
            return self
        surface = self.seams.close_mesh(self.reference)
        return replace(self, reference=surface, seams=None, document=None)

    @property
    def up(self) -> str:
        """Axis that points up in files that say so, "y" or "z": that of the training if it is z."""
        return "z" if self.summary.get("up") == "z" else "y"

    @cached_property
    def travel(self) -> float:
        """How far the surface as a whole travels in the examples, in bounding diagonals.

        It is the median over the vertices of their RMS distance from where they are on average: of
        a face with a still neck, next to nothing, however far its jaw goes.
        """
        if self.seams:
            return self.closed.travel
        chosen = self.codes[:: max(len(self.codes) // _TRAVELLERS, 1)]
        shapes = [self.decode(code) for code in chosen]
        mean = sum(shapes, np.zeros_like(shapes[0])) / len(shapes)
        squares = sum((np.square(p - mean).sum(axis=1) for p in shapes), np.zeros(len(mean)))
        variance = float(np.median(squares)) / len(shapes) / self.reference.bounding_diagonal**2
        others = len(self.codes) - 1
        return shrunk_deviation(others * variance, others)

    @property
    def components(self) -> int:
        """Dimension K of the latent code."""
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
        """SHA-256 of all that poses depend on: reference, network, scaling and statistics."""
        digest = hashlib.sha256()
        scaler = self.scaler
        bounds = [scaler.r_min, scaler.r_max, scaler.s_min, scaler.s_max]
        arrays = [self.reference.vertices, self.reference.faces, self.codes, np.array(bounds)]
        if self.seams:
            arrays.append(self.seams.closed)
        arrays += [self.prior.mean, self.prior.covariance]
        if self.rigid_prior is not None:
            arrays.append(np.array([self.rigid_prior.rotation, self.rigid_prior.translation]))
            arrays += self.rigid_prior.arrays.values()
        if self.bend_limits is not None:
            arrays += self.bend_limits.arrays.values()
        arrays += self.weights.arrays.values()
        for array in arrays:
            digest.update(f"{array.dtype.str} {array.shape}\n".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    @cached_property
    def extractor(self) -> FeatureExtractor:
        """Feature extraction against the reference, its seams closed."""
        from deformer.acap import FeatureExtractor

        return self.closed.extractor if self.seams else FeatureExtractor(self.reference)

    @cached_property
    def poisson(self) -> PoissonSystem:
        """The factored Poisson system of the reference, its seams closed."""
        from deformer.acap import PoissonSystem

        return self.closed.poisson if self.seams else PoissonSystem(self.reference)

    @cached_property
    def geodesics(self) -> Geodesics:
        """Geodesic distances over the reference, its seams closed."""
        from deformer.geometry import Geodesics

        return self.closed.geodesics if self.seams else Geodesics(self.reference)

    def distances(self, vertex: int) -> FloatArray:
        """Geodesic distances (V,) from a vertex of the reference, in its units.

        Raises:
            InputError: no such vertex.
        """
        closed = self.seams.closed
        index = checked_integer(vertex, "vertex", least=0, most=len(closed) - 1)
        return self.geodesics.row(int(closed[index]))[closed]

    @cached_property
    def _rings(self) -> tuple[IntArray, IntArray]:
        return site_rings(self.closed.reference)

    @cached_property
    def decoder(self) -> Decoder:
        """The decoder of all sites: the vertices, then the B links of the closed reference."""
        return self._decoder(None)

    def decoder_at(self, sites: IntArray) -> Decoder:
        """The decoder restricted to some sites (n,)."""
        return self._decoder(sites)

    def _decoder(self, sites: IntArray | None) -> Decoder:
        from deformer.network import Decoder

        return Decoder(self.weights, self.scaler, *self._rings, sites)

    @cached_property
    def encoder(self) -> Encoder:
        """The encoder by projection or by the network, as the configuration says."""
        from deformer.network import Encoder

        projection = self.decoder if self.config.projects else None
        return Encoder(self.weights, self.scaler, *self._rings, projection)

    def encode(self, vertices: ArrayLike) -> FloatArray:
        """Latent codes of shapes.

        A model trained on aligned shapes first removes each shape's rigid motion against the
        reference.

        Args:
            vertices: (V, 3) or (N, V, 3), in the reference's units.

        Returns:
            (K,) or (N, K).

        Raises:
            InputError: another shape of the array, or a position that is not finite.
        """
        from deformer.model.whole_shapes import (
            encode_shapes,  # not to read a model: it imports numba
        )

        return encode_shapes(self.closed, self._closed_shapes(vertices))

    def fit(self, vertices: ArrayLike, iterations: int = 20) -> FloatArray:
        """Latent codes whose decoded shapes are closest to the given ones.

        Minimises Σ_i ‖p_i(z) − q_i‖² over all vertices, centroids aligned, by damped
        Gauss–Newton from the encoder's code. The prior has a small weight, for components that the
        shape does not determine.

        Args:
            vertices: (V, 3) or (N, V, 3), in the reference's units.
            iterations: most steps a shape.

        Returns:
            (K,) or (N, K).

        Raises:
            InputError: as `encode`.
        """
        from deformer.model.whole_shapes import fit_shapes  # not to read a model: it imports numba

        return fit_shapes(self.closed, self._closed_shapes(vertices), iterations)

    def decode(self, z: ArrayLike) -> FloatArray:
        """Shapes of latent codes.

        Their centroids are those that the `rigid_prior` predicts from the codes; without one, the
        reference's.

        Args:
            z: (K,) or (N, K).

        Returns:
            (V, 3) or (N, V, 3), in the reference's units.

        Raises:
            InputError: another shape of the array.
        """
        if self.seams:
            return self.seams.open(self.closed.decode(z))
        K, V = self.components, len(self.reference.vertices)
        codes = checked_array(z, "z", (K,), ("N", K), largest=LARGEST)
        flat = codes.reshape(-1, K)
        check_memory(2 * 24 * V * len(flat), f"z: {len(flat)} codes of {V} vertices")
        if not len(flat):
            return np.empty((0, V, 3))
        p = np.stack([self.decode_centred(row) for row in flat])
        p += self.centroid_offset(flat)[:, None]
        return p[0] if codes.ndim == 1 else p

    def decode_centred(self, z: FloatArray) -> FloatArray:
        """Shape (V, 3) of a code z (K,), its centroid at the reference's; seams are closed."""
        return self.poisson.reconstruct(self.decoder.features(z))

    def tangents(self, z: FloatArray) -> FloatArray:
        """Derivative (K, 3V) of `decode_centred` by the latent code z (K,); seams are closed."""
        from deformer.model.whole_shapes import tangents  # not to read a model: it imports numba

        return tangents(self.closed, z)

    def _closed_shapes(self, vertices: ArrayLike) -> ArrayLike:
        """Shapes (..., U, 3) without seams, from shapes (..., V, 3), which are checked."""
        if not self.seams:
            return vertices
        V = len(self.reference.vertices)
        return self.seams.close(checked_array(vertices, "vertices", (V, 3), ("N", V, 3)))

    def centroid_offset(self, z: FloatArray) -> FloatArray:
        """Offsets (..., 3) of decoded centroids from the reference's, for codes z (..., K)."""
        if self.rigid_prior is None:
            return np.zeros((*z.shape[:-1], 3))
        return self.reference.bounding_diagonal * self.rigid_prior.centroid(z)

    def save(self, path: str | Path) -> None:
        """Write the model as the directory `path`; see `save_model`."""
        # `storage` imports this module; an import of it at the top would be a cycle.
        from deformer.model.storage import save_model

        save_model(self, path)
