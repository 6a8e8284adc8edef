"""The format of handles files: targets of one pose or of a sequence, and what else a pose needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from deformer.checks import LARGEST, checked_instance, checked_integer, shortened
from deformer.errors import InputError
from deformer.geometry import MOST_ORIENTATION_WEIGHT, IntArray, SurfacePoint, plain_point
from deformer.io.atomic import PathLike
from deformer.io.file_kinds import expecting
from deformer.io.json_pieces import read_pieces
from deformer.io.json_values import JsonValue
from deformer.io.stored_frames import StoredFrames
from deformer.workspace import Workspace

# Optional keys of a handle, and those that only the handles of one pose may have.
_OPTIONAL = ("offset", "weight", "kind", "orientation", "orientation_weight", "gap", "name")
_OF_ONE_POSE = ("region",)
_OF_SEQUENCES = ("smoothness", "relaxation", "key_frames")
# The most rounds of relaxation of a frame: each costs a solve.
_MOST_RELAXATION = 1000
HandleKind = Literal["soft", "exact", "pin"]
HandleBody = Literal["auto", "stays", "moves"]
"""How free the whole body is, as `deformer.Body`."""


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
        gap: vector from where the code's shape is to be to the position, in the mesh's units.
        region: which of the file's regions the handle belongs to; None for a handle on its own.
        name: for people; empty without one.
    """

    vertex: int | SurfacePoint
    position: tuple[float, float, float]
    weight: float = 1.0
    kind: HandleKind = "soft"
    orientation: tuple[tuple[float, ...], ...] | None = None
    orientation_weight: float = 1.0
    gap: tuple[float, float, float] = (0.0, 0.0, 0.0)
    region: int | None = None
    name: str = ""


@dataclass(frozen=True)
class HandlePrior:
    """The prior of a pose or of a sequence, as far as it is not the model's.

    Args:
        mean: (K,) latent code of the pose without handles; None is the model's mean.
        means: such a code for each frame of a sequence, in place of `mean`; None for one alone.
        noise: σ of a handle fit, in bounding diagonals; None is the model's.
        body: how far the body may turn and travel; None is as the training shapes do.
    """

    mean: tuple[float, ...] | None = None
    noise: float | None = None
    body: HandleBody | None = None
    means: tuple[tuple[float, ...], ...] | None = None


@dataclass(frozen=True)
class HandleStart:
    """The solution that a fit starts from.

    Args:
        z: (K,) latent code.
        rotation: (3,) rotation vector of the rigid motion, in radians.
        translation: (3,) of the rigid motion, in the mesh's units.
        contacts: vertices by which the shape stands on the floor.
    """

    z: tuple[float, ...]
    rotation: tuple[float, ...] = (0.0, 0.0, 0.0)
    translation: tuple[float, ...] = (0.0, 0.0, 0.0)
    contacts: tuple[int, ...] = ()


@dataclass(frozen=True)
class HandleFile:
    """Contents of a handles file.

    Args:
        frames: the handles of every frame; one frame for a single pose.
        is_sequence: true if the file has frames, false if it has a single pose.
        noise: standard deviation of each of the positions' coordinates, in the units of the mesh;
            None if the file does not tell it.
        regions: vertices of the painted regions that handles belong to.
        prior: the prior of the pose, or of all frames.
        start: the solution to start from; None for a fit that tries several starts.
        floor: height of the floor along the model's up axis, in the data's units; None without one.
        fingerprint: of the model that the codes belong to (`DeformationModel.fingerprint`); None
            if the file does not tell it.
        smoothness: of a sequence, as in `fit_sequence`; None if the file does not tell it.
        relaxation: of a sequence, as in `fit_sequence`; None if the file does not tell it.
        key_frames: of a sequence, as in `fit_sequence`; None if the file does not tell them.
    """

    frames: Sequence[tuple[HandleTarget, ...]]
    is_sequence: bool
    noise: float | None = None
    regions: tuple[tuple[int, ...], ...] = ()
    prior: HandlePrior = HandlePrior()
    start: HandleStart | None = None
    floor: float | None = None
    fingerprint: str | None = None
    smoothness: float | None = None
    relaxation: int | None = None
    key_frames: tuple[int, ...] | None = None

    def check_model(self, path: PathLike, fingerprint: str) -> None:
        """Raise InputError if the codes of this file are those of another model.

        Args:
            path: the file, for the message.
            fingerprint: of the model in use.
        """
        if self.fingerprint not in (None, fingerprint):
            raise InputError(
                f"{path}: fingerprint: its codes belong to another model ({self.fingerprint}) than "
                f"this one ({fingerprint}); give that model, or remove fingerprint, prior and start"
            )


