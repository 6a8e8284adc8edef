"""The strip that tells of a solver that is being prepared, and of kernels that are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QTimer

import deformer
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.strip import Strip

_PATIENCE = 700  # milliseconds of preparation after which the user is told
_POLL = 200  # milliseconds between two looks
_PREPARING = "Preparing the solver. You can look around already."
_COMPILING = (
    "Compiling the solver for this processor, once after an installation: this takes a minute or "
    "two. You can look around already."
)


class PreparingStrip(Strip):
    """Shown while the solver of a model is being prepared, unless that takes a moment only.

    Args:
        changed: called when it appears, disappears or gets another text.
    """

    def __init__(self, changed: Callable[[], Any]) -> None:
        """Lay out, hidden."""
        super().__init__("waiting")
        self._changed = changed
        self._editor: Editor | None = None
        self._waited = 0
        self.add_moving_bar()
        self._timer = QTimer(self)
        self._timer.setInterval(_POLL)
        self._timer.timeout.connect(self._look)

    def follow(self, editor: Editor) -> None:
        """Watch the preparation of the model that has been opened."""
        self._editor, self._waited = editor, 0
        self._timer.start()

    def _look(self) -> None:
        assert self._editor is not None
        self._waited += _POLL
        preparing = self._editor.preparing
        if not preparing:
            self._timer.stop()
        text = _COMPILING if deformer.compiling() else _PREPARING
        shown = preparing and self._waited > _PATIENCE
        if (text, shown) != (self.text, not self.isHidden()):
            self.say(text)
            self.setVisible(shown)
            self._changed()
