"""Keys that the widget with the focus needs itself, although an action or a dialog has them too."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent, QKeySequence
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSlider,
    QAbstractSpinBox,
    QPushButton,
    QToolButton,
)

from deformer_app.viewer.qt.application_filter import ApplicationFilter

_ARROWS = {Qt.Key.Key_Left, Qt.Key.Key_Right}
_SPACE = {Qt.Key.Key_Space}
_UNDO, _REDO = QKeySequence.StandardKey.Undo, QKeySequence.StandardKey.Redo
_RETURN = {Qt.Key.Key_Return, Qt.Key.Key_Enter}
_PLAIN = (Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.KeypadModifier)
_KEYS: tuple[tuple[type, set[Qt.Key]], ...] = (
    (QAbstractSlider, _ARROWS | {Qt.Key.Key_Home}),
    (QAbstractItemView, _ARROWS | _SPACE),
    (QAbstractButton, _SPACE),
)


class OwnKeys(ApplicationFilter):
    """Lets sliders and lists keep the arrows, sliders Home, lists the space bar, buttons Return.

    Qt asks the widget with the focus before it runs an action's shortcut; these widgets would not
    claim keys that they use. Return would press a dialog's default button only, if it has one. A
    field of a number would keep Ctrl+Z although nothing is being typed in it.
    """

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Claim a key for the widget that uses it, and press a button by Return."""
        if _undoes_nothing(watched, event):
            event.ignore()  # the action's
            return True
        if not isinstance(event, QKeyEvent) or event.modifiers() not in _PLAIN:
            return False
        if event.type() == QEvent.Type.ShortcutOverride:
            for kind, keys in _KEYS:
                if isinstance(watched, kind) and event.key() in keys:
                    event.accept()
                    return True
            return False
        pressed = event.type() == QEvent.Type.KeyPress and event.key() in _RETURN
        if pressed and isinstance(watched, (QPushButton, QToolButton)):
            if not event.isAutoRepeat():
                watched.click()
            return True
        return False


def _undoes_nothing(watched: QObject, event: QEvent) -> bool:
    """True for a key that undoes or redoes typing, where a number is not being typed."""
    return (
        event.type() == QEvent.Type.ShortcutOverride
        and isinstance(watched, QAbstractSpinBox)
        and isinstance(event, QKeyEvent)
        and (event.matches(_UNDO) or event.matches(_REDO))
        and not watched.lineEdit().isModified()
    )
