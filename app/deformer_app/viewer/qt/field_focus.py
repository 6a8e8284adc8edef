"""Fields and buttons give the keyboard back to the picture once they have been used."""

from __future__ import annotations

from typing import cast

from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSpinBox,
    QDoubleSpinBox,
    QLineEdit,
    QMainWindow,
    QSpinBox,
    QWidget,
)
from shiboken6 import isValid

from deformer_app.viewer.qt.application_filter import ApplicationFilter

_LEAVE = (Qt.Key.Key_Return, Qt.Key.Key_Enter, Qt.Key.Key_Escape)


class FieldFocus(ApplicationFilter):
    """Moves the focus to the picture from a field after Enter or Esc, from a button after a click.

    Letters, digits and the space bar are keys of actions again then. Esc drops the number that is
    being typed. Fields of dialogs and the
    editors of lists keep their own ways; a button that Tab has led to keeps the space bar.

    Args:
        window: fields and buttons of its own are watched, not those of its dialogs.
        picture: gets the focus.
    """

    def __init__(self, window: QMainWindow, picture: QWidget) -> None:
        """Watch the application's events as long as the window lives."""
        super().__init__(window)
        self._window, self._picture = window, picture

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Let the field have the key's release only after the focus has gone."""
        if (
            event.type() == QEvent.Type.KeyRelease
            and isinstance(event, QKeyEvent)
            and event.key() in _LEAVE
            and not event.isAutoRepeat()
            and isinstance(watched, (QAbstractSpinBox, QLineEdit))
            and self._is_ours(watched)
        ):
            if event.key() == Qt.Key.Key_Escape:
                _drop_typed(watched)
            self._picture.setFocus()
        if (
            event.type() == QEvent.Type.MouseButtonRelease
            and isinstance(watched, QAbstractButton)
            and watched.window() is self._window
        ):
            # Afterwards: a button that loses the focus while it is down is not clicked.
            QTimer.singleShot(0, lambda: self._leave(watched))
        return False

    def _leave(self, button: QAbstractButton) -> None:
        """Take the focus from a button that has been clicked, or from where hiding has moved it."""
        gone = not isValid(button) or not button.isVisible()
        if gone or isinstance(self._window.focusWidget(), QAbstractButton):
            self._picture.setFocus()

    def _is_ours(self, field: QWidget) -> bool:
        above = field.parentWidget()
        in_list = above is not None and isinstance(above.parentWidget(), QAbstractItemView)
        return field.window() is self._window and not in_list


def _drop_typed(field: QWidget) -> None:
    """Show the value of a number in place of what is being typed."""
    if isinstance(field, (QSpinBox, QDoubleSpinBox)):
        cast(QDoubleSpinBox, field).setValue(field.value())
