"""Steps of an editor's history that change its keys, and the pose of a frame that is shown."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deformer_app.viewer.changes import HandlesChanged, HistoryChanged
from deformer_app.viewer.edit import Edit, Solution
from deformer_app.viewer.timeline.keys import Clip

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor


def change_clip(editor: Editor, label: str, clip: Clip) -> bool:
    """Make other keys the next step of the history; return False if nothing is different."""
    changed = not editor.session.under_way and editor.session.change_clip(label, clip)
    if changed:
        editor.announce(HistoryChanged())
    return changed


def change_state(editor: Editor, label: str, edit: Edit, clip: Clip) -> bool:
    """Make a state with its keys the next step; return False if nothing is different."""
    editor.session.change(edit)
    editor.state.forget_missing(edit.handles)
    changed = editor.session.commit(label, clip=clip) or change_clip(editor, label, clip)
    editor.ask()
    editor.announce(HistoryChanged(), HandlesChanged())
    return changed


def solve_shown(editor: Editor, solution: Solution | None) -> None:
    """Solve for the present state, or show the pose of a solution that is known."""
    if solution is not None:
        editor.session.show_solution(solution)
    editor.ask(solution)
