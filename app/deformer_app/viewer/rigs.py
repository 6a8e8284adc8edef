"""Rigs: handles that a model lays out, and handles of a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import deformer
from deformer import InputError, io
from deformer_app.viewer.edit import Edit, Handle, Solution, point
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.handle_rows import handles_of_rows
from deformer_app.viewer.worker import in_background


def place_rig(editor: Editor, count: int, symmetric: bool = False) -> None:
    """Place handles where they tell most; a background job chooses their vertices.

    Handles that are there stay, and count for the choice.

    Args:
        editor: the editor with its model.
        count: number of handles to place, of at least 1.
        symmetric: true for handles in left/right pairs or on the plane of symmetry.
    """
    model, present = editor.model, {v for handle in editor.edit.handles for v in handle.vertices}

    def choose() -> Iterator[None]:
        editor.note(f"Choosing vertices for {count} handles …")
        found = yield from in_background(
            lambda: deformer.layout(
                model, len(present) + count, fixed=sorted(present), symmetric=symmetric
            )
        )
        if editor.is_open and editor.model is model:
            vertices = [int(v) for v in found.vertices if v not in present]
            first = editor.session.next_id()
            _place(
                editor,
                "Place rig",
                [
                    editor.handles.on_surface(Handle(number, (v,), (point(editor.vertices[v]),)))
                    for number, v in enumerate(vertices, first)
                ],
            )
            left = found.expected[len(found.vertices)]
            editor.note(f"All vertices are now expected to be off by about {left:.3g}")

    editor.run(choose())


def load_handles(editor: Editor, path: str | Path) -> None:
    """Place the handles of a file, as of `deformer layout`, with their targets.

    A vertex that has a handle gets the target of the file's. A file with a prior or a start has the
    whole state of a pose, as `export_handles` writes it: it replaces what is there.

    Raises:
        InputError: no handles file of one pose, one of another model, or a handle that is not at a
            vertex.
    """
    model, edit = editor.model, editor.edit
    file = io.load_handles(path, len(model.reference.vertices), components=model.components)
    if file.is_sequence:
        raise InputError(
            f"{path}: has frames, expected the handles of one pose; load it by Timeline > Load "
            "sequence"
        )
    file.check_model(path, model.fingerprint)
    handles = handles_of_rows(path, file, editor.session.next_id())
    prior, start = file.prior, file.start
    if start is None and prior == io.HandlePrior() and file.floor is None:
        _place(editor, "Load handles", handles)
        editor.note_units()
        return
    loaded = Edit(
        edit.base if prior.mean is None else prior.mean,
        tuple(handles),
        edit.noise if prior.noise is None else prior.noise,
        edit.body if prior.body is None else prior.body,
        file.floor,
    )
    solution = None
    if start is not None:
        motion = point(start.rotation), point(start.translation)
        solution = Solution(start.z, *motion, final=False, contacts=start.contacts)
    editor.restore("Load handles", loaded, solution)
    editor.note_units()
    editor.handles.select([handle.id for handle in handles])


def _place(editor: Editor, label: str, handles: Sequence[Handle]) -> None:
    """Add handles, or replace those at the same vertices, as one step of the history."""
    ids = {h.vertices: h.id for h in editor.edit.handles}
    handles = [replace(h, id=ids.get(h.vertices, h.id)) for h in handles]
    editor.change(label, editor.edit.with_handles(handles))
    editor.handles.select([handle.id for handle in handles])
