"""JSON files: reading and writing, and the format of splits."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from deformer.checks import checked_integer
from deformer.errors import InputError
from deformer.io.atomic import PathLike, atomic_path
from deformer.io.file_kinds import expecting
from deformer.io.json_values import JsonValue, read_value


def write_json(path: PathLike, data: Any) -> None:
    """Write `data` as JSON, indented by one; an existing file is replaced once all is written.

    Args:
        path: the file; its directory must exist.
        data: values that `json` writes, numpy arrays and numpy numbers.

    Raises:
        InputError: the directory is missing or not writable, a number is not finite, which JSON
            cannot represent, or a value is of another type.
    """
    try:
        text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False, default=_plain)
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(
            f"{path}: cannot be written as JSON ({error}); give finite numbers, texts, lists and "
            "dicts"
        ) from error
    with atomic_path(path) as temporary:
        # Names of files may have bytes that are no text; JSON writes them as \udcff.
        temporary.write_bytes(f"{text}\n".encode(errors="backslashreplace"))


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def read_json(path: PathLike) -> dict[str, Any]:
    """Read a JSON file that contains an object.

    Args:
        path: the file.

    Raises:
        InputError: the file is missing, not JSON, contains something else, or a number or text
            that JSON cannot represent.
    """
    return read_value(path).value


def load_split(path: PathLike, count: int) -> dict[str, list[int]]:
    """Load the indices of training and test shapes.

    Args:
        path: JSON `{"train": [indices], "test": [indices]}`; `test` may be empty.
        count: number of shapes; indices count from 0.

    Returns:
        Indices by the keys "train" and "test", in the file's order.

    Raises:
        InputError: a list is missing, an index is no integer, out of range or given twice, or
            `train` is empty.
    """
    checked_integer(count, "count", least=0)
    with expecting(path, "split"):
        data = read_value(path)
        return _checked_split(data, count)


def _checked_split(data: JsonValue, count: int) -> dict[str, list[int]]:
    owner: dict[int, str] = {}
    for part in ("train", "test"):
        for entry in data[part].items():
            index = entry.integer(0, count - 1)
            if index in owner:
                raise InputError(
                    f"{entry}: shape {index} is already in {owner[index]!r}, expected each shape "
                    "once; remove one"
                )
            owner[index] = part
    if not data["train"].value:
        raise InputError(f"{data}: 'train' is empty, expected at least one shape; add indices")
    return {part: data[part].value for part in ("train", "test")}
