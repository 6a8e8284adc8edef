"""Checkpoints: a JSON status and a file of arrays, replaced together or not at all."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from deformer.errors import InputError
from deformer.io import atomic_path, check_directory

_FORMAT = 1
_FILE = "checkpoint.json"
# Names of the files of a checkpoint, and of those that a killed process left half written.
_WRITTEN = re.compile(r"(\.)?(checkpoint|epoch-\d{7})(?(1)-[\da-f-]+)\.(json|safetensors)")


def has_checkpoint(folder: str | Path) -> bool:
    """True if `folder` contains a checkpoint."""
    return (Path(folder) / _FILE).is_file()


def check_checkpoint(folder: str | Path) -> None:
    """Check, before work starts, that checkpoints can be written to `folder`.

    Raises:
        InputError: it holds other files, is a file, or cannot be created.
    """
    check_directory(folder, _is_written)


def remove_checkpoint(folder: str | Path) -> None:
    """Remove a checkpoint, and `folder` if that was all it held."""
    folder = Path(folder)
    if not folder.is_dir():
        return
    # The description first: what a crash leaves of the others is then no checkpoint.
    for path in sorted(filter(_is_written, folder.iterdir()), key=lambda p: p.name != _FILE):
        path.unlink()
    if not any(folder.iterdir()) and not folder.is_symlink():
        folder.rmdir()


def _is_written(path: Path) -> bool:
    return path.is_file() and _WRITTEN.fullmatch(path.name) is not None


def save_checkpoint(
    folder: Path, identity: dict[str, Any], status: dict[str, Any], arrays: dict[str, NDArray]
) -> None:
    """Write a checkpoint, replacing the one in the folder.

    Args:
        folder: created if it is missing.
        identity: JSON values that have to be equal for a run to resume from the checkpoint.
        status: JSON values, among them the "epoch".
        arrays: name → array.
    """
    folder.mkdir(parents=True, exist_ok=True)
    # The arrays have the epoch in their file name, and the JSON, written last, contains that name:
    # a crash between the two leaves the previous pair valid.
    name = f"epoch-{status['epoch']:07d}.safetensors"
    with atomic_path(folder / name) as path:
        save_file({k: np.asarray(v, order="C") for k, v in arrays.items()}, path)
    text = json.dumps({"format": _FORMAT, "identity": identity, **status, "arrays": name}, indent=1)
    with atomic_path(folder / _FILE) as path:
        path.write_text(text + "\n")
    for old in folder.glob("epoch-*.safetensors"):
        if old.name != name:
            old.unlink()


def load_checkpoint(
    folder: Path | None, identity: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, NDArray]]:
    """Status and arrays of a folder's checkpoint.

    Args:
        folder: the folder.
        identity: that of the run that resumes; JSON values.

    Raises:
        InputError: there is no checkpoint, it is damaged, or it is of another identity.
    """
    if folder is None:
        raise InputError("resume: a checkpoint folder is needed")
    where = folder / _FILE
    if not where.is_file():
        raise InputError(f"{where}: no checkpoint to resume; start without --resume")
    try:
        status = json.loads(where.read_text())
        arrays = load_file(folder / status["arrays"])
        known, written = status["format"], status["identity"]
    except (ValueError, KeyError, OSError, SafetensorError) as error:
        raise InputError(f"{where}: not a readable checkpoint ({error}); delete it") from error
    if known != _FORMAT or written != identity:
        differing = [key for key, value in identity.items() if written.get(key) != value]
        raise InputError(
            f"{where}: made with other {', '.join(differing) or 'software'}; "
            "resume with the same shapes and options, or delete it"
        )
    return status, arrays
