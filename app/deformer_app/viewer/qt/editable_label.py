"""A label whose text can be edited in its place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QEvent, Qt
from PySide6.QtGui import QKeyEvent, QMouseEvent, QResizeEvent
from PySide6.QtWidgets import QLabel, QLineEdit, QSizePolicy


class EditableLabel(QLabel):
    """A label with a field over it after a double click or F2.

    Return and leaving the field accept the text, Escape drops it.

    Args:
        changed: called with the text that the user has entered.
    """

    def __init__(self, changed: Callable[[str], Any]) -> None:
        """Start without a text."""
        super().__init__()
        self.setTextFormat(Qt.TextFormat.PlainText)  # a name may look like HTML
        self._changed = changed
        self._text = self._placeholder = ""
        self.field: QLineEdit | None = None
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.setFocusPolicy(Qt.FocusPolicy.ClickFocus)

    def show_text(self, shown: str, edited: str, placeholder: str = "") -> None:
        """Show a text.

        Args:
            shown: in the label.
            edited: in the field, at first.
            placeholder: in the field while it is empty.
        """
        self._text, self._placeholder = edited, placeholder
        self.setText(shown)

    def begin(self) -> None:
        """Let the user edit the text."""
        if self.field is None:
            self.field = _Field(self, self._end)
            self.field.setGeometry(self.rect())
            self.field.setText(self._text)
            self.field.setPlaceholderText(self._placeholder)
            self.field.show()
            self.field.setFocus()
            self.field.selectAll()

    def _end(self, accepted: bool) -> None:
        field, self.field = self.field, None
        if field is not None:
            text = field.text()
            field.hide()
            field.deleteLater()
            if accepted:
                self._changed(text)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Begin to edit."""
        self.begin()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Begin to edit with F2."""
        if event.key() == Qt.Key.Key_F2:
            self.begin()
        else:
            super().keyPressEvent(event)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Keep the field over the label."""
        if self.field is not None:
            self.field.setGeometry(self.rect())


class _Field(QLineEdit):
    def __init__(self, parent: QLabel, end: Callable[[bool], Any]) -> None:
        super().__init__(parent)
        self._end = end
        self.editingFinished.connect(lambda: end(True))

    def event(self, event: QEvent) -> bool:
        """Drop the text with Escape, which is a key of the window elsewhere."""
        if isinstance(event, QKeyEvent) and event.key() == Qt.Key.Key_Escape:
            event.accept()
            if event.type() == QEvent.Type.KeyPress:
                self._end(False)
            return True
        return super().event(event)
