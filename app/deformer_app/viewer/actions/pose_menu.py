"""Actions on poses: copy and paste, saved poses and their libraries."""

from __future__ import annotations

from collections.abc import Sequence

from deformer_app.viewer.actions.action import Action, Shell, unless_cancelled
from deformer_app.viewer.pose_commands import (
    copied,
    export_poses,
    import_poses,
    paste,
    paste_mirrored,
    save_pose,
)

_LIBRARIES = "Libraries of poses (*.json)"


def _copy(shell: Shell) -> None:
    shell.copy_text(copied(shell.editor))
    shell.editor.note("Copied the pose")


def _export(shell: Shell) -> None:
    path = shell.ask_save("Export saved poses", "poses.json", _LIBRARIES)
    unless_cancelled(path, lambda path: export_poses(shell.editor, path))


def _import(shell: Shell) -> None:
    path = shell.ask_open("Import poses", _LIBRARIES)
    unless_cancelled(path, lambda path: import_poses(shell.editor, path))


POSE_EDITS: Sequence[Action] = (
    Action("copy-pose", "Edit", "Copy pose", _copy, "Ctrl+C", "The one that is shown", rule=True,
           dialog=True),
    Action("paste-pose", "Edit", "Paste pose",
           lambda s: paste(s.editor, s.copied_text()), "Ctrl+V",
           "Start from the copied pose, in this window or another one", dialog=True),
    Action("paste-mirrored", "Edit", "Paste pose mirrored",
           lambda s: paste_mirrored(s.editor, s.copied_text()), "Ctrl+Shift+V",
           "What the right side does in the copied pose, the left does", dialog=True),
    Action("save-pose", "Edit", "Save pose", lambda s: save_pose(s.editor), "Ctrl+D",
           "Keep the present pose with the session, in the dock Poses"),
)  # fmt: skip

POSE_FILES: Sequence[Action] = (
    Action("export-poses", "File", "Export saved poses…", _export, "",
           "A library for other sessions of this model", dialog=True, rule=True),
    Action("import-poses", "File", "Import poses…", _import, "",
           "Those of a library", dialog=True),
)  # fmt: skip
