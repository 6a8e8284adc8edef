"""A model as a directory: weights in safetensors, the rest JSON and PLY, checked on loading."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save

from deformer.acap import FeatureScaler
from deformer.errors import InputError
from deformer.geometry import FloatArray, connectivity_hash
from deformer.io import (
    atomic_directory,
    check_directory,
    load_mesh,
    locked,
    save_mesh,
    write_json,
)
from deformer.model.bend_limits import BendLimits
from deformer.model.latent_prior import LatentPrior
from deformer.model.model import DeformationModel
from deformer.model.rigid_prior import RigidPrior
from deformer.network import ModelConfig, NetworkWeights

FORMAT_VERSION = 2
_WAIT = 30.0  # seconds for another process that writes the same model
_FILES = ("model.json", "reference.ply", "weights.safetensors")


def check_model_folder(path: str | Path) -> None:
    """Check, before there is a model, that `save_model` can write one to `path`.

    Raises:
        InputError: as `save_model` would raise.
    """
    check_directory(path, _replaceable)


def save_model(model: DeformationModel, path: str | Path) -> None:
    """Write a model as a directory, replacing a model that is already there.

    Args:
        model: the model.
        path: the directory; its parent must exist.

    Raises:
        InputError: the directory contains other files, or its parent does not exist.
        OSError: writing failed.
    """
    with locked(path, _WAIT), atomic_directory(path, _replaceable) as folder:
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
        weights = save({name: np.ascontiguousarray(array) for name, array in arrays.items()})
        (folder / _FILES[2]).write_bytes(weights)
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
            "component_names": _names_as_json(model.component_names),
            "sha256": {name: _digest(folder / name) for name in _FILES[1:]},
        }
        description["sha256"]["model.json"] = _digest_of_description(description)
        write_json(folder / "model.json", description)


def _replaceable(entry: Path) -> bool:
    """True for a file of a model, which a new model replaces."""
    return entry.name in (*_FILES, "README.md") and entry.is_file()


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
    if not Path(path).is_dir() and str(path) in shipped_models():
        raise InputError(f"{path}: a shipped model keeps its names; save a copy under another one")
    # Between reading and writing another process must neither name components nor save a model.
    with locked(path, _WAIT):
        model = load_model(path).with_component_names(names)
        where = Path(path) / "model.json"
        data = json.loads(where.read_text(encoding="utf-8"))
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
    folder = Path(path)
    if not folder.is_dir() and len(folder.parts) == 1 and folder.name in shipped_models():
        # Installed packages are directories: every shipped file has a real path.
        folder = Path(str(resources.files("deformer_models").joinpath(folder.name)))
    while True:
        before = _version(folder)
        try:
            return _read(folder, path)
        except InputError:
            # Files of two versions do not match: the model was saved again while it was read.
            if _version(folder) == before:
                raise


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
    for name in _FILES:
        if not (folder / name).is_file():
            raise InputError(
                f"{folder / name}: missing, a model has {', '.join(_FILES)}; save it again"
            )
    where = folder / "model.json"
    try:
        data = json.loads(where.read_text(encoding="utf-8"))
        version = data["format"]
    except (ValueError, KeyError, TypeError, OSError) as error:
        raise InputError(f"{where}: not a model description ({error}); restore it") from error
    if version != FORMAT_VERSION:
        raise InputError(
            f"{where}: format version {version}, expected {FORMAT_VERSION}; "
            "retrain, or use the release that wrote it"
        )
    try:
        return _assemble(folder, data)
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, RuntimeError, OSError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{where}: incomplete or not of these weights ({reason})") from error


def _assemble(folder: Path, data: dict[str, Any]) -> DeformationModel:
    """The model of a folder with the description `data`, after its checksums are verified."""
    for name, digest in data["sha256"].items():
        found = _digest_of_description(data) if name == "model.json" else _digest(folder / name)
        if found != digest:
            raise InputError(
                f"{folder / name}: altered since the model was saved (checksum differs); "
                "restore the file or retrain"
            )
    mesh = load_mesh(folder / "reference.ply")
    if connectivity_hash(mesh.faces, len(mesh.vertices)) != data["connectivity"]:
        raise InputError(
            f"{folder / 'reference.ply'}: its connectivity is not the model's; restore the file"
        )
    try:
        tensors = load_file(folder / "weights.safetensors")
    except SafetensorError as error:
        raise InputError(f"{folder / 'weights.safetensors'}: unreadable ({error})") from error
    try:
        config = ModelConfig.from_dict(data["config"])
    except InputError as error:
        raise InputError(f"{folder / 'model.json'}: config: {error}") from error
    weights = NetworkWeights.from_arrays(
        {k.removeprefix("network."): v for k, v in tensors.items() if k.startswith("network.")}
    )
    shape = (len(mesh.vertices), config.layers[-1], config.components)
    if weights.layers != config.layers or weights.C.shape != shape:
        raise ValueError(f"C: expected {shape}, got {weights.C.shape} of layers {weights.layers}")
    return DeformationModel(
        mesh,
        config,
        FeatureScaler(*data["scaler"]["r"], *data["scaler"]["s"]),
        weights,
        tensors["codes"],
        LatentPrior(tensors["latent_mean"], tensors["latent_covariance"]),
        data["split"],
        data["summary"],
        _rigid_prior(data["rigid_prior"], tensors),
        {int(k): str(name) for k, name in data["component_names"].items()},
        float(data["handle_noise"]),
        BendLimits(**limits) if (limits := _arrays(tensors, "bend_limits_")) else None,
    )


def _rigid_prior(
    deviations: Mapping[str, float] | None, tensors: Mapping[str, NDArray]
) -> RigidPrior | None:
    if deviations is None:
        return None
    arrays = _arrays(tensors, "rigid_prior_")
    return RigidPrior(**deviations, offset=arrays.get("offset"), gain=arrays.get("gain"))


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


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
