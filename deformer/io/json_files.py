"""JSON files: reading and writing, and the formats of splits and handle targets."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deformer.errors import InputError
from deformer.io.atomic import PathLike, atomic_path, read_bytes


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
        temporary.write_text(text + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def read_json(path: PathLike) -> dict[str, Any]:
    """Read a JSON file that contains an object.

    Args:
        path: the file.

    Raises:
        InputError: the file is missing, not JSON, or contains something else.
    """
    path = Path(path)
    content = read_bytes(path)
    try:
        data = json.loads(content)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}, line {error.lineno}: not JSON ({error.msg}); correct the line"
        ) from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not JSON ({error}); write the file again") from error
    if not isinstance(data, dict):
        raise InputError(f"{path}: a JSON {type(data).__name__}, expected an object {{…}}; wrap it")
    return data


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


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
    file = Path(path)
    data = read_json(file)
    owner: dict[int, str] = {}
    for part in ("train", "test"):
        if not isinstance(data.get(part), list):
            raise InputError(f'{file}: no list {part!r}, expected {{"train": […], "test": […]}}')
        for i, index in enumerate(data[part]):
            if not _is_integer(index) or not 0 <= index < count:
                raise InputError(
                    f"{file}, {part}[{i}]: found {index!r}, expected an integer of 0…{count - 1}; "
                    "correct or remove it"
                )
            if index in owner:
                raise InputError(
                    f"{file}, {part}[{i}]: shape {index} is already in {owner[index]!r}, expected "
                    "each shape once; remove one"
                )
            owner[index] = part
    if not data["train"]:
        raise InputError(f"{file}: 'train' is empty, expected at least one shape; add indices")
    return {part: list(data[part]) for part in ("train", "test")}


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
    file = Path(path)
    data = read_json(file)
    if ("handles" in data) == ("frames" in data):
        raise InputError(
            f"{file}: has keys {sorted(data)}, expected either 'handles' or 'frames'; give one"
        )
    is_sequence = "frames" in data
    frames = data["frames"] if is_sequence else [data["handles"]]
    if not isinstance(frames, list) or not frames:
        raise InputError(f"{file}: 'frames' is {_brief(frames)}, expected a list of frames")
    return HandleFile(
        tuple(
            _frame(handles, f"{file}, frame {i}" if is_sequence else str(file), vertex_count)
            for i, handles in enumerate(frames)
        ),
        is_sequence,
    )


def _frame(handles: Any, label: str, vertex_count: int) -> tuple[HandleTarget, ...]:
    if not isinstance(handles, list) or not handles:
        raise InputError(
            f"{label}: found {_brief(handles)}, expected a list of at least one handle; add one"
        )
    frame = tuple(_handle(h, f"{label}, handle {i}", vertex_count) for i, h in enumerate(handles))
    seen: dict[int, int] = {}
    for i, handle in enumerate(frame):
        if handle.vertex in seen:
            raise InputError(
                f"{label}, handle {i}: vertex {handle.vertex} is already held by handle "
                f"{seen[handle.vertex]}, expected each vertex once; remove one"
            )
        seen[handle.vertex] = i
    return frame


def _handle(handle: Any, label: str, vertex_count: int) -> HandleTarget:
    if not isinstance(handle, dict) or not {"vertex", "position"} <= set(handle):
        raise InputError(
            f'{label}: found {_brief(handle)}, expected {{"vertex": …, "position": [x, y, z]}}; '
            "complete it"
        )
    unknown = sorted(set(handle) - {"vertex", "position", "weight"})
    if unknown:
        raise InputError(
            f"{label}: unknown key {unknown[0]!r}, expected vertex, position, weight; rename or "
            "remove it"
        )
    vertex, position, weight = handle["vertex"], handle["position"], handle.get("weight", 1.0)
    if not _is_integer(vertex) or not 0 <= vertex < vertex_count:
        raise InputError(
            f"{label}: vertex {_brief(vertex)}, expected an integer of 0…{vertex_count - 1}; "
            "choose a vertex of the mesh"
        )
    if (
        not isinstance(position, list)
        or len(position) != 3
        or not all(_is_number(x) for x in position)
    ):
        raise InputError(
            f"{label}: position {_brief(position)}, expected three finite numbers; correct it"
        )
    if not _is_number(weight) or weight <= 0:
        raise InputError(
            f"{label}: weight {_brief(weight)}, expected a finite number above 0; correct it"
        )
    x, y, z = (float(value) for value in position)
    return HandleTarget(vertex, (x, y, z), float(weight))


def _is_number(value: Any) -> bool:
    """True if a JSON value is a number that fits a finite float."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= sys.float_info.max


def _brief(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "…"
