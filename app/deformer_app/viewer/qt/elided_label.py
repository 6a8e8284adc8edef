"""A line of text that ends in dots where there is no room for all of it."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import QLabel


class ElidedLabel(QLabel):
    """A label that may be narrower than its text; the tool tip then has all of it."""

    def __init__(self) -> None:
        """Start empty."""
        super().__init__()
        self.setTextFormat(Qt.TextFormat.PlainText)

    def minimumSizeHint(self) -> QSize:
        """Return the smallest size, which has room for a few letters."""
        few = self.fontMetrics().averageCharWidth() * 4
        return super().minimumSizeHint().boundedTo(QSize(few, 1 << 20))

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw as much of the text as there is room for."""
        room = self.contentsRect()
        shown = self.fontMetrics().elidedText(
            self.text(), Qt.TextElideMode.ElideRight, room.width()
        )
        self.setToolTip("" if shown == self.text() else self.text())
        painter, palette = QPainter(self), self.palette()
        self.style().drawItemText(
            painter,
            room,
            int(self.alignment()),
            palette,
            self.isEnabled(),
            shown,
            self.foregroundRole(),
        )
