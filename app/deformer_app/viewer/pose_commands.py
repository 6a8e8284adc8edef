"""Commands on saved poses: save, start from them, copy, paste, libraries."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deformer import InputError
from deformer_app.viewer.changes import PosesChanged
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.pose_files import (
    library_text,
    load_library,
    parse_library,
    save_library,
)
from deformer_app.viewer.poses import PoseShelf, SavedPose
from deformer_app.viewer.worker import in_background


def present_pose(editor: Editor, name: str) -> SavedPose:
    """Return the pose that is shown, with its handles.

    Raises:
        InputError: there is no pose yet.
    """
    if editor.preparing:
        raise InputError("The solver is still being prepared; try again in a moment")
    editor.wait_for_pose()
    return SavedPose(name, tuple(editor.code.tolist()), editor.edit.handles)


def change_poses(editor: Editor, change: Callable[[PoseShelf], Any]) -> None:
    """Change the saved poses of the session; no step of the history.

    Raises:
        InputError: what `change` raises.
    """
    change(editor.session.shelf)
    editor.announce(PosesChanged())


def save_pose(editor: Editor, name: str | None = None) -> SavedPose:
    """Save the pose that is shown in the session.

    Args:
        editor: whose pose it is.
        name: its name; None numbers it.

    Raises:
        InputError: there is no pose yet, or the name is none.
    """
    shelf = editor.session.shelf
    pose = present_pose(editor, shelf.next_name() if name is None else name)
    change_poses(editor, lambda shelf: shelf.add(pose))
    saved = shelf.poses[-1]
    editor.note(f"Saved “{saved.name}” with the session")
    return saved


def start_with_handles(editor: Editor, pose: SavedPose) -> None:
    """Start from a saved pose, with the handles that it was saved with in place of the present.

    A handle at the same vertices as a present one goes on as that, with its keys.
    """
    first = editor.session.next_id()
    present = {handle.vertices: handle.id for handle in editor.edit.handles}
    handles = tuple(
        replace(h, id=present.get(h.vertices, first + n)) for n, h in enumerate(pose.handles)
    )
    edit = replace(editor.edit, base=pose.code, handles=handles)
    editor.change(f"Start from {pose.name} with handles", edit)


def copied(editor: Editor, pose: SavedPose | None = None) -> str:
    """Return the clipboard's text of a pose; None takes the one that is shown."""
    pose = pose or present_pose(editor, "Copied pose")
    return library_text([pose], editor.session.model)


def paste(editor: Editor, text: str) -> None:
    """Start from the pose in the clipboard's text.

    Raises:
        InputError: it holds none of this model.
    """
    pose = parse_library(text, editor.model, editor.session.model)[0]
    editor.prior.start_at("Paste pose", pose.code)


def paste_mirrored(editor: Editor, text: str) -> None:
    """Start from the mirror image of the pose in the clipboard's text; a background job finds it.

    Raises:
        InputError: it holds none of this model.
    """
    plane, model = editor.mirror.plane, editor.model
    pose = parse_library(text, model, editor.session.model)[0]

    def paste() -> Iterator[None]:
        code = yield from in_background(lambda: plane.mirrored_code(np.array(pose.code)))
        if editor.model is model:
            editor.prior.start_at("Paste pose mirrored", code)

    editor.mirror.with_plane(lambda: editor.run(paste()))


def export_poses(editor: Editor, path: str | Path) -> None:
    """Write the session's saved poses as a library."""
    save_library(path, editor.session.shelf.poses, editor.session.model)
    editor.note(f"Wrote {path}")


def import_poses(editor: Editor, path: str | Path) -> None:
    """Add the poses of a library to those of the session.

    Raises:
        InputError: no library, a damaged one, or one of another model.
    """
    found = load_library(path, editor.model, editor.session.model)
    change_poses(editor, lambda shelf: [shelf.add(pose) for pose in found])
    editor.note(f"Added {len(found)} poses of {Path(path).name}")
