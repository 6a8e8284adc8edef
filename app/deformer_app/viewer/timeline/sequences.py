"""Sequences of files as keys: markers, or posed meshes by handles where they tell most."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import DeformationModel, InputError, io
from deformer_app.viewer.edit import Edit, Handle, Orientation, point
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.timeline.keys import LONGEST, Clip, Key, Placement, Track
from deformer_app.viewer.timeline.loaded_meshes import LoadedMeshes
from deformer_app.viewer.timeline.steps import change_state
from deformer_app.viewer.worker import in_background

SEQUENCE_FILES = "Sequences (*.npz *.glb *.gltf *.usd *.usda *.usdc *.mdd *.pc2 *.json)"
_HANDLES = 24  # that follow posed meshes
_SMOOTHNESS = 10.0  # of the fit of measurements, as `deformer fit` has it


def load_sequence(editor: Editor, path: Path) -> Iterator[None]:
    """Make a sequence the clip: soft handles with a key in each frame; a job of the editor.

    Markers of a handles file become handles of their own. Posed meshes are followed by handles that
    `deformer.layout` chooses, and shown translucently. Handles that are there stay; one at a vertex
    of the sequence follows it. A clip with keys stays as long as it is, if not longer.

    Raises:
        InputError: no sequence, one of another mesh, one whose axes are other ones than the
            model's, or one that is too long.
    """
    model, timeline = editor.model, editor.timeline
    fps = float(timeline.clip.fps)
    editor.note(f"Reading {path} …")
    if path.suffix.lower() == ".json":
        handles, tracks, frames = _markers(path, model, editor.session.next_id())
        loaded = None
    else:
        loaded = yield from in_background(lambda: LoadedMeshes.load(path, model, fps))
        shapes = loaded.shapes
        assert shapes is not None
        vertices = yield from in_background(lambda: _chosen(model))
        seen = shapes[:, vertices]
        yield from in_background(lambda: _check_axes(path, model, vertices, seen))
        handles, tracks = _followed(shapes, vertices, editor.session.next_id())
        frames = len(shapes)
    if not editor.is_open or editor.model is not model or editor.session.under_way:
        return
    _check_length(path, frames)
    handles, tracks = _reused(editor.edit, handles, tracks)
    timeline.loaded = loaded
    before, owners = timeline.clip, {track.owner for track in tracks}
    clip = replace(
        before,
        length=max(frames, before.length if before.tracks else 0),
        smoothness=_SMOOTHNESS,
        tracks=(*(t for t in before.tracks if t.owner not in owners), *tracks),
    )
    _open(editor, path, handles, clip)
    if before.tracks and before.smoothness != clip.smoothness:
        editor.note(
            f"Smooth is {clip.smoothness:g} now, for measurements; it was {before.smoothness:g}"
        )


def _open(editor: Editor, path: Path, handles: list[Handle], clip: Clip) -> None:
    """Add handles and a clip as one step of the history."""
    timeline = editor.timeline
    # As `deformer fit` does: about the mean of the examples, not about the reference.
    base = tuple(float(value) for value in editor.model.latent_mean)
    added: Edit = replace(editor.edit.with_handles(handles), base=base)
    if change_state(editor, f"Load {path.name}", clip.at(added, timeline.frame), clip):
        timeline.seek(timeline.frame)


def _markers(
    path: Path, model: DeformationModel, number: int
) -> tuple[list[Handle], list[Track], int]:
    """Handles, tracks and number of frames of a handles file with frames."""
    file = io.load_handles(path, len(model.reference.vertices), model.reference.faces)
    if not file.is_sequence:
        raise InputError(f"{path}: has one pose, expected frames; load it by File > Load handles")
    keys: dict[int, list[Key]] = {}
    handles: dict[int, Handle] = {}
    for f, frame in enumerate(file.frames):
        for n, row in enumerate(frame):
            if not isinstance(row.vertex, int):
                raise InputError(
                    f"{path}: frames[{f}][{n}]: is a point of a face or off the surface, and the "
                    "timeline takes vertices; name the nearest vertex, or use deformer fit"
                )
            x, y, z = row.position
            place = Placement(((x, y, z),), _orientation(row.orientation))
            keys.setdefault(row.vertex, []).append(Key(f, place, "linear"))
            handles.setdefault(
                row.vertex,
                Handle(
                    number + len(handles),
                    (row.vertex,),
                    place.targets,
                    row.kind,
                    row.weight,
                    orientation=place.orientation,
                    orientation_weight=row.orientation_weight,
                    name=row.name,
                ).at(place.targets, [row.gap]),
            )
    seen = np.full((len(file.frames), len(keys), 3), np.nan)
    column = {vertex: n for n, vertex in enumerate(keys)}
    for f, frame in enumerate(file.frames):
        for row in frame:
            if isinstance(row.vertex, int):
                seen[f, column[row.vertex]] = row.position
    _check_axes(path, model, list(keys), seen)
    tracks = [Track(h.id, tuple(keys[v]), measured=True) for v, h in handles.items()]
    return list(handles.values()), tracks, len(file.frames)


def _orientation(rotation: tuple[tuple[float, ...], ...] | None) -> Orientation | None:
    if rotation is None:
        return None
    x, y, z = (point(row) for row in rotation)
    return (x, y, z)


def _chosen(model: DeformationModel) -> list[int]:
    """Vertices where handles tell most."""
    count = min(_HANDLES, len(model.reference.vertices))
    return [int(v) for v in deformer.layout(model, count).vertices]


def _check_axes(
    path: Path, model: DeformationModel, vertices: list[int], targets: NDArray[np.float64]
) -> None:
    """Refuse targets (F, H, 3) of other axes than the model's: the body would collapse on them."""
    warning = deformer.axis_warning(model, vertices, targets)
    if warning:
        raise InputError(f"{path}: {warning}")


def _followed(
    shapes: NDArray[np.float64], vertices: list[int], number: int
) -> tuple[list[Handle], list[Track]]:
    """Handles at vertices, and their tracks through shapes (F, V, 3)."""
    handles, tracks = [], []
    for n, vertex in enumerate(vertices):
        path = [(point(p),) for p in shapes[:, vertex]]
        handles.append(Handle(number + n, (vertex,), path[0]))
        keys = tuple(Key(f, Placement(at), "linear") for f, at in enumerate(path))
        tracks.append(Track(number + n, keys, measured=True))
    return handles, tracks


def _reused(
    edit: Edit, handles: list[Handle], tracks: list[Track]
) -> tuple[list[Handle], list[Track]]:
    """Give handles and tracks the ids, and the unnamed the names, of handles at their vertices."""
    there = {handle.vertices: handle for handle in edit.handles}
    same = {h.id: there[h.vertices] for h in handles if h.vertices in there}
    return (
        [
            replace(h, id=same[h.id].id, name=h.name or same[h.id].name) if h.id in same else h
            for h in handles
        ],
        [replace(t, owner=same[t.owner].id) if t.owner in same else t for t in tracks],
    )


def _check_length(path: Path, frames: int) -> None:
    if frames > LONGEST:
        raise InputError(
            f"{path}: {frames} frames, and a clip has {LONGEST} at most; use deformer fit"
        )
