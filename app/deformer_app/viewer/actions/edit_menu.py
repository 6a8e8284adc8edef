"""Actions of the menu Edit: history, selection, where to start from."""

from __future__ import annotations

from collections.abc import Sequence

from deformer_app.viewer.actions.action import MESH_FILES, Action, Shell, unless_cancelled
from deformer_app.viewer.script import python_script


def _start_from_mesh(shell: Shell) -> None:
    unless_cancelled(
        shell.ask_open("Start from mesh", MESH_FILES), shell.editor.prior.start_from_mesh
    )


def _copy_as_python(shell: Shell) -> None:
    shell.copy_text(python_script(shell.editor))
    shell.editor.note("Copied: a Python script that makes this pose")


EDIT: Sequence[Action] = (
    Action("undo", "Edit", "Undo", lambda s: s.editor.undo(), "Ctrl+Z", tool="Undo",
           enabled=lambda e: e.is_open and e.session.can_undo),
    Action("redo", "Edit", "Redo", lambda s: s.editor.redo(), "Ctrl+Shift+Z",
           second_key="Ctrl+Y", tool="Redo",
           enabled=lambda e: e.is_open and e.session.can_redo),
    Action("history", "Edit", "History…", lambda s: s.history(), "Ctrl+H",
           "All steps; choosing one shows it", dialog=True),
    Action("copy-python", "Edit", "Copy as Python", _copy_as_python, "Ctrl+Shift+C",
           "A script that makes this pose, for the clipboard", dialog=True, rule=True),
    Action("select-all", "Edit", "Select all handles", lambda s: s.editor.handles.select_all(),
           "Ctrl+A", rule=True),
    Action("delete", "Edit", "Delete handles", lambda s: s.editor.handles.delete(), "Del",
           "The selected ones"),
    Action("clear", "Edit", "Clear handles", lambda s: s.editor.handles.clear(), "Ctrl+Del"),
    Action("reset", "Edit", "Reset to reference", lambda s: s.editor.prior.reset(), "Ctrl+0",
           "The undeformed shape, without handles", rule=True),
    Action("use-as-base", "Edit", "Start from this pose", lambda s: s.editor.prior.use_as_base(),
           "Ctrl+B", "From now on the prior keeps close to what is shown"),
    Action("start-from-mesh", "Edit", "Start from mesh…", _start_from_mesh, "",
           "The pose closest to a mesh of the same connectivity", dialog=True),
)  # fmt: skip
