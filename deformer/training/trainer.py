"""Training of a model from example shapes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deformer.checks import (
    checked_choice,
    checked_flag,
    checked_indices,
    checked_instance,
    checked_integer,
    checked_path,
    shortened,
)
from deformer.documents import Document, checked_document
from deformer.errors import InputError
from deformer.geometry import Mesh, MeshSequence, ShapeSequence, StoredShapes, find_seams
from deformer.io import locked
from deformer.linalg import check_device
from deformer.model import DeformationModel
from deformer.network import FactorisationSettings, ModelConfig, resolve_config
from deformer.parallel import Threads, WorkerLost, executor_of
from deformer.training.checkpoints import (
    Stages,
    blamed,
    check_checkpoint,
    check_identity,
    digest,
    has_checkpoint,
    has_trained,
    remove_checkpoint,
)
from deformer.training.launch import check_alone
from deformer.training.loop import ProgressCallback, TrainingProgress, TrainingResult
from deformer.training.memory import reserve_memory
from deformer.training.rebuilding import held_out_error, rebuilding
from deformer.training.settings_search import SettingsSearch
from deformer.training.training_set import TrainingSet
from deformer.workspace import Workspace


def train(
    shapes: ShapeSequence,
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
    document: Document | None = None,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    workspace: Workspace | None = None,
    cluster: str | None = None,
    on_progress: ProgressCallback | None = None,
) -> DeformationModel:
    """Learn a deformation prior from example shapes.

    Args:
        shapes: N shapes with one connectivity. Vertices that coincide in all of them
            (`SEAM_TOLERANCE`) are one to the model, and come back as many.
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
        up: axis of the shapes that points up, "x" to "z" or "-x" to "-z"; for pictures, USD and
            GLB files.
        document: the file that shapes of the model are written like, as of `load_document`; kept
            with the model.
        checkpoint: folder for checkpoints, or None; an old checkpoint there is replaced.
        resume: continue from `checkpoint`.
        workspace: says how much memory the process may use; arrays that exceed that are in
            temporary files. None is half of what is free, and files beside the checkpoint or in the
            system's folder. The model does not depend on it.
        cluster: address of a Dask scheduler, "tcp://HOST:PORT", or "local:N" for N workers on this
            machine, that extract features, try settings, and share the rounds of a factorisation
            of many vertices. None is this process.
        on_progress: called during feature extraction and after every epoch.

    Returns:
        The model. Ctrl-C during the training ends it with the best model so far, whose
        summary["interrupted"] is True.

    Raises:
        InputError: too few shapes, a bad split, config, device or checkpoint, a document of other
            shapes, too little memory or room for temporary files, another process is writing to
            `checkpoint`, the cluster cannot be used, or its workers end again and again.
        OSError: a checkpoint cannot be written.
        KeyboardInterrupt: Ctrl-C before or after the training. The checkpoint has what was
            finished: the features, the trials of settings, the network.

    Source: Tan et al. 2018; `docs/understand/equations.md` says which
    function has which of its equations.
    """
    if not isinstance(shapes, StoredShapes):
        checked_instance(shapes, "shapes", MeshSequence, remedy="load shapes with load_shapes")
    settings = resolve_config(config, components=components, epochs=epochs, align=align_shapes)
    if isinstance(settings.training, FactorisationSettings):
        check_alone(f"the configuration {settings.name!r} is trained by one alone")
    checked_integer(seed, "seed", least=0, most=2**63 - 1)
    checked_flag(resume, "resume")
    check_device(device)
    checked_choice(up, "up", ("x", "y", "z", "-x", "-y", "-z"))
    document = checked_document(document, "document")
    if document is not None:
        document.check_fits(shapes.vertices.shape[1], shapes.faces)
    if resume and (checkpoint is None or not has_checkpoint(checkpoint)):
        raise InputError(f"{checkpoint}: no checkpoint to resume; start without resuming")
    folder = checked_path(checkpoint, "checkpoint") if checkpoint is not None else None
    if folder is not None:
        folder.absolute().parent.mkdir(parents=True, exist_ok=True)
    if workspace is None:
        workspace = Workspace(folder=None if folder is None else folder.absolute().parent)
    checked_instance(workspace, "workspace", Workspace, remedy="make one, or leave it out")
    side_by_side = reserve_memory(shapes, settings, workspace)
    whole, seams = shapes, find_seams(shapes.vertices)
    shapes = seams.close_shapes(whole, workspace)
    split = _checked_split({} if split is None else split, len(shapes))
    indices = split["train"]
    if len(indices) < 2:
        raise InputError(
            f"train needs at least 2 training shapes, got {len(indices)}; add examples"
        )
    if reference is None:
        reference = 0 if 0 in indices else indices[0]
    base = shapes.mesh(reference)
    # Before the training, so that an invalid index is reported at once.
    test_shapes = shapes.subset(split["test"]) if split["test"] else None

    def on_features(done: int, total: int) -> None:
        if on_progress is not None:
            on_progress(TrainingProgress("features", done, total))

    reference_index = indices.index(reference) if reference in indices else None
    chosen = shapes if indices == list(range(len(shapes))) else shapes.subset(indices)
    arrays = {"shapes": chosen.vertices, "faces": chosen.faces, "reference": base.vertices}
    identity = {**_identity(settings, seed), "shapes": digest(arrays)}
    stages = Stages(folder, identity)
    chosen_handles = {}
    with (
        locked(folder) if folder is not None else nullcontext(),
        _losses_told(),
        Threads(side_by_side) if cluster is None else executor_of(cluster=cluster) as executor,
    ):
        if folder is not None and not resume:
            check_checkpoint(folder)
            remove_checkpoint(folder)
        if (kept := stages.load("features", workspace)) is not None:
            with blamed(Path(stages.place("features"))):
                examples = TrainingSet.restore(kept, base.faces, workspace)
        else:
            examples = TrainingSet.prepare(
                chosen, base, reference_index, settings, workspace, executor, on_features
            )
            stages.save("features", examples.arrays)
        with blamed(folder if resume else None):
            if isinstance(settings.training, FactorisationSettings):
                # The search has the models of its trials, which are not kept beside the training.
                settings, noise, misfits = SettingsSearch(
                    examples, settings, stages, executor, on_progress
                ).run()
                chosen_handles = {"handle_noise": noise, "handle_misfits": misfits}
            result = examples.train_network(
                settings,
                seed=seed,
                device=device,
                # Here each round keeps all cores busy; threads would have all tiles in memory.
                executor=None if cluster is None else executor,
                checkpoint=folder,
                resume=resume and folder is not None and has_trained(folder),
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
    with blamed(folder if resume else None):
        model = examples.build_model(result.weights, settings, split, summary)
    summary |= rebuilding(examples.shapes, model, indices)
    if "worst_piece_vertex" in summary:
        summary["worst_piece_vertex"] = int(seams.first[summary["worst_piece_vertex"]])
    if test_shapes is not None:
        summary["test_e_rms"] = held_out_error(test_shapes, model)
    opened = Mesh(seams.open(model.reference.vertices), whole.faces)
    return replace(model, reference=opened, seams=seams, document=document, **chosen_handles)


def check_resumable(
    checkpoint: str | Path,
    components: int | None = None,
    *,
    config: str | ModelConfig = "default",
    epochs: int | None = None,
    align_shapes: bool | None = None,
    seed: int = 0,
) -> None:
    """Check, before the shapes are read, that `train` can resume from a checkpoint.

    Args:
        checkpoint: folder of the checkpoint.
        components: as in `train`.
        config: as in `train`.
        epochs: as in `train`.
        align_shapes: as in `train`.
        seed: as in `train`.

    Raises:
        InputError: there is no checkpoint, it is damaged, or it was made with other options.
    """
    settings = resolve_config(config, components=components, epochs=epochs, align=align_shapes)
    check_identity(checkpoint, _identity(settings, seed))


@contextmanager
def _losses_told() -> Iterator[None]:
    """Turn the loss of workers again and again into an InputError."""
    try:
        yield
    except WorkerLost as error:
        raise InputError(
            f"cluster: {error}; give the workers more memory, then resume from the checkpoint"
        ) from error


def _checked_split(split: Any, count: int) -> dict[str, list[int]]:
    """Indices of training and test shapes; all train where `split` does not say which."""
    if not isinstance(split, Mapping) or not set(split) <= {"train", "test"}:
        raise InputError(
            f"split: expected {{'train': indices, 'test': indices}}, got {shortened(split)}; "
            "correct it"
        )
    parts = {"train": range(count), "test": (), **split}
    return {
        part: checked_indices(parts[part], f"split: {part}", count, what="shape").tolist()
        for part in ("train", "test")
    }


def _identity(config: ModelConfig, seed: int) -> dict[str, Any]:
    return {"config": config.as_dict(), "seed": seed}


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
