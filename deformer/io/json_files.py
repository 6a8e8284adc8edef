"""JSON files: reading and writing, and the formats of splits and handle targets."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from deformer.checks import LARGEST, checked_integer, shortened
from deformer.errors import InputError
from deformer.geometry import MOST_ORIENTATION_WEIGHT, IntArray, SurfacePoint, plain_point
from deformer.io.atomic import PathLike, atomic_path
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
        {"train": indices, "test": indices}, in the file's order.

    Raises:
        InputError: a list is missing, an index is no integer, out of range or given twice, or
            `train` is empty.
    """
    checked_integer(count, "count", least=0)
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


_OPTIONAL = ("offset", "weight", "kind", "orientation", "orientation_weight")
HandleKind = Literal["soft", "exact", "pin"]


@dataclass(frozen=True)
class HandleTarget:
    """Target position of one handle.

    Args:
        vertex: vertex index, from 0, or a point of the surface.
        position: x, y, z in the units of the mesh.
        weight: positive weight of the distance in the fit.
        kind: "soft" for near the position, "exact" or "pin" for on it.
        orientation: rotation matrix of the surface around it, relative to the reference, by rows;
            None leaves it free.
        orientation_weight: positive weight of the orientation, beside `weight`.
    """

    vertex: int | SurfacePoint
    position: tuple[float, float, float]
    weight: float = 1.0
    kind: HandleKind = "soft"
    orientation: tuple[tuple[float, ...], ...] | None = None
    orientation_weight: float = 1.0


@dataclass(frozen=True)
class HandleFile:
    """Contents of a handles file.

    Args:
        frames: the handles of every frame; one frame for a single pose.
        is_sequence: true if the file has frames, false if it has a single pose.
        noise: standard deviation of each of the positions' coordinates, in the units of the mesh;
            None if the file does not tell it.
    """

    frames: tuple[tuple[HandleTarget, ...], ...]
    is_sequence: bool
    noise: float | None = None


def load_handles(path: PathLike, vertex_count: int, faces: IntArray | None = None) -> HandleFile:
    """Load handle targets for one pose or for a sequence.

    Args:
        path: JSON `{"handles": [{"vertex": 17, "position": [x, y, z]}, …]}`, or `{"frames":
            [[…handles…], …]}`. In place of "vertex" a handle may have "face" and "barycentric": a
            point of that face. It may also have "offset" (distance from the surface along the
            normal), "weight", "kind" ("soft", "exact" or "pin"), "orientation" (of the surface
            relative to the reference: a unit quaternion [w, x, y, z], a rotation matrix by rows,
            or null) and "orientation_weight". A handle whose position is null, or three nulls, is
            not seen, and left out; a frame may be empty. Beside "handles" or "frames" there may be
            "noise", the standard deviation of all positions' coordinates.
        vertex_count: number of vertices of the mesh.
        faces: (F, 3) its faces; None refuses points of faces.

    Raises:
        InputError: a key or value is missing or wrong, or no handle is seen at all; the message
            names frame and handle.
    """
    checked_integer(vertex_count, "vertex_count", least=0)
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
    rows = np.empty((0, 3), dtype=np.int64) if faces is None else faces
    found = tuple(_frame(handles, vertex_count, rows) for handles in frames)
    if not any(found):
        where = data["frames" if is_sequence else "handles"]
        raise InputError(
            f"{where}: no handle has a position, expected at least one handle that does; add one"
        )
    noise = data["noise"].number(above=0, most=LARGEST) if "noise" in data else None
    return HandleFile(found, is_sequence, noise)


def _frame(handles: JsonValue, vertex_count: int, faces: IntArray) -> tuple[HandleTarget, ...]:
    """The handles of a frame that are seen."""
    seen: list[HandleTarget] = []
    points: dict[int | SurfacePoint, int] = {}
    for n, entry in enumerate(handles.items()):
        place = ("face", "barycentric") if "face" in entry else ("vertex",)
        entry.check_keys((*place, "position"), _OPTIONAL)
        point = plain_point(_point(entry, vertex_count, faces))
        weight = entry["weight"].number(above=0, most=LARGEST) if "weight" in entry else 1.0
        kind = entry["kind"].choice(get_args(HandleKind)) if "kind" in entry else "soft"
        if point in points:
            what = f"vertex {point}" if isinstance(point, int) else "that point"
            raise InputError(
                f"{entry}: {what} already has handle {points[point]}, expected each once; remove "
                "one"
            )
        points[point] = n
        turn = _orientation(entry, point, faces)
        name, most = "orientation_weight", MOST_ORIENTATION_WEIGHT
        factor = entry[name].number(above=0, most=most) if name in entry else 1.0
        if entry["position"].value not in (None, [None, None, None]):
            x, y, z = entry["position"].numbers(3)
            seen.append(HandleTarget(point, (x, y, z), weight, kind, turn, factor))
    return tuple(seen)


def _orientation(
    entry: JsonValue, point: int | SurfacePoint, faces: IntArray
) -> tuple[tuple[float, ...], ...] | None:
    """The orientation of a handle, as a matrix by rows; None where there is none."""
    if "orientation" not in entry or entry["orientation"].value is None:
        return None
    value = entry["orientation"]
    rows = value.rotation()
    if isinstance(point, SurfacePoint) and point.offset:
        raise InputError(
            f"{value}: the point is off the surface, and only points on it have one; remove the "
            "offset or the orientation"
        )
    if isinstance(point, int) and len(faces) and not np.any(np.asarray(faces) == point):
        raise InputError(
            f"{value}: vertex {point} has no faces around it, and nothing that could turn; remove "
            "the orientation"
        )
    return rows


def _point(entry: JsonValue, vertex_count: int, faces: IntArray) -> SurfacePoint:
    """The place of a handle on the mesh."""
    offset = entry["offset"].number(least=-LARGEST, most=LARGEST) if "offset" in entry else 0.0
    if "face" not in entry:
        return SurfacePoint((entry["vertex"].integer(0, vertex_count - 1),), offset=offset)
    if not len(faces):
        raise entry["face"].error("a vertex, for the mesh has no faces", "give a vertex")
    face = entry["face"].integer(0, len(faces) - 1)
    barycentric = entry["barycentric"].numbers(3)
    try:
        return SurfacePoint.on_face(faces, face, barycentric, offset)
    except InputError as error:
        raise InputError(f"{entry}: {error}") from None
