"""A model as a directory: weights in safetensors, the rest JSON and PLY, checked on loading."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformer.acap import FeatureScaler
from deformer.checks import LARGEST, checked_path
from deformer.documents import DOCUMENT_SUFFIXES, Document
from deformer.errors import InputError
from deformer.geometry import FloatArray, Mesh, Seams, connectivity_hash, no_seams
from deformer.io import (
    JsonValue,
    atomic_directory,
    check_directory,
    digest,
    expecting,
    load_mesh,
    locked,
    read_bytes,
    read_json,
    read_tensors,
    read_value,
    save_mesh,
    write_json,
    write_tensors,
)
from deformer.model.bend_limits import BendLimits
from deformer.model.component_names import check_names
from deformer.model.latent_prior import LatentPrior
from deformer.model.model import DeformationModel
from deformer.model.rigid_prior import RigidPrior
from deformer.network import ModelConfig, NetworkWeights

FORMAT_VERSION = 2
_WAIT = 30.0  # seconds for another process that writes the same model
_FILES = ("model.json", "reference.ply", "weights.safetensors")
_DOCUMENTS = tuple(f"document{suffix}" for suffix in DOCUMENT_SUFFIXES)
# The card, licence and picture of a shipped model: kept when a model is saved again.
_CARD = ("README.md", "LICENSE", "picture.png")
_KEYS = (
    *("format", "connectivity", "vertices", "faces", "config", "scaler", "split", "summary"),
    *("rigid_prior", "handle_noise", "component_names", "sha256"),
)


def check_model_folder(path: str | Path) -> None:
    """Check, before there is a model, that `save_model` can write one to `path`.

    Raises:
        InputError: as `save_model` would raise.
    """
    check_directory(path, _replaceable, _FILES[0], _CARD)


def save_model(model: DeformationModel, path: str | Path) -> None:
    """Write a model as a directory, replacing a model that is already there.

    README.md, LICENSE and picture.png of the model that is there stay.

    Args:
        model: the model.
        path: the directory; its parent must exist.

    Raises:
        InputError: the directory contains files that are no model's or that have changed since they
            were saved, or its parent does not exist.
        OSError: writing failed.
    """
    with (
        locked(path, _WAIT),
        atomic_directory(path, _replaceable, _FILES[0], _CARD) as folder,
    ):
        save_mesh(folder / "reference.ply", model.reference)
        arrays: dict[str, NDArray] = {f"network.{k}": v for k, v in model.weights.arrays.items()}
        arrays["codes"] = model.codes
        arrays["latent_mean"] = model.prior.mean
        arrays["latent_covariance"] = model.prior.covariance
        if model.rigid_prior is not None:
            for name, array in model.rigid_prior.arrays.items():
                arrays[f"rigid_prior_{name}"] = array
        if model.bend_limits is not None:
            for name, array in model.bend_limits.arrays.items():
                arrays[f"bend_limits_{name}"] = array
        if model.seams:
            arrays["seams"] = model.seams.closed
        write_tensors(folder / _FILES[2], arrays)
        files: list[str] = list(_FILES[1:])
        document = model.document
        if document is not None:
            files.append(f"document{document.suffix}")
            (folder / files[-1]).write_bytes(document.data)
        V = len(model.reference.vertices)
        scaler = model.scaler
        description = {
            "format": FORMAT_VERSION,
            "connectivity": connectivity_hash(model.reference.faces, V),
            "vertices": V,
            "faces": len(model.reference.faces),
            "config": model.config.as_dict(),
            "scaler": {"r": [scaler.r_min, scaler.r_max], "s": [scaler.s_min, scaler.s_max]},
            "split": model.split,
            "summary": model.summary,
            "rigid_prior": model.rigid_prior.deviations if model.rigid_prior else None,
            "handle_noise": model.handle_noise,
            "handle_misfits": list(model.handle_misfits),
            "component_names": _names_as_json(model.component_names),
            "sha256": {name: digest(folder / name) for name in files},
        }
        if document is not None:
            colours = {name: list(colour) for name, colour in document.colours.items()}
            description["document"] = {"file": files[-1], "name": document.name, "colours": colours}
        description["sha256"]["model.json"] = _digest_of_description(description)
        write_json(folder / "model.json", description)


def _replaceable(entry: Path) -> bool:
    """True for a file of a model, which a new model replaces."""
    return entry.name in (*_FILES, *_DOCUMENTS)


def _names_as_json(names: Mapping[int, str]) -> dict[str, str]:
    return {str(k): name for k, name in names.items()}


def save_names(path: str | Path, names: Mapping[int, str]) -> DeformationModel:
    """Name components of a model on disk; its other files stay as they are.

    Args:
        path: the model's directory.
        names: component → name; an empty name removes the component's.

    Returns:
        The model with its names.

    Raises:
        InputError: no such model, a shipped one, names that `check_names` rejects, or another
            process is writing the model.
    """
    if not checked_path(path).is_dir() and str(path) in shipped_models():
        raise InputError(
            f"{path}: a shipped model keeps its names; name those of a copy, as with "
            f"`deformer name {path} 3=nod -o my-{path}`"
        )
    # Between reading and writing another process must neither name components nor save a model.
    with locked(path, _WAIT):
        model = load_model(path).with_component_names(names)
        where = Path(path) / "model.json"
        data = read_json(where)
        data["component_names"] = _names_as_json(model.component_names)
        data["sha256"]["model.json"] = _digest_of_description(data)
        write_json(where, data)
    return model


def shipped_models() -> list[str]:
    """Names of the models that come with the package."""
    root = resources.files("deformer_models")
    return sorted(entry.name for entry in root.iterdir() if entry.joinpath("model.json").is_file())


def load_model(path: str | Path) -> DeformationModel:
    """Read a model from its directory, or a shipped model by its name.

    Args:
        path: the directory, or the name.

    Raises:
        InputError: no such model, a missing or altered file, another format version, or a
            reference mesh that does not match the weights.
    """
    folder = checked_path(path, "path")
    if not folder.is_dir() and len(folder.parts) == 1 and folder.name in shipped_models():
        # Installed packages are directories: every shipped file has a real path.
        folder = Path(str(resources.files("deformer_models").joinpath(folder.name)))
    while True:
        before = _version(folder)
        try:
            with expecting(path, "model"):
                return _read(folder, path)
        except (InputError, OSError) as error:
            # Files of two versions do not match: the model was saved again while it was read.
            if _version(folder) != before:
                continue
            if isinstance(error, InputError):
                raise
            name = error.filename or folder
            raise InputError(
                f"{name}: cannot be read ({error.strerror or error}); check the path"
            ) from error


def _version(folder: Path) -> tuple[int, int] | None:
    """Changes when a model is saved to `folder` or its description is replaced."""
    try:
        found = folder.stat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns


def _read(folder: Path, path: str | Path) -> DeformationModel:
    """The model of `folder`, which the caller names `path`."""
    if not folder.is_dir():
        raise InputError(
            f"{path}: no such model; give a model directory, or one of the shipped models: "
            f"{', '.join(shipped_models()) or 'none'}"
        )
    if not (folder / _FILES[0]).is_file():
        raise InputError(
            f"{folder / _FILES[0]}: missing, so {path} is no model; give a directory that "
            f"`deformer train` has written, with {', '.join(_FILES)}, or a shipped model: "
            f"{', '.join(shipped_models()) or 'none'}"
        )
    for name in _FILES:
        if not (folder / name).is_file():
            raise InputError(
                f"{folder / name}: missing, a model has {', '.join(_FILES)}; save it again"
            )
    data = read_value(folder / "model.json")
    version = data["format"]
    if version.integer() != FORMAT_VERSION:
        raise version.error(
            f"format version {FORMAT_VERSION}", "retrain, or use the release that wrote it"
        )
    data.check_keys(_KEYS, ("handle_misfits", "document"))
    _check_digests(folder, data)
    mesh = load_mesh(folder / "reference.ply")
    V, F = len(mesh.vertices), len(mesh.faces)
    if connectivity_hash(mesh.faces, V) != data["connectivity"].text():
        raise InputError(
            f"{folder / 'reference.ply'}: its connectivity is not the model's; restore the file"
        )
    for name, count in (("vertices", V), ("faces", F)):
        data[name].integer(count, count)
    tensors = _tensors(folder / "weights.safetensors")
    codes = tensors["codes"]
    split = _split(data["split"], len(codes))
    names = {}
    for key, name in data["component_names"].entries():
        if not key.isdecimal() or str(int(key)) != key:
            raise InputError(f"{name}: expected the index of a component as key; restore the file")
        names[int(key)] = name.text()
    bounds = (*data["scaler"]["r"].numbers(2), *data["scaler"]["s"].numbers(2))
    with _named(folder / "model.json", "config"):
        config = ModelConfig.from_dict(data["config"].value)
    with _named(folder / "model.json"):
        scaler = FeatureScaler(*bounds)
        noise = data["handle_noise"].number(above=0, most=LARGEST)
        misfits = (0.0, 0.0)
        if "handle_misfits" in data:
            few, many = data["handle_misfits"].numbers(2, least=0, most=LARGEST)
            misfits = few, many
        check_names(names, config.components)
    with _named(folder / "weights.safetensors"):
        weights = NetworkWeights.from_arrays(_arrays(tensors, "network."))
        if (K := weights.C.shape[2]) != config.components:
            raise data["config"]["components"].error(f"{K}, as the weights have")
        rigid_prior = _rigid_prior(data["rigid_prior"], tensors)
        limits = _arrays(tensors, "bend_limits_")
        return DeformationModel(
            mesh,
            config,
            scaler,
            weights,
            codes,
            LatentPrior(tensors["latent_mean"], tensors["latent_covariance"]),
            split,
            _object(data["summary"]),
            rigid_prior,
            names,
            noise,
            BendLimits(**limits) if limits else None,
            misfits,
            _seams(tensors, V),
            _document(folder, data, mesh),
        )


def _document(folder: Path, data: JsonValue, reference: Mesh) -> Document | None:
    """The document of a model, whose contents have been checked; None if it has none."""
    if "document" not in data:
        return None
    entry = data["document"]
    entry.check_keys(("file", "name", "colours"))
    path = folder / entry["file"].choice(_DOCUMENTS)
    colours = {
        name: colour.numbers(4, least=0, most=1) for name, colour in entry["colours"].entries()
    }
    return Document(
        path.suffix,
        read_bytes(path),
        entry["name"].text(),
        len(reference.vertices),
        reference.faces,
        colours,
    )


@contextmanager
def _named(path: Path, part: str = "") -> Iterator[None]:
    """Put the name of a file, and of a part of it, before the message of an InputError."""
    try:
        yield
    except InputError as error:
        text = str(error)
        if not text.startswith(str(path.parent)):
            text = ": ".join(filter(None, (str(path), part, text)))
        raise InputError(text) from error


def _check_digests(folder: Path, data: JsonValue) -> None:
    """Check that all files are those that were saved."""
    files = [*_FILES]
    if "document" in data:
        files.append(data["document"]["file"].choice(_DOCUMENTS))
    data["sha256"].check_keys(files)
    for name in files:
        path = folder / name
        if not path.is_file():
            raise InputError(f"{path}: missing; restore the file or save the model again")
        found = _digest_of_description(data.value) if name == "model.json" else digest(path)
        if found != data["sha256"][name].text():
            raise InputError(
                f"{path}: altered since the model was saved (checksum differs); "
                "restore the file or retrain"
            )


def _tensors(path: Path) -> dict[str, NDArray]:
    """All arrays of a model's weights, whose names and types are checked."""
    tensors = read_tensors(path)
    needed = {"codes", "latent_mean", "latent_covariance"}
    optional = [{"rigid_prior_offset", "rigid_prior_gain"}, {"seams"}]
    optional.append({f"bend_limits_{field.name}" for field in fields(BendLimits)})
    needed |= set().union(*(group for group in optional if group & set(tensors)))
    found = {name for name in tensors if not name.startswith("network.")}
    if found != needed:
        name = sorted(found ^ needed)[0]
        what = "missing" if name in needed else "unknown"
        raise InputError(f"{path}: {name}: {what}; restore the file or retrain")
    for name, array in tensors.items():
        kind = np.float32 if name.startswith("network.") else np.float64
        kind = np.int64 if name == "seams" else kind
        if array.dtype != kind:
            raise InputError(
                f"{path}: {name}: expected {np.dtype(kind)}, got {array.dtype}; restore the file"
            )
    return tensors


