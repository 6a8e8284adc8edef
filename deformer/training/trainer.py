"""From example shapes to a model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from deformer.acap import FeatureExtractor, FeatureScaler, extract_all
from deformer.editing import HandleSolver
from deformer.errors import InputError
from deformer.geometry import FloatArray, Geodesics, IntArray, Mesh, MeshSequence, align, e_rms
from deformer.linalg import resolve_device
from deformer.model import (
    DeformationModel,
    choose_marks,
    fit_limits,
    fit_placement,
    fit_prior,
)
from deformer.network import (
    Decoder,
    Encoder,
    FactorisationSettings,
    ModelConfig,
    NetworkWeights,
    resolve_config,
)
from deformer.training.adam import fit
from deformer.training.checkpoints import has_checkpoint
from deformer.training.cross_validation import HandleFit, recoveries, recovery_errors
from deformer.training.denoising import remove_noise
from deformer.training.factorisation import factor
from deformer.training.loop import ProgressCallback, TrainingProgress, TrainingResult
from deformer.training.mirroring import images_explain, mirror_images

# What the noise of handle fits, in bounding diagonals, and λ₁ are chosen from; epochs of a
# training that only serves to choose; and how much better a smaller λ₁ must recover shapes, since
# it makes components less sparse and three shapes do not tell less apart. Smaller noises recover
# more from many handles, but lead to a wrong pose now and then where there are fewer than those
# tried here.
_NOISES = (0.0005, 0.001, 0.002, 0.004, 0.008)
_SPARSITIES = (2.0, 0.2, 0.02)
_TRIAL = 15
_WORTH = 0.15


def train(
    shapes: MeshSequence,
    components: int | None = None,
    *,
    config: str | ModelConfig = "default",
    epochs: int | None = None,
    align_shapes: bool | None = None,
    split: dict[str, list[int]] | None = None,
    reference: int | None = None,
    seed: int = 0,
    device: str = "auto",
    up: str = "y",
    checkpoint: str | Path | None = None,
    resume: bool = False,
    on_progress: ProgressCallback | None = None,
) -> DeformationModel:
    """Learn a deformation prior from example shapes.

    Args:
        shapes: N shapes with one connectivity.
        components: K, dimensions of the latent code; None keeps the config's.
        config: "default", "paper" or a ModelConfig.
        epochs: training steps; None keeps the config's.
        align_shapes: remove each shape's rigid motion first; None keeps the config's.
        split: {"train": [...], "test": [...]}; only "train" is looked at. None trains on all.
        reference: index of the undeformed shape; None is shape 0, or the first training shape
            where 0 is not one of them.
        seed: of weights and mixed shapes.
        device: "cpu", "cuda", "mps" or "auto".
        up: axis of the shapes that points up, "x" to "z" or "-x" to "-z"; kept for pictures.
        checkpoint: folder for checkpoints, or None.
        resume: continue from `checkpoint`.
        on_progress: called during feature extraction and after every epoch.

    Returns:
        The model. After KeyboardInterrupt it is the best so far, and summary["interrupted"] is
        True; before the training has begun, while features are extracted and settings are
        chosen, it is raised.

    Raises:
        InputError: too few shapes, a bad split, config, device or checkpoint.
    """
    settings = resolve_config(config, components=components, epochs=epochs, align=align_shapes)
    resolve_device(device)
    if up.removeprefix("-") not in ("x", "y", "z"):
        raise InputError(f"up: expected x, y, z, -x, -y or -z, got {up!r}")
    if resume and (checkpoint is None or not has_checkpoint(checkpoint)):
        raise InputError(f"{checkpoint}: no checkpoint to resume; start without resuming")
    split = {"train": list(range(len(shapes))), "test": [], **(split or {})}
    if len(split["train"]) < 2:
        raise InputError(
            f"train needs at least 2 training shapes, got {len(split['train'])}; add examples"
        )
    if reference is None:
        reference = 0 if 0 in split["train"] else split["train"][0]
    base = shapes.mesh(reference)
    held_out = shapes.subset(split["test"]).vertices if split["test"] else None
    chosen = shapes.subset(split["train"]).vertices
    if settings.align:
        chosen = align(chosen, base.vertices)
    noise = 0.0
    if settings.denoised:
        own = split["train"].index(reference) if reference in split["train"] else None
        base, chosen, noise = _without_noise(base, chosen, own)
    extractor = FeatureExtractor(base)

    def on_features(done: int, total: int) -> None:
        if on_progress is not None:
            on_progress(TrainingProgress("features", done, total))

    q = extract_all(extractor, chosen, on_features)
    if settings.mirrored:
        q = _with_images(q, extractor, MeshSequence(chosen, shapes.faces))
    scaler = FeatureScaler.fit(q)
    examples = _Examples(MeshSequence(chosen, base.faces), extractor, scaler, scaler.scale(q))
    del q
    calibrated = isinstance(settings.training, FactorisationSettings)
    if calibrated:
        settings, handle_noise = _calibrated(examples, settings, on_progress)
    result = examples.learn(
        settings,
        seed=seed,
        device=device,
        checkpoint=Path(checkpoint) if checkpoint is not None else None,
        resume=resume,
        on_progress=on_progress,
    )
    summary = {
        "shapes": len(shapes),
        "train": len(split["train"]),
        "test": len(split["test"]),
        "reference": reference,
        "noise": noise / base.bounding_diagonal,
        "mirrored": len(examples.x) > len(chosen),
        "up": up,
        "seed": seed,
        "epochs": result.epochs,
        "interrupted": result.interrupted,
        "seconds": round(result.seconds, 1),
        "loss": result.loss if np.isfinite(result.loss) else None,
        "reconstruction_loss": (
            result.reconstruction if np.isfinite(result.reconstruction) else None
        ),
    }
    model = examples.model(result.weights, settings, split, summary)
    summary["train_e_rms"] = e_rms(chosen, model.decode(model.codes))
    if held_out is not None:
        if settings.align:
            held_out = align(held_out, base.vertices)
        summary["test_e_rms"] = e_rms(held_out, model.decode(model.encode(held_out)))
    return replace(model, handle_noise=handle_noise) if calibrated else model


@dataclass(frozen=True, eq=False)
class _Examples:
    """What is learned from.

    Args:
        shapes: N training shapes.
        extractor: against their reference.
        scaler: of their features.
        x: (N or 2N, V, 9) scaled features of the shapes and, it may be, of their mirror images.
    """

    shapes: MeshSequence
    extractor: FeatureExtractor
    scaler: FeatureScaler
    x: FloatArray

    @cached_property
    def geodesics(self) -> Geodesics:
        return Geodesics(self.extractor.reference)

    @cached_property
    def marks(self) -> tuple[IntArray, IntArray]:
        return choose_marks(self.geodesics)

    def some(self, kept: IntArray) -> _Examples:
        """Of the shapes with these numbers only, scaled alike."""
        rows = np.concatenate([kept, kept + len(self.shapes)])
        return replace(self, shapes=self.shapes.subset(kept), x=self.x[rows[rows < len(self.x)]])

    def learn(
        self, settings: ModelConfig, *, seed: int = 0, device: str = "cpu", **carried: Any
    ) -> TrainingResult:
        """The weights of a network; see `factor` and `fit`."""
        if isinstance(settings.training, FactorisationSettings):
            return factor(self.x, self.scaler, self.geodesics, settings, **carried)
        mesh = self.extractor.indptr, self.extractor.rings, self.geodesics
        return fit(self.x, *mesh, settings, seed=seed, device=device, **carried)

    def model(
        self,
        weights: NetworkWeights,
        settings: ModelConfig,
        split: dict[str, list[int]],
        summary: dict[str, Any],
    ) -> DeformationModel:
        """The model of a network, with the statistics of these shapes."""
        base, chosen = self.extractor.reference, self.shapes.vertices
        network = weights, self.scaler, self.extractor.indptr, self.extractor.rings
        encoder = Encoder(*network, Decoder(*network) if settings.projects else None)
        codes = encoder.encode(self.scaler.unscale(self.x))
        every, codes, images = codes, codes[: len(chosen)], codes[len(chosen) :]
        prior = fit_prior(codes, images if len(images) else None)
        model = DeformationModel(base, settings, self.scaler, weights, codes, prior, split, summary)
        marks, pairs = self.marks
        limits = fit_limits(model.decoder_at(marks), pairs, prior.mean, every)
        decoded = model.decode(codes)
        placement = fit_placement(codes, decoded, chosen, base.bounding_diagonal)
        return replace(model, placement=placement, limits=limits)


def _calibrated(
    examples: _Examples, settings: ModelConfig, on_progress: ProgressCallback | None
) -> tuple[ModelConfig, float]:
    """λ₁, where the settings leave it open, and the noise of handle fits for unseen shapes.

    By shorter trainings on most examples. How many examples there are for a set's degrees of
    freedom decides how sparse the components have to be: the largest λ₁ that is nearly the best.

    Raises:
        KeyboardInterrupt: Ctrl-C; nothing is trained yet.
    """

    training = settings.training
    offered = _SPARSITIES if training.sparsity is None else (training.sparsity,)
    epochs = min(_TRIAL, training.epochs)
    steps = epochs + recoveries(len(examples.shapes)) * len(_NOISES)
    done = 0

    def report(_: object) -> None:
        nonlocal done
        done += 1
        if on_progress is not None:
            on_progress(TrainingProgress("calibration", done, len(offered) * steps))

    def errors(trial: ModelConfig) -> FloatArray | None:
        def learn(kept: IntArray) -> HandleFit:
            some = examples.some(kept)
            result = some.learn(trial, on_progress=report)
            if result.interrupted:
                raise KeyboardInterrupt
            solver = HandleSolver(some.model(result.weights, trial, {}, {}))

            def fit(
                index: IntArray, targets: FloatArray, noises: Sequence[float]
            ) -> Iterator[FloatArray]:
                solver.set_handles(index, targets, hard=True)
                for noise in noises:
                    solver.lean(noise=noise)
                    if noise == noises[0]:
                        pose = solver.solve()
                    else:
                        # On from the last noise: sooner, if now and then in another minimum.
                        solver.settle()
                        # As a cold solve gives it.
                        pose = solver.relax()
                    yield pose.vertices
                    report(pose)

            return fit

        return recovery_errors(learn, examples.shapes, examples.geodesics, _NOISES, 0)

    found = {
        sparsity: tried
        for sparsity in offered
        if (tried := errors(settings.with_training(sparsity=sparsity, epochs=epochs))) is not None
    }
    if not found:
        return settings.with_training(sparsity=offered[0]), _NOISES[-1]
    least = min(tried.min() for tried in found.values())
    chosen = next(s for s, tried in found.items() if tried.min() <= least + _WORTH)
    return settings.with_training(sparsity=chosen), _NOISES[int(found[chosen].argmin())]


def _without_noise(
    base: Mesh, chosen: FloatArray, own: int | None
) -> tuple[Mesh, FloatArray, float]:
    """The undeformed and the chosen shapes (N, V, 3) without noise, and its deviation.

    `own` is the undeformed shape's row among the chosen; None if it is not one of them.
    """
    every = chosen if own is not None else np.concatenate([chosen, base.vertices[None]])
    clean, noise = remove_noise(MeshSequence(every, base.faces))
    if not noise:
        return base, chosen, noise
    return Mesh(clean[-1 if own is None else own], base.faces), clean[: len(chosen)], noise


def _with_images(q: FloatArray, extractor: FeatureExtractor, shapes: MeshSequence) -> FloatArray:
    """Features (N, V, 9), followed by those of the shapes' mirror images where these tell more."""
    mirrored = extract_all(extractor, mirror_images(shapes)[0])
    scaler = FeatureScaler.fit(q)
    if not images_explain(scaler.scale(q), scaler.scale(mirrored)):
        return q
    return np.concatenate([q, mirrored])
