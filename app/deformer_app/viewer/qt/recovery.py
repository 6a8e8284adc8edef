"""The offer to go on with what a crash has left."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QWidget

from deformer import InputError
from deformer_app.viewer.qt.questions import ask
from deformer_app.viewer.qt.start_page import when
from deformer_app.viewer.session import Session


def offer_recovery(parent: QWidget, left: Path) -> str:
    """Ask what to do with an autosave, with its picture; return "Open", "Discard" or "Later".

    Args:
        parent: the window.
        left: the autosave; its picture has the same name with the ending ".png".
    """
    text = "The last session did not end well. Open what was saved of it?"
    picture = QPixmap(str(left.with_suffix(".png")))
    answers = "Open", "Discard", "Later"  # Esc, which is pressed without thought, keeps it
    return ask(parent, text, *answers, about=_described(left), picture=picture)


def _described(left: Path) -> str:
    """File, model, steps and time of an autosave; only the time if it is damaged."""
    lines = []
    with suppress(InputError):  # opening it tells what is wrong
        session = Session.load(left)
        steps = session.cursor
        if session.saved_as:
            lines.append(f"Session {Path(session.saved_as).name}")
        lines.append(f"Model {Path(session.model.path).name}, {steps} step{'s' * (steps != 1)}")
    lines.append(f"Saved {when(left.stat().st_mtime)}")
    return "\n".join(lines)
