"""A line of text with buttons, upon the picture."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QToolButton,
)

from deformer_app.viewer.qt.icons import put_icon

_NARROW = 400  # pixels


class Strip(QFrame):
    """A line of text with buttons, hidden at first.

    Args:
        kind: names its colour, see `NOTICE`.
        buttons: title of each button, and what it does.
    """

    def __init__(self, kind: str, *buttons: tuple[str, Callable[[], Any]]) -> None:
        """Lay out."""
        super().__init__()
        self.setProperty("notice", kind)
        self._label = QLabel()
        self._label.setTextFormat(Qt.TextFormat.PlainText)  # a name or a path may look like HTML
        self._label.setWordWrap(True)
        self._label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.row = QHBoxLayout(self)
        self.row.setContentsMargins(12, 7, 8, 7)
        self.row.addWidget(self._label, 1)
        self._buttons: dict[str, QPushButton] = {}
        row = QHBoxLayout()
        for title, run in buttons:
            self._buttons[title] = button = QPushButton(title)
            button.clicked.connect(lambda _, f=run: f())
            row.addWidget(button)
        self.row.addLayout(row)
        self.hide()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Put the buttons below the text where it would have little room beside them."""
        super().resizeEvent(event)
        way = QHBoxLayout.Direction
        beside = not self._buttons or self.width() >= _NARROW
        self.row.setDirection(way.LeftToRight if beside else way.TopToBottom)

    @property
    def text(self) -> str:
        """The text of the line."""
        return self._label.text()

    def say(self, text: str) -> None:
        """Change the text of the line."""
        self._label.setText(text)

    def show_buttons(self, *titles: str) -> None:
        """Show the buttons of these titles alone."""
        for title, button in self._buttons.items():
            button.setVisible(title in titles)

    def read_html(self) -> None:
        """Take texts as HTML from now on: they are the program's own, and name nothing."""
        self._label.setTextFormat(Qt.TextFormat.RichText)

    def add_closing_mark(self, close: Callable[[], Any]) -> None:
        """Add a small cross at the right."""
        mark = QToolButton()
        put_icon(mark, "x")
        mark.setToolTip("Close  Esc")
        mark.clicked.connect(lambda _: close())
        self.row.addWidget(mark)

    def add_moving_bar(self) -> None:
        """Add a bar at the right that moves as long as the strip is shown."""
        bar = QProgressBar()
        bar.setRange(0, 0)
        bar.setFixedSize(120, 6)
        self.row.addWidget(bar)
