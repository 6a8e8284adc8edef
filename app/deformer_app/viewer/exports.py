"""Exports of an editor: the pose, the handles, the picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from deformer import InputError, Mesh, io, save_mesh
from deformer_app.rendering.sheets import save_sheet
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.script import python_script
from deformer_app.viewer.session import Session

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp")


def export_pose(editor: Editor, path: str | Path) -> None:
    """Write the surface of the final pose as a mesh file, like the model's document.

    Raises:
        InputError: there is no pose yet.
    """
    if editor.preparing:
        raise InputError(f"{path}: the solver is still being prepared; try again in a moment")
    editor.wait_for_pose()
    mesh = Mesh(editor.vertices, editor.model.reference.faces)
    save_mesh(path, mesh, like=editor.model)
    editor.note(f"Wrote {path}")


def export_handles(editor: Editor, path: str | Path) -> None:
    """Write the handles, the prior and the pose's code: `deformer fit` makes the same pose of them.

    Raises:
        InputError: the name does not end in .json, there are no handles, or the solver is not
            prepared yet.
    """
    if Path(path).suffix.lower() != ".json":
        raise InputError(f"{path}: handles are written as JSON; give a name that ends in .json")
    if not editor.edit.handles:
        raise InputError(f"{path}: there are no handles to write; place one first")
    if editor.preparing:
        raise InputError(f"{path}: the solver is still being prepared; try again in a moment")
    editor.wait_for_pose()
    io.write_json(path, handles_file(editor.session))
    editor.note(f"Wrote {path}")


def handles_file(session: Session) -> dict[str, Any]:
    """Return the contents of a handles file with the whole state of a session's pose."""
    keys = ("handles", "regions", "prior", "start", "floor", "fingerprint")
    return {key: value for key, value in session.summary().items() if key in keys}


def export_script(editor: Editor, path: str | Path) -> None:
    """Write a Python script that makes the pose and saves it beside itself as a PLY file.

    Raises:
        InputError: the solver is not prepared yet.
    """
    text = python_script(editor, Path(path).with_suffix(".ply").name)
    with io.atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    editor.note(f"Wrote {path}")


def save_screenshot(editor: Editor, path: str | Path) -> None:
    """Write the current picture with anti-aliasing.

    Raises:
        InputError: the file's ending is not one of `PICTURE_SUFFIXES`.
    """
    suffix = Path(path).suffix
    if suffix.lower() not in PICTURE_SUFFIXES:
        raise InputError(
            f"{path}: a picture cannot be written as {suffix or 'a file without an ending'}; "
            f"use {', '.join(PICTURE_SUFFIXES)}"
        )
    save_sheet(Path(path), editor.state.view.picture())
    editor.note(f"Wrote {path}")