def load_handles(
    path: PathLike,
    vertex_count: int,
    faces: IntArray | None = None,
    components: int | None = None,
    workspace: Workspace | None = None,
) -> HandleFile:
    """Load handle targets for one pose or for a sequence.

    Args:
        path: JSON `{"handles": [{"vertex": 17, "position": [x, y, z]}, …]}`, or `{"frames":
            [[…handles…], …]}`. In place of "vertex" a handle may have "face" and "barycentric": a
            point of that face. It may also have "offset" (distance from the surface along the
            normal), "weight", "kind" ("soft", "exact" or "pin"), "orientation" (of the surface
            relative to the reference: a unit quaternion [w, x, y, z], a rotation matrix by rows,
            or null), "orientation_weight", "gap" and "name" (for people). A handle whose position
            is null, or three nulls, is not seen, and left out; a frame may be empty. Beside
            "handles" or "frames" there may be "noise", the standard deviation of all positions'
            coordinates, "prior", "floor" and "fingerprint" (`HandleFile`). One pose may have
            "start", "regions" (lists of vertices), and handles with "region" (an index into them);
            frames "smoothness", "relaxation" and "key_frames" (indices of frames).
        vertex_count: number of vertices of the mesh.
        faces: (F, 3) its faces; None refuses points of faces.
        components: length K of the model's codes; None leaves it open.
        workspace: where the frames of a sequence are; None has them in memory.

    Raises:
        InputError: a key or value is missing or wrong, or no handle is seen at all; the message
            names frame and handle.
    """
    checked_integer(vertex_count, "vertex_count", least=0)
    if components is not None:
        checked_integer(components, "components", least=1)
    if workspace is not None:
        checked_instance(workspace, "workspace", Workspace, remedy="make a Workspace")
    with expecting(path, "handles"):
        return _load(path, vertex_count, faces, components, workspace)


def _load(
    path: PathLike,
    vertex_count: int,
    faces: IntArray | None,
    components: int | None,
    workspace: Workspace | None,
) -> HandleFile:
    """Do what `load_handles` does, whose arguments are checked."""
    rows = np.empty((0, 3), dtype=np.int64) if faces is None else faces
    found = [] if workspace is None else StoredFrames(workspace)
    seen = False

    def read(handles: JsonValue) -> None:
        nonlocal seen
        frame = _frame(handles, vertex_count, rows, None)
        seen = seen or bool(frame)
        found.append(frame)

    data = read_pieces(path, "frames", read)
    if ("handles" in data) == ("frames" in data):
        raise InputError(
            f"{path}: has keys {shortened(sorted(data.value))}, expected either 'handles' or "
            "'frames'; give one"
        )
    is_sequence = "frames" in data
    if is_sequence and not found:
        data["frames"].items()
        raise data["frames"].error("a list of frames")
    for key in ("start", "regions") if is_sequence else _OF_SEQUENCES:
        if key in data:
            has, other = ("frames", "one pose") if is_sequence else ("one pose", "a sequence")
            raise InputError(f"{data[key]}: the file has {has}, and only {other} has it; remove it")
    regions = _regions(data, vertex_count)
    if not is_sequence:
        found = [_frame(data["handles"], vertex_count, rows, len(regions))]
        seen = bool(found[0])
    if not seen:
        where = data["frames" if is_sequence else "handles"]
        raise InputError(
            f"{where}: no handle has a position, expected at least one handle that does; add one"
        )
    noise = data["noise"].number(above=0, most=LARGEST) if "noise" in data else None
    prior = _prior(data, components, len(found) if is_sequence else None)
    start = _start(data, vertex_count, components)
    if noise is not None and prior.noise is not None:
        raise InputError(
            f"{data['prior']['noise']}: the file also has noise, that of the positions; remove one"
        )
    fingerprint = data["fingerprint"].text() if "fingerprint" in data else None
    floor = data["floor"].number(least=-LARGEST, most=LARGEST) if "floor" in data else None
    smoothness, relaxation = None, None
    if "smoothness" in data:
        smoothness = data["smoothness"].number(least=0, most=LARGEST)
    if "relaxation" in data:
        relaxation = data["relaxation"].integer(0, _MOST_RELAXATION)
    key_frames = None
    if "key_frames" in data:
        key_frames = tuple(data["key_frames"].integers(0, len(found) - 1))
    beside = floor, fingerprint, smoothness, relaxation, key_frames
    frames = tuple(found) if isinstance(found, list) else found
    return HandleFile(frames, is_sequence, noise, regions, prior, start, *beside)


