"""Actions of the menu Help."""

from __future__ import annotations

from collections.abc import Sequence

from deformer_app.viewer.actions.action import Action, always

HELP: Sequence[Action] = (
    Action("help", "Help", "Keys and mouse", lambda s: s.help(), "F1", enabled=always),
    Action("tour", "Help", "Tour", lambda s: s.begin_tour(), "", enabled=always),
    Action("about", "Help", "About Deformer", lambda s: s.about(), "",
           "Version, licences, and the card of the model", enabled=always, dialog=True, rule=True),
)  # fmt: skip
