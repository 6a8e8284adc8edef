"""The training set of a network: prepared example shapes and their scaled features."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformer.acap import FeatureExtractor, FeatureScaler
from deformer.checks import LARGEST, checked_array, checked_number
from deformer.errors import InputError
from deformer.geometry import (
    FARTHEST,
    FloatArray,
    Geodesics,
    IntArray,
    Mesh,
    ShapeSequence,
    SiteGeodesics,
    align,
    joined_shapes,
    map_shapes,
    shape_sequence,
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
from deformer.parallel import Executor
from deformer.training.denoising import remove_noise
from deformer.training.factorisation import NetworkFactorisation, factor
from deformer.training.feature_tiles import (
    extract_tiles,
    features,
    fit_scaler,
    new_tiles,
    parts,
    scaled_products,
)
from deformer.training.loop import TrainingResult
from deformer.training.mirroring import find_mirror, images_explain, trial_examples
from deformer.training.site_tiles import SiteTiles
from deformer.workspace import Rows, Workspace, blocks


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """Prepared example shapes and their features.

    Args:
        shapes: N training shapes, aligned and denoised if the configuration says so.
        extractor: extracts features against the reference.
        scaler: scales the features.
        tiles: deviations from the undeformed shape's features, (N or 2N, V+B, 9), of the shapes'
            vertices and links and, if the network is trained on them, of their mirror images'.
        noise: standard deviation of the removed noise, in bounding diagonals.
        workspace: where large arrays are.
    """

    shapes: ShapeSequence
    extractor: FeatureExtractor
    scaler: FeatureScaler
    tiles: SiteTiles
    noise: float
    workspace: Workspace

    @classmethod
    def prepare(
        cls,
        shapes: ShapeSequence,
        reference: Mesh,
        reference_index: int | None,
        config: ModelConfig,
        workspace: Workspace,
        executor: Executor,
        on_features: Callable[[int, int], None] | None = None,
    ) -> TrainingSet:
        """Align and denoise shapes, extract their features, and add mirror images.

        Args:
            shapes: N training shapes.
            reference: the undeformed shape.
            reference_index: index of the reference among the shapes; None if it is not one.
            config: says by `align`, `denoised` and `mirrored` which steps are done.
            workspace: where large arrays are.
            executor: extracts the features.
            on_features: called with the numbers of shapes done and of all shapes, which doubles if
                mirror images are added.
        """
        if config.align:
            shapes = map_shapes(shapes, lambda p: align(p, reference.vertices), workspace)
        noise = 0.0
        if config.denoised:
            reference, shapes, noise = _denoised(reference, shapes, reference_index, workspace)
        extractor = FeatureExtractor(reference)
        N = len(shapes)
        tiles = new_tiles(N, extractor, workspace)
        told = _told(on_features, 0, N)
        extract_tiles(tiles, 0, extractor, shapes.vertices, executor, on_shape=told)
        scaler = fit_scaler(tiles)
        if config.mirrored:
            options = workspace, executor, on_features
            tiles = _with_mirror_images(tiles, extractor, shapes, scaler, *options)
            scaler = fit_scaler(tiles)
        diagonal = reference.bounding_diagonal
        return cls(shapes, extractor, scaler, tiles, noise / diagonal, workspace)

    @property
    def arrays(self) -> dict[str, Rows]:
        """All of it but the faces, by name."""
        return {
            "vertices": self.shapes.vertices,
            "reference": self.reference.vertices,
            "scaler": np.array(astuple(self.scaler)),
            "features": self.tiles.tiles,
            "noise": np.array(self.noise),
        }

    @classmethod
    def restore(
        cls, arrays: Mapping[str, Rows], faces: IntArray, workspace: Workspace
    ) -> TrainingSet:
        """The set with these `arrays`, of shapes with these faces (F, 3).

        Raises:
            InputError: an array is missing, of another shape, or not finite.
        """
        names = ("vertices", "reference", "scaler", "features", "noise")
        if set(arrays) != set(names):
            differing = sorted(set(arrays) ^ set(names))[0]
            raise InputError(f"{differing}: expected {', '.join(names)}; delete the checkpoint")
        vertices, tiles = arrays["vertices"], arrays["features"]
        remedy = "delete the checkpoint"
        _check_rows(vertices, "vertices", ("N", "V", 3), FARTHEST)
        N, V = vertices.shape[:2]
        shapes = shape_sequence(vertices, faces)
        reference = Mesh(checked_array(arrays["reference"], "reference", (V, 3)), faces)
        sites = V + len(reference.links)
        _check_rows(tiles, "features", ("tiles", "N", "numbers"), LARGEST)
        count, rows, width = tiles.shape
        if (
            rows not in (N, 2 * N)
            or width % 9
            or not (count - 1) * width < 9 * sites <= (count * width)
        ):
            raise InputError(
                f"features: expected tiles of {N} or {2 * N} shapes at {sites} sites, got "
                f"{tiles.shape}; {remedy}"
            )
        return cls(
            shapes,
            FeatureExtractor(reference),
            FeatureScaler(*checked_array(arrays["scaler"], "scaler", (4,)).tolist()),
            SiteTiles((rows, sites, 9), np.float32, workspace, width=width // 9, tiles=tiles),
            checked_number(arrays["noise"], "noise", least=0, remedy=remedy),
            workspace,
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arrays and the faces: another process prepares what they are used with."""
        arrays = {name: np.asarray(rows[...]) for name, rows in self.arrays.items()}
        return _restored, (arrays, self.reference.faces)

    @property
    def x(self) -> FloatArray:
        """Scaled features (N or 2N, V+B, 9), all in memory."""
        return self.scaler.scale(features(self.tiles.read(slice(None))))

    @property
    def reference(self) -> Mesh:
        """The undeformed shape, denoised if the shapes are."""
        return self.extractor.reference

    @property
    def mirrored(self) -> bool:
        """True if the training set includes mirror images."""
        return self.tiles.shape[0] > len(self.shapes)

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
        tiles = self.tiles.subset(rows[rows < self.tiles.shape[0]])
        found = replace(self, shapes=self.shapes.subset(indices), tiles=tiles)
        # They depend on the reference alone.
        found.__dict__["geodesics"] = self.geodesics
        found.__dict__["_bend_vertices"] = self._bend_vertices
        return found

    def train_network(
        self,
        config: ModelConfig,
        *,
        seed: int = 0,
        device: str = "cpu",
        executor: Executor | None = None,
        **options: Any,
    ) -> TrainingResult:
        """Train a network by the configuration's method.

        Args:
            config: configuration, with a sparsity if the method is a factorisation.
            seed: seed of weights and mixed shapes, for Adam.
            device: "cpu", "cuda", "mps" or "auto", for Adam.
            executor: shares the rounds of a factorisation (`factor`); None is this process.
            options: `checkpoint`, `resume` and `on_progress`, as in `factor` and `fit`.
        """
        if isinstance(config.training, FactorisationSettings):
            distances = SiteGeodesics(self.geodesics)
            links = len(self.reference.links)
            return factor(
                self.tiles,
                self.scaler,
                distances,
                config,
                links=links,
                executor=executor,
                **options,
            )
        # The import of torch takes seconds, and only Adam needs it.
        from deformer.training.adam import fit

        mesh = *site_rings(self.reference), SiteGeodesics(self.geodesics)
        return fit(self.x, *mesh, config, seed=seed, device=device, **options)

    def train_trial(self, config: ModelConfig) -> Generator[None, None, DeformationModel]:
        """A model by factorisation, without checkpoints; yields after each round.

        Args:
            config: configuration, with a sparsity.
        """
        distances, links = SiteGeodesics(self.geodesics), len(self.reference.links)
        training = NetworkFactorisation(self.tiles, self.scaler, distances, config, links)
        training.start()
        for epoch in range(config.training.epochs):
            training.step(epoch)
            yield None
        return self.build_model(training.finished()[0], config, {}, {})

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
        all_codes = np.concatenate(
            [
                encoder.encode(features(self.tiles.read(part)))
                for part in parts(self.tiles, 0, self.tiles.shape[0])
            ]
        )
        del encoder
        codes, mirrored_codes = all_codes[:N], all_codes[N:]
        prior = fit_prior(codes, mirrored_codes if self.mirrored else None)
        model = DeformationModel(
            self.reference, config, self.scaler, weights, codes, prior, split, summary
        )
        vertices, pairs = self._bend_vertices
        limits = fit_bend_limits(model.decoder_at(vertices), pairs, prior.mean, all_codes)
        decoded = (model.decode(code) for code in codes)
        diagonal = self.reference.bounding_diagonal
        rigid_prior = fit_rigid_prior(codes, decoded, self.shapes.vertices, diagonal)
        return replace(model, rigid_prior=rigid_prior, bend_limits=limits)


