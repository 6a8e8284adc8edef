"""Checkpoints of a training, and what is finished before it, in one folder.

The training has a JSON status and a file of arrays, replaced together or not at all; each stage
before it has one file of arrays.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformer.checks import LARGEST, checked_array, checked_path
from deformer.errors import InputError
from deformer.io import (
    JsonValue,
    atomic_path,
    begins_with,
    check_directory,
    read_metadata,
    read_rows,
    read_tensors,
    read_value,
    write_rows,
    write_tensors,
)
from deformer.network import MOST_EPOCHS
from deformer.workspace import Rows, StoredArray, Workspace, blocks

_FORMAT = 2
_FILE = "checkpoint.json"
_STAGES = ("features", "trials")
# Arrays of stages that need not be in memory.
_LARGE = ("vertices", "features")
_REMEDY = "delete the checkpoint, or start without --resume"
# Names of files of a checkpoint, with how these begin; last, what killed processes left of them.
_WRITTEN = {
    r"checkpoint\.json": rb'\{\s*"format": \d+,\s*"identity": ',
    rf"(epoch-\d{{7}}|{'|'.join(_STAGES)})\.safetensors": rb'.{8}\{"__metadata__":\{"identity":',
    rf"\.(checkpoint|epoch-\d{{7}}|{'|'.join(_STAGES)})-[\da-f-]+\.(json|safetensors)": b"",
}


def has_checkpoint(folder: str | Path) -> bool:
    """True if `folder` contains a checkpoint, of the training or of a stage before it."""
    folder = checked_path(folder, "checkpoint")
    return has_trained(folder) or any(_stage(folder, name).is_file() for name in _STAGES)


def has_trained(folder: str | Path) -> bool:
    """True if `folder` contains a checkpoint of the training itself."""
    return (Path(folder) / _FILE).is_file()


def check_checkpoint(folder: str | Path) -> None:
    """Check, before work starts, that checkpoints can be written to `folder`.

    Raises:
        InputError: it holds files that are no checkpoint's, is a file, or cannot be created.
    """
    check_directory(folder, _is_written, manifest=None)


def remove_checkpoint(folder: str | Path) -> None:
    """Remove a checkpoint, and `folder` if that was all it held."""
    folder = checked_path(folder, "checkpoint")
    if not folder.is_dir():
        return
    # The description first: what a crash leaves of the others is then no checkpoint.
    for path in sorted(filter(_is_written, folder.iterdir()), key=lambda p: p.name != _FILE):
        path.unlink()
    if not any(folder.iterdir()) and not folder.is_symlink():
        folder.rmdir()


def _is_written(path: Path) -> bool:
    """True for a file of a checkpoint, by name and contents."""
    return any(
        re.fullmatch(name, path.name) and begins_with(path, beginning)
        for name, beginning in _WRITTEN.items()
    )


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
    name = _arrays_name(status["epoch"])
    write_tensors(folder / name, arrays, {"identity": json.dumps(identity)})
    text = json.dumps({"format": _FORMAT, "identity": identity, **status, "arrays": name}, indent=1)
    with atomic_path(folder / _FILE) as path:
        path.write_text(text + "\n")
    for old in folder.glob("epoch-*.safetensors"):
        if old.name != name and _is_written(old):
            old.unlink()


def load_checkpoint(
    folder: Path, identity: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, NDArray]]:
    """Status and arrays of a folder's checkpoint.

    Args:
        folder: the folder.
        identity: that of the run that resumes; JSON values.

    Raises:
        InputError: there is no checkpoint, it is damaged, or it is of another identity.
    """
    where = folder / _FILE
    if not where.is_file():
        raise InputError(f"{where}: no checkpoint to resume; start without --resume")
    data = read_value(where)
    epoch = data["epoch"].integer(0, MOST_EPOCHS)
    data["seconds"].number(least=0)
    name = _arrays_name(epoch)
    data["arrays"].choice((name,))
    written = dict(data["identity"].entries(), format=data["format"])
    _compare(where, written, {"format": _FORMAT, **identity})
    return data.value, read_tensors(folder / name)


def check_arrays(file: Path, found: Mapping[str, NDArray], expected: Mapping[str, NDArray]) -> None:
    """Check the arrays of a checkpoint against those that the training has at its start.

    Args:
        file: the file of the arrays, for messages.
        found: name → array.
        expected: name → array of the shape and the dtype that `found` must have.

    Raises:
        InputError: an array is missing, unknown, of another kind, not finite, or too large.
    """
    for name in sorted({*found, *expected}):
        what, got = _kind(expected.get(name)), _kind(found.get(name))
        if what != got:
            raise InputError(f"{file}: {name}: expected {what}, got {got}; {_REMEDY}")
        checked_array(found[name], f"{file}: {name}", largest=LARGEST, remedy=_REMEDY)


def check_state(arrays: Mapping[str, NDArray], epoch: int) -> None:
    """Check, before it is saved, that a training's state can be loaded again.

    Raises:
        InputError: an array is not finite, or too large: the training has diverged.
    """
    for name, array in arrays.items():
        checked_array(
            array,
            f"training: diverged by epoch {epoch}: {name}",
            largest=LARGEST,
            remedy="check the shapes (deformer check), or train with another configuration",
        )


@contextmanager
def blamed(place: Path | None) -> Iterator[None]:
    """Let a failure within the block name the checkpoint that the block works with.

    Args:
        place: the checkpoint's folder, or its file; None if nothing comes from a checkpoint.

    Raises:
        InputError: in place of one that does not name `place`, and of errors of arithmetic.
    """
    try:
        yield
    except (InputError, ArithmeticError, np.linalg.LinAlgError) as error:
        if place is None or str(error).startswith(str(place)):
            raise
        fault = str(error).rpartition("; ")[0] or error  # without the remedy
        raise InputError(f"{place}: training cannot go on from it ({fault}); {_REMEDY}") from error


class Stages:
    """Results of the stages before the training, kept in the folder of its checkpoint.

    Args:
        folder: the folder; None keeps nothing.
        identity: JSON values that have to be equal for a stage to be used again.
    """

    def __init__(self, folder: Path | None, identity: dict[str, Any]) -> None:
        """Nothing is read yet."""
        self._folder, self._identity = folder, {"format": _FORMAT, **identity}

    def load(self, name: str, workspace: Workspace | None = None) -> dict[str, Rows] | None:
        """Arrays of a stage, "features" or "trials"; None if it is not there.

        Args:
            name: of the stage.
            workspace: gives memory for large arrays; those that it has none for stay in the file.
                None reads all into memory.

        Raises:
            InputError: it is damaged, or of another identity.
        """
        if self._folder is None or not (where := _stage(self._folder, name)).is_file():
            return None
        self.check(name)
        large = () if workspace is None else _LARGE
        arrays = read_rows(where, workspace or Workspace(), large)
        if read_metadata(where, "identity")["arrays"].value != digest(arrays):
            raise InputError(f"{where}: altered since it was written; {_REMEDY}")
        return arrays

    def place(self, name: str) -> str:
        """What messages call a stage: its file, where there is one."""
        return name if self._folder is None else str(_stage(self._folder, name))

    def check(self, name: str) -> None:
        """Raise the InputError of `load`, without reading the arrays."""
        if self._folder is None or not (where := _stage(self._folder, name)).is_file():
            return
        _compare(where, dict(read_metadata(where, "identity").entries()), self._identity)

    def save(self, name: str, arrays: Mapping[str, Rows]) -> None:
        """Keep the arrays of a stage, in place of earlier ones."""
        if self._folder is None:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        identity = {**self._identity, "arrays": digest(arrays)}
        write_rows(_stage(self._folder, name), arrays, {"identity": json.dumps(identity)})


def check_identity(folder: str | Path, identity: dict[str, Any]) -> None:
    """Check, before there are shapes, that a run can resume from a folder's checkpoint.

    Args:
        folder: the folder.
        identity: as much of the run's identity as is known.

    Raises:
        InputError: there is no checkpoint, it is damaged, or it is of another identity.
    """
    if not has_checkpoint(folder):
        raise InputError(f"{folder}: no checkpoint to resume from; start without resuming")
    if has_trained(folder):
        load_checkpoint(Path(folder), {})
    for name in _STAGES:
        Stages(Path(folder), identity).check(name)


def _stage(folder: str | Path, name: str) -> Path:
    return Path(folder) / f"{name}.safetensors"


def digest(arrays: Mapping[str, Rows]) -> str:
    """SHA-256 of arrays and their names."""
    found = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        found.update(f"{name} {array.dtype} {array.shape}".encode())
        if isinstance(array, StoredArray):
            for part in blocks(array):
                found.update(array[part].data)
        else:
            found.update(np.ascontiguousarray(array).data)
    return found.hexdigest()


def _kind(array: NDArray | None) -> str:
    return "nothing" if array is None else f"{array.dtype} {array.shape}"


def _arrays_name(epoch: int) -> str:
    """Name of the file of arrays after an epoch."""
    return f"epoch-{epoch:07d}.safetensors"


def _compare(where: Path, written: dict[str, JsonValue], identity: dict[str, Any]) -> None:
    """Raise InputError if a value of `identity` is not the one that was written."""
    differing = [
        k for k, value in identity.items() if k not in written or written[k].value != value
    ]
    if differing:
        raise InputError(
            f"{where}: made with other {', '.join(differing)}; "
            "resume with the same shapes and options, or delete it"
        )
