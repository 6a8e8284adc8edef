"""A call that follows a while after the first of several requests."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject, QTimer


def later(parent: QObject, milliseconds: int, run: Callable[[], object]) -> QTimer:
    """Return a timer whose `start` has `run` called once, so many milliseconds later."""
    timer = QTimer(parent)
    timer.setSingleShot(True)
    timer.setInterval(milliseconds)
    timer.timeout.connect(run)
    return timer
