"""Exports of an editor: the pose, the handles, the picture."""

from __future__ import annotations

from pathlib import Path

from deformer import InputError, Mesh, io, save_mesh
from deformer_app.rendering.sheets import save_sheet
from deformer_app.viewer.editor import Editor


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


def export_handles(editor: Editor, path: str | Path) -> None:
    """Write the targets as `deformer fit` reads them.

    Raises:
        InputError: there are no handles.
    """
    # A vertex may belong to several handles; a file names it once.
    rows = list({row["vertex"]: row for row in editor.session.summary()["handles"]}.values())
    if not rows:
        raise InputError(f"{path}: there are no handles to write; place one first")
    io.write_json(path, {"handles": rows})


def save_screenshot(editor: Editor, path: str | Path) -> None:
    """Write the current picture with anti-aliasing."""
    save_sheet(Path(path), editor.state.view.picture())
