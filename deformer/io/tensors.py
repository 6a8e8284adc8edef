"""Files of named arrays in the format safetensors, which contains no code."""

from __future__ import annotations

import errno
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import load_file, save_file

from deformer.checks import (
    as_array,
    checked_instance,
    checked_path,
    checked_text,
    shortened,
)
from deformer.errors import InputError
from deformer.io.atomic import PathLike, atomic_path, check_file
from deformer.io.json_values import JsonValue, parse_value

# Bytes of the JSON header, which names the arrays. The largest that this program writes has a few
# thousand; a parser takes many times the memory of its text.
_LONGEST_HEADER = 1_000_000


def read_tensors(path: PathLike) -> dict[str, NDArray]:
    """Arrays of a file by their names, of the shapes (...) that the file declares.

    Raises:
        InputError: the file is missing or damaged, or its size is not the one that it declares.
    """
    path = _checked(path)
    try:
        return load_file(path)
    except Exception as error:  # of several kinds, and not documented
        raise _damaged(path, error) from error


def read_metadata(path: PathLike, name: str) -> JsonValue:
    """The JSON object that `write_tensors` was given as metadata of that name.

    Raises:
        InputError: the file is missing or damaged, or has no such metadata.
    """
    path = _checked(path)
    try:
        with safe_open(path, "numpy") as file:
            text = (file.metadata() or {}).get(name)
    except Exception as error:  # as above
        raise _damaged(path, error) from error
    if text is None:
        raise InputError(f"{path}: no {name!r} in its header; delete or restore the file")
    return parse_value(text, f"{path}: {name}")


def checked_tensors(path: PathLike) -> Path:
    """The path of a file whose header fits its size.

    Raises:
        InputError: the file is missing or damaged, or its size is not the one that it declares.
    """
    path = _checked(path)
    try:
        with safe_open(path, "numpy"):
            return path
    except Exception as error:  # as above
        raise _damaged(path, error) from error


def write_tensors(
    path: PathLike, arrays: Mapping[str, NDArray], metadata: dict[str, str] | None = None
) -> None:
    """Write arrays by name; an existing file is replaced once all is written.

    Args:
        path: the file; its directory must exist.
        arrays: name → array (...).
        metadata: name → text, in the file's header.

    Raises:
        InputError: as `atomic_path` raises.
        OSError: writing failed.
    """
    checked_instance(arrays, "arrays", Mapping, remedy="give a dict")
    if metadata is not None:
        checked_instance(metadata, "metadata", Mapping, remedy="give a dict of texts")
    for name, text in (metadata or {}).items():
        checked_text(text, f"metadata: {shortened(name)}")
    contiguous = {name: np.asarray(as_array(a, name), order="C") for name, a in arrays.items()}
    for name, array in contiguous.items():
        if array.dtype.kind not in "fiub":
            raise InputError(f"{name}: expected numbers, got {shortened(array)}; leave it out")
    with atomic_path(path) as temporary:
        _save(temporary, contiguous, metadata)


def _save(path: Path, arrays: dict[str, NDArray], metadata: dict[str, str] | None) -> None:
    try:
        save_file(arrays, path, metadata)
    except SafetensorError as error:  # a full disk, for example
        found = re.search(r"os error (\d+)", str(error))
        number = int(found[1]) if found else errno.EIO
        raise OSError(number, str(error).removeprefix("Error while serializing: ")) from error


def _checked(path: PathLike) -> Path:
    """The path of a file whose header is of a usual size."""
    path = checked_path(path)
    check_file(path)
    with path.open("rb") as file:
        length = int.from_bytes(file.read(8), "little")
    if length > _LONGEST_HEADER:
        raise InputError(
            f"{path}: a header of {length} bytes, expected at most {_LONGEST_HEADER}; "
            "restore the file"
        )
    return path


def _damaged(path: Path, error: Exception) -> InputError:
    reason = " ".join(str(error).split()) or type(error).__name__
    return InputError(f"{path}: damaged ({reason}); restore the file")