def _restored(arrays: dict[str, NDArray], faces: IntArray) -> TrainingSet:
    return TrainingSet.restore(arrays, faces, Workspace())


def _denoised(
    reference: Mesh, shapes: ShapeSequence, reference_index: int | None, workspace: Workspace
) -> tuple[Mesh, ShapeSequence, float]:
    """Reference and shapes without noise, and the noise's standard deviation."""
    N, every = len(shapes), shapes
    if reference_index is None:
        reference_index = N
        last = reference.vertices[None]
        rows = joined_shapes(last[:0], shapes, last, workspace.doubles)
        every = shape_sequence(rows, shapes.faces)
    clean, noise = remove_noise(every, workspace)
    if not noise:
        return reference, shapes, noise
    reference = clean.mesh(reference_index)
    return reference, clean if len(clean) == N else clean.subset(np.arange(N)), noise


def _with_mirror_images(
    tiles: SiteTiles,
    extractor: FeatureExtractor,
    shapes: ShapeSequence,
    scaler: FeatureScaler,
    workspace: Workspace,
    executor: Executor,
    on_features: Callable[[int, int], None] | None,
) -> SiteTiles:
    """Features of the shapes, followed by those of the mirror images if these explain shapes."""
    N, mirror = len(shapes), find_mirror(shapes)[0]
    tried = np.array(trial_examples(N))
    trial = new_tiles(2 * len(tried), extractor, workspace)
    for row, n in enumerate(tried.tolist()):
        trial.write(row, tiles.read(slice(n, n + 1)))
    # Most sets are tried as a whole: their images are then those of all shapes.
    told = _told(on_features, N, 2 * N) if len(tried) == N else None
    extract_tiles(trial, len(tried), extractor, shapes.vertices[tried], executor, mirror, told)
    if not images_explain(scaled_products(trial, scaler)):
        return tiles
    if len(tried) == N:
        return trial
    both = new_tiles(2 * N, extractor, workspace)
    for part in parts(tiles, 0, N):
        both.write(part.start, tiles.read(part))
    told = _told(on_features, N, 2 * N)
    extract_tiles(both, N, extractor, shapes.vertices, executor, mirror, told)
    return both


def _told(
    on_features: Callable[[int, int], None] | None, before: int, total: int
) -> Callable[[int], None]:
    """What counts shapes after `before` others."""
    return lambda done: None if on_features is None else on_features(before + done, total)


def _check_rows(rows: Rows, name: str, shape: tuple[int | str, ...], largest: float) -> None:
    """Check an array of a checkpoint, part by part."""
    if rows.ndim != len(shape) or 0 in rows.shape:
        raise InputError(f"{name}: expected {shape}, got {rows.shape}; delete the checkpoint")
    for part in blocks(rows):
        checked_array(
            rows[part], name, ("n", *shape[1:]), largest=largest, remedy="delete the checkpoint"
        )
