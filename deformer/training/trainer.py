"""Training of a model from example shapes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deformer.errors import InputError
from deformer.geometry import MeshSequence, align, e_rms
from deformer.linalg import resolve_device
from deformer.model import DeformationModel
from deformer.network import FactorisationSettings, ModelConfig, resolve_config
from deformer.training.checkpoints import check_checkpoint, has_checkpoint, remove_checkpoint
from deformer.training.loop import ProgressCallback, TrainingProgress, TrainingResult
from deformer.training.settings_search import SettingsSearch
from deformer.training.training_set import TrainingSet


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
        components: K, the dimension of the latent code; None keeps the config's.
        config: "default", "paper" or a ModelConfig.
        epochs: training steps; None keeps the config's.
        align_shapes: remove each shape's rigid motion first; None keeps the config's.
        split: {"train": indices, "test": indices}; the model's error on the "test" shapes is
            reported in its summary. None trains on all shapes.
        reference: index of the undeformed shape; None is shape 0, or the first training shape if 0
            is not one.
        seed: seed of weights and mixed shapes.
        device: "cpu", "cuda", "mps" or "auto".
        up: axis of the shapes that points up, "x" to "z" or "-x" to "-z"; kept for pictures.
        checkpoint: folder for checkpoints, or None; an old checkpoint there is replaced.
        resume: continue from `checkpoint`.
        on_progress: called during feature extraction and after every epoch.

    Returns:
        The model. Ctrl-C during the training ends it: the model is then the best so far, and
        summary["interrupted"] is True.

    Raises:
        InputError: too few shapes, a bad split, config, device or checkpoint.
        KeyboardInterrupt: Ctrl-C before the training, while features are extracted and settings
            are chosen.

    Source: Tan et al. 2018; `docs/equations.md` says which function has which of its equations.
    """
    settings = resolve_config(config, components=components, epochs=epochs, align=align_shapes)
    if device not in ("cpu", "auto"):  # torch takes seconds to import; Adam alone needs it
        resolve_device(device)
    if up.removeprefix("-") not in ("x", "y", "z"):
        raise InputError(f"up: expected x, y, z, -x, -y or -z, got {up!r}")
    if resume and (checkpoint is None or not has_checkpoint(checkpoint)):
        raise InputError(f"{checkpoint}: no checkpoint to resume; start without resuming")
    split = {"train": list(range(len(shapes))), "test": [], **(split or {})}
    indices = split["train"]
    if len(indices) < 2:
        raise InputError(
            f"train needs at least 2 training shapes, got {len(indices)}; add examples"
        )
    if reference is None:
        reference = 0 if 0 in indices else indices[0]
    base = shapes.mesh(reference)
    # Before the training, so that an invalid index is reported at once.
    test_shapes = shapes.subset(split["test"]).vertices if split["test"] else None

    if checkpoint is not None:
        Path(checkpoint).absolute().parent.mkdir(parents=True, exist_ok=True)
        check_checkpoint(checkpoint)
        if not resume:
            remove_checkpoint(checkpoint)

    def on_features(done: int, total: int) -> None:
        if on_progress is not None:
            on_progress(TrainingProgress("features", done, total))

    reference_index = indices.index(reference) if reference in indices else None
    examples = TrainingSet.prepare(
        shapes.subset(indices), base, reference_index, settings, on_features
    )
    handle_noise = None
    if isinstance(settings.training, FactorisationSettings):
        settings, handle_noise = SettingsSearch(examples, settings, on_progress).run()
    result = examples.train_network(
        settings,
        seed=seed,
        device=device,
        checkpoint=Path(checkpoint) if checkpoint is not None else None,
        resume=resume,
        on_progress=on_progress,
    )
    summary = {
        "shapes": len(shapes),
        "train": len(indices),
        "test": len(split["test"]),
        "reference": reference,
        "noise": examples.noise,
        "mirrored": examples.mirrored,
        "up": up,
        "seed": seed,
        **_outcome(result),
    }
    model = examples.build_model(result.weights, settings, split, summary)
    summary["train_e_rms"] = e_rms(examples.shapes.vertices, model.decode(model.codes))
    if test_shapes is not None:
        if settings.align:
            test_shapes = align(test_shapes, examples.reference.vertices)
        summary["test_e_rms"] = e_rms(test_shapes, model.decode(model.encode(test_shapes)))
    return model if handle_noise is None else replace(model, handle_noise=handle_noise)


def _outcome(result: TrainingResult) -> dict[str, Any]:
    """Entries of a model's summary about its training."""

    def finite(value: float) -> float | None:
        return value if np.isfinite(value) else None

    return {
        "epochs": result.epochs,
        "interrupted": result.interrupted,
        "seconds": round(result.seconds, 1),
        "loss": finite(result.loss),
        "reconstruction_loss": finite(result.reconstruction),
    }
