"""Training of a model from example shapes."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deformer.checks import (
    check_memory,
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
from deformer.geometry import (
    FloatArray,
    Mesh,
    MeshSequence,
    align,
    e_rms,
    find_seams,
    vertex_errors,
)
from deformer.io import locked
from deformer.linalg import check_device
from deformer.model import DeformationModel
from deformer.network import (
    FEATURES,
    AdamSettings,
    FactorisationSettings,
    ModelConfig,
    resolve_config,
)
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
    document: Document | None = None,
    checkpoint: str | Path | None = None,
    resume: bool = False,
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
        on_progress: called during feature extraction and after every epoch.

    Returns:
        The model. Ctrl-C during the training ends it: the model is then the best so far, and
        summary["interrupted"] is True.

    Raises:
        InputError: too few shapes, a bad split, config, device or checkpoint, a document of other
            shapes, or another process is writing to `checkpoint`.
        OSError: a checkpoint cannot be written.
        KeyboardInterrupt: Ctrl-C before or after the training. The checkpoint has what was
            finished: the features, the trials of settings, the network.

    Source: Tan et al. 2018; `docs/equations.md` says which function has which of its equations.
    """
    checked_instance(shapes, "shapes", MeshSequence, remedy="load shapes with load_shapes")
    settings = resolve_config(config, components=components, epochs=epochs, align=align_shapes)
    checked_integer(seed, "seed", least=0, most=2**63 - 1)
    checked_flag(resume, "resume")
    check_device(device)
    checked_choice(up, "up", ("x", "y", "z", "-x", "-y", "-z"))
    document = checked_document(document, "document")
    if document is not None:
        document.check_fits(shapes.vertices.shape[1], shapes.faces)
    if resume and (checkpoint is None or not has_checkpoint(checkpoint)):
        raise InputError(f"{checkpoint}: no checkpoint to resume; start without resuming")
    whole, seams = shapes, find_seams(shapes.vertices)
    shapes = seams.close_shapes(whole)
    _check_size(shapes, settings)
    folder = checked_path(checkpoint, "checkpoint") if checkpoint is not None else None
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
    test_shapes = shapes.subset(split["test"]).vertices if split["test"] else None

    if folder is not None:
        folder.absolute().parent.mkdir(parents=True, exist_ok=True)

    def on_features(done: int, total: int) -> None:
        if on_progress is not None:
            on_progress(TrainingProgress("features", done, total))

    reference_index = indices.index(reference) if reference in indices else None
    chosen = shapes.subset(indices)
    arrays = {"shapes": chosen.vertices, "faces": chosen.faces, "reference": base.vertices}
    identity = {**_identity(settings, seed), "shapes": digest(arrays)}
    stages = Stages(folder, identity)
    chosen_handles = {}
    with locked(folder) if folder is not None else nullcontext():
        if folder is not None and not resume:
            check_checkpoint(folder)
            remove_checkpoint(folder)
        if (kept := stages.load("features")) is not None:
            with blamed(Path(stages.place("features"))):
                examples = TrainingSet.restore(kept, base.faces)
        else:
            examples = TrainingSet.prepare(chosen, base, reference_index, settings, on_features)
            stages.save("features", examples.arrays)
        with blamed(folder if resume else None):
            if isinstance(settings.training, FactorisationSettings):
                search = SettingsSearch(examples, settings, stages, on_progress)
                settings, noise, misfits = search.run()
                chosen_handles = {"handle_noise": noise, "handle_misfits": misfits}
            result = examples.train_network(
                settings,
                seed=seed,
                device=device,
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
    rebuilt = model.decode(model.codes)
    summary["train_e_rms"] = e_rms(examples.shapes.vertices, rebuilt)
    summary |= _farthest(examples.shapes.vertices, rebuilt, indices, base)
    if "worst_piece_vertex" in summary:
        summary["worst_piece_vertex"] = int(seams.first[summary["worst_piece_vertex"]])
    if test_shapes is not None:
        if settings.align:
            test_shapes = align(test_shapes, examples.reference.vertices)
        summary["test_e_rms"] = e_rms(test_shapes, model.decode(model.encode(test_shapes)))
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
        components, config, epochs, align_shapes, seed: as in `train`.

    Raises:
        InputError: there is no checkpoint, it is damaged, or it was made with other options.
    """
    settings = resolve_config(config, components=components, epochs=epochs, align=align_shapes)
    check_identity(checkpoint, _identity(settings, seed))


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


def _check_size(shapes: MeshSequence, settings: ModelConfig) -> None:
    """Raise InputError for more components than features, or than memory holds."""
    (N, V), K = shapes.vertices.shape[:2], settings.components
    if K > FEATURES * V:
        raise InputError(
            f"components: expected at most {FEATURES * V}, {FEATURES} for each of {V} vertices, "
            f"got {shortened(K)}; ask for less"
        )
    width, mixed = FEATURES, 0
    if isinstance(settings.training, AdamSettings):
        width, mixed = max(FEATURES, *settings.layers), settings.training.mixed_shapes
    # In single precision: the components with three arrays of their size, the features of the
    # examples, of their mirror images and of mixed shapes; in double precision, K by K matrices.
    size = 4 * V * width * (4 * K + 4 * N + 2 * mixed) + 4 * 8 * K * K
    check_memory(size, f"training: {K} components, layers {settings.layers}, {V} vertices")


def _identity(config: ModelConfig, seed: int) -> dict[str, Any]:
    return {"config": config.as_dict(), "seed": seed}


def _farthest(
    shapes: FloatArray, rebuilt: FloatArray, indices: list[int], reference: Mesh
) -> dict[str, Any]:
    """Entries of a model's summary about the shapes and the piece that its codes tell least of.

    Args:
        shapes: (N, V, 3) training shapes.
        rebuilt: (N, V, 3) shapes decoded from their codes.
        indices: (N,) indices of the training shapes.
        reference: its connected components are the pieces.

    Returns:
        The shape whose centroid is farthest off, the shape that differs most besides, and where
        there are several pieces the first vertex of the piece that does; each with its distance
        (root mean square of the vertices') in bounding diagonals.
    """
    diagonal = reference.bounding_diagonal
    places = np.linalg.norm(shapes.mean(axis=1) - rebuilt.mean(axis=1), axis=1) / diagonal
    squares = (vertex_errors(shapes, rebuilt, "centroid") / diagonal) ** 2
    of_shapes = np.sqrt(squares.mean(axis=1))
    place, worst = int(places.argmax()), int(of_shapes.argmax())
    entries = {
        "worst_place": indices[place],
        "worst_place_distance": float(places[place]),
        "worst_shape": indices[worst],
        "worst_shape_rms": float(of_shapes[worst]),
    }
    if len(reference.links) == 0:
        return entries
    sums = np.bincount(reference.labels, weights=squares.mean(axis=0))
    of_pieces = np.sqrt(sums / np.bincount(reference.labels))
    piece = int(of_pieces.argmax())
    return entries | {
        "worst_piece_vertex": int((reference.labels == piece).argmax()),
        "worst_piece_rms": float(of_pieces[piece]),
    }


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
