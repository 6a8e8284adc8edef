"""The table of all actions with a menu entry or a key, shared by the Qt and the plain window."""

from __future__ import annotations

from collections.abc import Sequence

from deformer_app.viewer.actions.action import Action, Shell, carry_out
from deformer_app.viewer.actions.edit_menu import EDIT
from deformer_app.viewer.actions.file_menu import FILE
from deformer_app.viewer.actions.handles_menu import HANDLES
from deformer_app.viewer.actions.help_menu import HELP
from deformer_app.viewer.actions.pose_menu import POSE_EDITS
from deformer_app.viewer.actions.timeline_menu import TIMELINE
from deformer_app.viewer.actions.view_menu import VIEW

MENUS = ("File", "Edit", "Handles", "Timeline", "View", "Help")
ACTIONS: Sequence[Action] = (
    *FILE,
    *EDIT,
    *POSE_EDITS,
    *HANDLES,
    *TIMELINE,
    *VIEW,
    *HELP,
)

__all__ = ["ACTIONS", "MENUS", "Action", "Shell", "carry_out"]
