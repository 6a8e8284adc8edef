"""Rigs: handles that a model lays out, and handles of a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import deformer
from deformer import InputError, io
from deformer_app.viewer.edit import Handle, point
from deformer_app.viewer.editor import Editor
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
            _place(editor, "Place rig", vertices, editor.vertices[vertices])
            left = found.expected[len(found.vertices)]
            editor.note(f"All vertices are now expected to be off by about {left:.3g}")

    editor.run(choose())


def load_handles(editor: Editor, path: str | Path) -> None:
    """Place the handles of a file, as of `deformer layout`, with their targets.

    A vertex that has a handle gets the target of the file's.

    Raises:
        InputError: no handles file of one pose, or a handle that is not at a vertex.
    """
    file = io.load_handles(path, len(editor.model.reference.vertices))
    if file.is_sequence:
        raise InputError(f"{path}: has frames, expected the handles of one pose; give another file")
    rows = file.frames[0]
    for n, row in enumerate(rows):
        if not isinstance(row.vertex, int):
            raise InputError(
                f"{path}: handles[{n}]: has an offset, expected a vertex alone; remove the offset"
            )
    options = [
        {
            "kind": row.kind,
            "weight": row.weight,
            "orientation": row.orientation,
            "orientation_weight": row.orientation_weight,
        }
        for row in rows
    ]
    vertices = [row.vertex for row in rows if isinstance(row.vertex, int)]
    _place(editor, "Load handles", vertices, [row.position for row in rows], options)


def _place(
    editor: Editor,
    label: str,
    vertices: Sequence[int],
    targets: Any,
    options: Sequence[dict[str, Any]] | None = None,
) -> None:
    """Add handles, or replace those at the same vertices, as one step of the history."""
    ids = {h.vertices[0]: h.id for h in editor.edit.handles if len(h.vertices) == 1}
    number = editor.session.next_id()
    handles = []
    for n, (vertex, target) in enumerate(zip(vertices, targets, strict=True)):
        handle = Handle(ids.get(vertex, number + n), (vertex,), (point(target),))
        handles.append(handle if options is None else replace(handle, **options[n]))
    editor.change(label, editor.edit.with_handles(handles))
    editor.select([handle.id for handle in handles])
