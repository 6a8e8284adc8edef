"""A mark upon the window while something keeps it busy that cannot be done in the background."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import QApplication, QLabel, QMainWindow


class BusyMark(QLabel):
    """Text in the middle of a window, with the cursor of a clock.

    Args:
        window: what is busy.
    """

    def __init__(self, window: QMainWindow) -> None:
        """Start hidden."""
        super().__init__(window)
        self._window = window
        self.setProperty("notice", "waiting")
        self.setMargin(18)
        self.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.hide()

    @contextmanager
    def shown(self, text: str) -> Iterator[None]:
        """Show a text within the block; it is on the screen when the block begins."""
        self.setText(text)
        self.adjustSize()
        rect = self.rect()
        rect.moveCenter(self._window.rect().center())
        self.setGeometry(rect)
        self.show()
        self.raise_()
        self.repaint()
        # Qt may leave it to a later event, for which there is no time.
        QApplication.sendPostedEvents(self._window, QEvent.Type.UpdateRequest.value)
        QApplication.setOverrideCursor(Qt.CursorShape.WaitCursor)
        try:
            yield
        finally:
            QApplication.restoreOverrideCursor()
            self.hide()
