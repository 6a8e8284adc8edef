"""The fitted clip as a file: shapes, a handles file with frames, or pictures."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from deformer import (
    SEQUENCE_SUFFIXES,
    InputError,
    MeshSequence,
    check_shapes_output,
    io,
    save_shapes,
    vertex_normals,
)
from deformer_app.rendering.animation import check_animation_path
from deformer_app.rendering.offscreen import Picture
from deformer_app.viewer.edit import Handle
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.handle_rows import handle_rows
from deformer_app.viewer.timeline.clip_job import RELAXATION, FittedClip
from deformer_app.viewer.worker import in_background

MOVIES = (".gif", ".mp4")
CLIP_FILES = (
    f"Clips, caches, handles and animations "
    f"({' '.join(f'*{suffix}' for suffix in (*SEQUENCE_SUFFIXES, '.json', *MOVIES))})"
)


def export_clip(editor: Editor, path: Path) -> Iterator[None]:
    """Write the clip, once it is fitted, in the format of the suffix; a job of the editor.

    .json is a handles file with frames, as `deformer fit` reads it; .gif and .mp4 are pictures from
    the present camera; all else is written by `deformer.save_shapes`.

    Raises:
        InputError: there are no keys, the fit was cancelled, or the path cannot be written.
    """
    suffix, timeline = path.suffix.lower(), editor.timeline
    if suffix in MOVIES:
        check_animation_path(path)
    elif suffix != ".json":
        check_shapes_output(path)
    timeline.refit()
    while timeline.waiting:
        yield
    fitted = timeline.fitted
    if fitted is None:
        raise InputError(f"{path}: there is no fitted clip to write; set keys first")
    if suffix in MOVIES:
        yield from editor.filming.write(
            path, _pictures(editor, fitted), len(fitted.vertices), fitted.request.clip.fps
        )
        return
    editor.note(f"Writing {path} …")
    if suffix == ".json":
        frames = handle_frames(fitted, editor.edit.handles)
        io.write_json(path, {**frames, "fingerprint": editor.model.fingerprint})
    else:
        model, fps = editor.model, fitted.request.clip.fps
        shapes = MeshSequence(fitted.vertices, model.reference.faces)
        yield from in_background(
            lambda: save_shapes(path, shapes, like=model, fps=fps, up=model.up)
        )
    editor.note(f"Wrote {path}")


def handle_frames(fitted: FittedClip, named: Iterable[Handle]) -> dict[str, Any]:
    """The handles of every frame, and what else `deformer fit` needs for the same clip.

    Handles that are not seen in a frame have no position there.

    Args:
        fitted: the clip.
        named: the same handles with their names.

    Raises:
        InputError: the clip has no handles.
    """
    clip, names = fitted.request.clip, {handle.id: handle.name for handle in named}
    edit = fitted.request.edit
    edit = edit.with_handles(replace(h, name=names.get(h.id, "")) for h in edit.handles)
    if not edit.handles:
        raise InputError("the clip has sliders alone, and a handles file has handles; place some")
    owners = {vertex: handle.id for handle in edit.handles for vertex in handle.vertices}
    frames = []
    for frame in range(clip.length):
        rows = handle_rows(clip.at(edit, frame).handles)
        last = {row["vertex"]: row for row in rows}  # a file names a vertex once
        entries = []
        for vertex, row in last.items():
            track = clip.track(owners[vertex])
            seen = track is None or track.sees(frame)
            # Regions are those of single poses.
            kept = {key: value for key, value in row.items() if key != "region"}
            entries.append(kept if seen else {**kept, "position": None})
        frames.append(entries)
    bases = [list(clip.at(edit, frame).base) for frame in range(clip.length)]
    still = all(base == bases[0] for base in bases)
    means = {"mean": bases[0]} if still else {"means": bases}
    found: dict[str, Any] = {
        "frames": frames,
        "prior": {**means, "noise": edit.noise, "body": edit.body},
        "smoothness": clip.smoothness,
        "relaxation": RELAXATION,
        "key_frames": clip.posed_frames,
    }
    return found if edit.floor is None else {**found, "floor": edit.floor}


def _pictures(editor: Editor, fitted: FittedClip) -> Generator[Picture, None, None]:
    """Draw every frame without handles, onion skins and the orientation cube."""
    view, model, faces = editor.state.view, editor.model, editor.model.reference.faces
    timeline, onion = editor.timeline, editor.timeline.onion
    timeline.stop()
    timeline.set_onion(before=0, after=0)
    try:
        for shape in fitted.vertices:
            view.surface.move(shape, vertex_normals(shape, faces))
            view.overlays.hide_handles()
            view.surface.show_patches([])
            yield view.picture()
    finally:
        if editor.is_open and editor.model is model:
            timeline.set_onion(before=onion.before, after=onion.after)
            timeline.seek(timeline.frame)
            editor.state.invalidate()