def _rigid_prior(deviations: JsonValue, tensors: Mapping[str, NDArray]) -> RigidPrior | None:
    if deviations.value is None:
        return None
    deviations.check_keys(("rotation", "translation"))
    rotation, translation = (
        deviations[n].number(above=0, most=LARGEST) for n in ("rotation", "translation")
    )
    return RigidPrior(rotation, translation, **_arrays(tensors, "rigid_prior_"))


def _seams(tensors: Mapping[str, NDArray], vertex_count: int) -> Seams:
    """The seams of a reference of V vertices; each closed vertex has a number, in order."""
    if "seams" not in tensors:
        return no_seams(vertex_count)
    closed = tensors["seams"]
    if closed.shape != (vertex_count,):
        raise InputError(f"seams: expected ({vertex_count},), got {closed.shape}; restore the file")
    first = np.sort(np.unique(closed, return_index=True)[1])
    if not np.array_equal(closed[first], np.arange(len(first))):
        raise InputError("seams: expected vertices numbered in order; restore the file or retrain")
    return Seams(closed)


def _split(value: JsonValue, count: int) -> dict[str, list[int]]:
    """The indices of training and test shapes; `count` is the number of the former."""
    value.check_keys((), ("train", "test"))
    split = {part: indices.integers(0) for part, indices in value.entries()}
    if "train" in split and len(split["train"]) != count:
        raise value["train"].error(f"{count} indices, one for each code")
    return split


def _object(value: JsonValue) -> dict[str, Any]:
    """A JSON object of any contents."""
    return {key: entry.value for key, entry in value.entries()}


def _arrays(tensors: Mapping[str, NDArray], prefix: str) -> dict[str, FloatArray]:
    """The tensors whose names begin with `prefix`, by the rest of their names."""
    return {
        name.removeprefix(prefix): array
        for name, array in tensors.items()
        if name.startswith(prefix)
    }


def _digest_of_description(data: dict[str, Any]) -> str:
    """SHA-256 of the description without its own checksum, however it is indented."""
    sums = {name: digest for name, digest in data["sha256"].items() if name != "model.json"}
    text = json.dumps({**data, "sha256": sums}, sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
