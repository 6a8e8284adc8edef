"""The training set of a network: prepared example shapes and their scaled features."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformer.acap import FeatureExtractor, FeatureScaler, extract_all
from deformer.checks import LARGEST, checked_array, checked_number
from deformer.errors import InputError
from deformer.geometry import (
    FloatArray,
    Geodesics,
    IntArray,
    Mesh,
    MeshSequence,
    SiteGeodesics,
    align,
    site_rings,
)
from deformer.model import (
    DeformationModel,
    choose_samples,
    fit_bend_limits,
    fit_prior,
    fit_rigid_prior,
)
from deformer.network import Decoder, Encoder, FactorisationSettings, ModelConfig, NetworkWeights
from deformer.training.denoising import remove_noise
from deformer.training.factorisation import factor
from deformer.training.loop import TrainingResult
from deformer.training.mirroring import images_explain, mirror_images


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """Prepared example shapes and their scaled features.

    Args:
        shapes: N training shapes, aligned and denoised if the configuration says so.
        extractor: extracts features against the reference.
        scaler: scales the features.
        x: (N or 2N, V+B, 9) scaled features of the shapes' vertices and links and, if the network
            is trained on them, of their mirror images'.
        noise: standard deviation of the removed noise, in bounding diagonals.
    """

    shapes: MeshSequence
    extractor: FeatureExtractor
    scaler: FeatureScaler
    x: FloatArray
    noise: float

    @classmethod
    def prepare(
        cls,
        shapes: MeshSequence,
        reference: Mesh,
        reference_index: int | None,
        config: ModelConfig,
        on_features: Callable[[int, int], None] | None = None,
    ) -> TrainingSet:
        """Align and denoise shapes, extract their features, and add mirror images.

        Args:
            shapes: N training shapes.
            reference: the undeformed shape.
            reference_index: index of the reference among the shapes; None if it is not one.
            config: says by `align`, `denoised` and `mirrored` which steps are done.
            on_features: called with the numbers of shapes done and of all shapes.
        """
        vertices = shapes.vertices
        if config.align:
            vertices = align(vertices, reference.vertices)
        noise = 0.0
        if config.denoised:
            reference, vertices, noise = _denoised(reference, vertices, reference_index)
        shapes = MeshSequence(vertices, shapes.faces)
        extractor = FeatureExtractor(reference)
        q = extract_all(extractor, vertices, on_features, links=True)
        if config.mirrored:
            q = _with_mirror_images(q, extractor, shapes)
        scaler = FeatureScaler.fit(q)
        return cls(shapes, extractor, scaler, scaler.scale(q), noise / reference.bounding_diagonal)

    @property
    def arrays(self) -> dict[str, NDArray]:
        """All of it but the faces, by name."""
        return {
            "vertices": self.shapes.vertices,
            "reference": self.reference.vertices,
            "scaler": np.array(astuple(self.scaler)),
            "x": self.x,
            "noise": np.array(self.noise),
        }

    @classmethod
    def restore(cls, arrays: Mapping[str, NDArray], faces: IntArray) -> TrainingSet:
        """The set with these `arrays`, of shapes with these faces (F, 3).

        Raises:
            InputError: an array is missing, of another shape, or not finite.
        """
        names = ("vertices", "reference", "scaler", "x", "noise")
        if set(arrays) != set(names):
            differing = sorted(set(arrays) ^ set(names))[0]
            raise InputError(f"{differing}: expected {', '.join(names)}; delete the checkpoint")
        shapes = MeshSequence(arrays["vertices"], faces)
        (N, V), remedy = shapes.vertices.shape[:2], "delete the checkpoint"
        reference = Mesh(checked_array(arrays["reference"], "reference", (V, 3)), faces)
        sites = V + len(reference.links)
        counts = ((N, sites, 9), (2 * N, sites, 9))
        return cls(
            shapes,
            FeatureExtractor(reference),
            FeatureScaler(*checked_array(arrays["scaler"], "scaler", (4,)).tolist()),
            checked_array(arrays["x"], "x", *counts, largest=LARGEST, remedy=remedy),
            checked_number(arrays["noise"], "noise", least=0, remedy=remedy),
        )

    @property
    def reference(self) -> Mesh:
        """The undeformed shape, denoised if the shapes are."""
        return self.extractor.reference

    @property
    def mirrored(self) -> bool:
        """True if the training set includes mirror images."""
        return len(self.x) > len(self.shapes)

    @cached_property
    def geodesics(self) -> Geodesics:
        """Geodesic distances over the reference."""
        return Geodesics(self.reference)

    @cached_property
    def _bend_vertices(self) -> tuple[IntArray, IntArray]:
        return choose_samples(self.geodesics)

    def subset(self, indices: IntArray) -> TrainingSet:
        """The training set of the shapes at `indices` (n,), with the same reference and scaling."""
        rows = np.concatenate([indices, indices + len(self.shapes)])
        x = self.x[rows[rows < len(self.x)]]
        return replace(self, shapes=self.shapes.subset(indices), x=x)

    def train_network(
        self, config: ModelConfig, *, seed: int = 0, device: str = "cpu", **options: Any
    ) -> TrainingResult:
        """Train a network by the configuration's method.

        Args:
            config: configuration, with a sparsity if the method is a factorisation.
            seed: seed of weights and mixed shapes, for Adam.
            device: "cpu", "cuda", "mps" or "auto", for Adam.
            options: `checkpoint`, `resume` and `on_progress`, as in `factor` and `fit`.
        """
        if isinstance(config.training, FactorisationSettings):
            distances = SiteGeodesics(self.geodesics)
            links = len(self.reference.links)
            return factor(self.x, self.scaler, distances, config, links=links, **options)
        # The import of torch takes seconds, and only Adam needs it.
        from deformer.training.adam import fit

        mesh = *site_rings(self.reference), SiteGeodesics(self.geodesics)
        return fit(self.x, *mesh, config, seed=seed, device=device, **options)

    def build_model(
        self,
        weights: NetworkWeights,
        config: ModelConfig,
        split: dict[str, list[int]],
        summary: dict[str, Any],
    ) -> DeformationModel:
        """The model of a trained network, with the statistics of the training shapes.

        Args:
            weights: weights of the network.
            config: configuration of its training.
            split: {"train": indices, "test": indices}, kept in the model.
            summary: facts about the training (JSON values), kept in the model.
        """
        N = len(self.shapes)
        network = weights, self.scaler, *site_rings(self.reference)
        encoder = Encoder(*network, Decoder(*network) if config.projects else None)
        all_codes = encoder.encode(self.scaler.unscale(self.x))
        codes, mirrored_codes = all_codes[:N], all_codes[N:]
        prior = fit_prior(codes, mirrored_codes if self.mirrored else None)
        model = DeformationModel(
            self.reference, config, self.scaler, weights, codes, prior, split, summary
        )
        vertices, pairs = self._bend_vertices
        limits = fit_bend_limits(model.decoder_at(vertices), pairs, prior.mean, all_codes)
        decoded = model.decode(codes)
        diagonal = self.reference.bounding_diagonal
        rigid_prior = fit_rigid_prior(codes, decoded, self.shapes.vertices, diagonal)
        return replace(model, rigid_prior=rigid_prior, bend_limits=limits)


def _denoised(
    reference: Mesh, vertices: FloatArray, reference_index: int | None
) -> tuple[Mesh, FloatArray, float]:
    """Reference and shapes (N, V, 3) without noise, and the noise's standard deviation."""
    shapes = vertices
    if reference_index is None:
        reference_index = len(vertices)
        shapes = np.concatenate([vertices, reference.vertices[None]])
    clean, noise = remove_noise(MeshSequence(shapes, reference.faces))
    if not noise:
        return reference, vertices, noise
    return Mesh(clean[reference_index], reference.faces), clean[: len(vertices)], noise


def _with_mirror_images(
    q: FloatArray, extractor: FeatureExtractor, shapes: MeshSequence
) -> FloatArray:
    """Features (N, V+B, 9), followed by those of the mirror images if the images explain shapes."""
    mirrored = extract_all(extractor, mirror_images(shapes)[0], links=True)
    scaler = FeatureScaler.fit(q)
    if not images_explain(scaler.scale(q), scaler.scale(mirrored)):
        return q
    return np.concatenate([q, mirrored])
