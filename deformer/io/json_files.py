"""JSON files: reading and writing, and the formats of splits and handle targets."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from deformer.checks import LARGEST, shortened
from deformer.errors import InputError
from deformer.io.atomic import PathLike, atomic_path
from deformer.io.json_values import JsonValue, read_value


def write_json(path: PathLike, data: Any) -> None:
    """Write `data` as JSON, indented by one; an existing file is replaced once all is written.

    Args:
        path: the file; its directory must exist.
        data: values that `json` writes, numpy arrays and numpy numbers.

    Raises:
        InputError: the directory is missing or not writable.
        ValueError: a number is not finite, which JSON cannot represent.
        TypeError: a value is of another type.
    """
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False, default=_plain)
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
        {"train": indices, "test": indices}, in the file's order.

    Raises:
        InputError: a list is missing, an index is no integer, out of range or given twice, or
            `train` is empty.
    """
    data = read_value(path)
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
        raise InputError(f"{path}: 'train' is empty, expected at least one shape; add indices")
    return {part: data[part].value for part in ("train", "test")}


@dataclass(frozen=True)
class HandleTarget:
    """Target position of one vertex.

    Args:
        vertex: vertex index, from 0.
        position: x, y, z in the units of the mesh.
        weight: positive weight of the distance in the fit.
    """

    vertex: int
    position: tuple[float, float, float]
    weight: float = 1.0


@dataclass(frozen=True)
class HandleFile:
    """Contents of a handles file.

    Args:
        frames: the handles of every frame; one frame for a single pose.
        is_sequence: true if the file has frames, false if it has a single pose.
    """

    frames: tuple[tuple[HandleTarget, ...], ...]
    is_sequence: bool


def load_handles(path: PathLike, vertex_count: int) -> HandleFile:
    """Load handle targets for one pose or for a sequence.

    Args:
        path: JSON `{"handles": [{"vertex": 17, "position": [x, y, z], "weight": 1.0}, …]}`, weight
            optional, or `{"frames": [[…handles…], …]}`.
        vertex_count: number of vertices of the mesh.

    Raises:
        InputError: a key or value is missing or wrong; the message names frame and handle.
    """
    data = read_value(path)
    if ("handles" in data) == ("frames" in data):
        raise InputError(
            f"{path}: has keys {shortened(sorted(data.value))}, expected either 'handles' or "
            "'frames'; give one"
        )
    is_sequence = "frames" in data
    frames = data["frames"].items() if is_sequence else [data["handles"]]
    if not frames:
        raise data["frames"].error("a list of frames")
    return HandleFile(tuple(_frame(handles, vertex_count) for handles in frames), is_sequence)


def _frame(handles: JsonValue, vertex_count: int) -> tuple[HandleTarget, ...]:
    entries = handles.items()
    if not entries:
        raise handles.error("a list of at least one handle", "add one")
    frame: dict[int, HandleTarget] = {}
    for entry in entries:
        handle = _handle(entry, vertex_count)
        if handle.vertex in frame:
            raise InputError(
                f"{entry}: vertex {handle.vertex} already has handle "
                f"{list(frame).index(handle.vertex)}, expected each vertex once; remove one"
            )
        frame[handle.vertex] = handle
    return tuple(frame.values())


def _handle(handle: JsonValue, vertex_count: int) -> HandleTarget:
    handle.check_keys(("vertex", "position"), ("weight",))
    x, y, z = handle["position"].numbers(3)
    weight = handle["weight"].number(above=0, most=LARGEST) if "weight" in handle else 1.0
    return HandleTarget(handle["vertex"].integer(0, vertex_count - 1), (x, y, z), weight)