def _regions(data: JsonValue, vertex_count: int) -> tuple[tuple[int, ...], ...]:
    if "regions" not in data:
        return ()
    found = []
    for region in data["regions"].items():
        vertices = region.integers(0, vertex_count - 1)
        if not vertices:
            raise region.error("a list of at least one vertex")
        found.append(tuple(vertices))
    return tuple(found)


def _prior(data: JsonValue, components: int | None, frames: int | None) -> HandlePrior:
    """The prior; `frames` counts the file's, None for one pose."""
    if "prior" not in data:
        return HandlePrior()
    prior, means = data["prior"], None
    prior.check_keys((), ("mean", "noise", "body", *(("means",) if frames is not None else ())))
    if "means" in prior:
        if "mean" in prior:
            raise InputError(f"{prior['means']}: the prior also has mean; remove one")
        rows = prior["means"].items(frames)
        means = tuple(row.numbers(components, largest=LARGEST) for row in rows)
    return HandlePrior(
        prior["mean"].numbers(components, largest=LARGEST) if "mean" in prior else None,
        prior["noise"].number(above=0, most=LARGEST) if "noise" in prior else None,
        prior["body"].choice(get_args(HandleBody)) if "body" in prior else None,
        means,
    )


def _start(data: JsonValue, vertex_count: int, components: int | None) -> HandleStart | None:
    if "start" not in data:
        return None
    start = data["start"]
    start.check_keys(("z",), ("rotation", "translation", "contacts"))
    motion = {
        key: start[key].numbers(3, largest=LARGEST)
        for key in ("rotation", "translation")
        if key in start
    }
    contacts = start["contacts"].integers(0, vertex_count - 1) if "contacts" in start else ()
    z = start["z"].numbers(components, largest=LARGEST)
    return HandleStart(z, **motion, contacts=tuple(contacts))


def _frame(
    handles: JsonValue, vertex_count: int, faces: IntArray, regions: int | None
) -> tuple[HandleTarget, ...]:
    """The handles of a frame that are seen; `regions` counts the file's, None for a sequence."""
    seen: list[HandleTarget] = []
    points: dict[tuple[int | SurfacePoint, int | None], int] = {}
    optional = _OPTIONAL if regions is None else (*_OPTIONAL, *_OF_ONE_POSE)
    for n, entry in enumerate(handles.items()):
        place = ("face", "barycentric") if "face" in entry else ("vertex",)
        entry.check_keys((*place, "position"), optional)
        point = plain_point(_point(entry, vertex_count, faces))
        weight = entry["weight"].number(above=0, most=LARGEST) if "weight" in entry else 1.0
        kind = entry["kind"].choice(get_args(HandleKind)) if "kind" in entry else "soft"
        region = None
        if "region" in entry:
            if not regions:
                raise entry["region"].error("no region, for the file has no regions", "remove it")
            region = entry["region"].integer(0, regions - 1)
        if (point, region) in points:
            what = f"vertex {point}" if isinstance(point, int) else "that point"
            what += "" if region is None else f" of region {region}"
            raise InputError(
                f"{entry}: {what} already has handle {points[point, region]}, expected each once; "
                "remove one"
            )
        points[point, region] = n
        turn = _orientation(entry, point, faces)
        name, most = "orientation_weight", MOST_ORIENTATION_WEIGHT
        factor = entry[name].number(above=0, most=most) if name in entry else 1.0
        if entry["position"].value not in (None, [None, None, None]):
            x, y, z = entry["position"].numbers(3)
            u, v, w = entry["gap"].numbers(3) if "gap" in entry else (0.0, 0.0, 0.0)
            gap = (u, v, w)
            title = entry["name"].text() if "name" in entry else ""
            seen.append(
                HandleTarget(point, (x, y, z), weight, kind, turn, factor, gap, region, title)
            )
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


def _point(entry: JsonValue, vertex_count: int, faces: IntArray) -> int | SurfacePoint:
    """The place of a handle on the mesh."""
    offset = entry["offset"].number(least=-LARGEST, most=LARGEST) if "offset" in entry else 0.0
    if "face" not in entry:
        vertex = entry["vertex"].integer(0, vertex_count - 1)
        return SurfacePoint((vertex,), offset=offset) if offset else vertex
    if not len(faces):
        raise entry["face"].error("a vertex, for the mesh has no faces", "give a vertex")
    face = entry["face"].integer(0, len(faces) - 1)
    barycentric = entry["barycentric"].numbers(3)
    try:
        return SurfacePoint.on_face(faces, face, barycentric, offset)
    except InputError as error:
        raise InputError(f"{entry}: {error}") from None
