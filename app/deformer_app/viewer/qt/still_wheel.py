"""The wheel changes no value that the mouse is only passing."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtWidgets import QAbstractSpinBox, QComboBox, QSlider

from deformer_app.viewer.qt.application_filter import ApplicationFilter

_VALUES = (QAbstractSpinBox, QComboBox, QSlider)


class StillWheel(ApplicationFilter):
    """Leaves the wheel to what is around a field, a list or a slider that has no focus.

    Qt would give it the focus and change its value: whoever scrolls a panel would change what lies
    under the mouse, without a notice, and the keys would be the field's from then on.
    """

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Take the focus by the wheel from a widget before it is shown, and then the wheel."""
        kind = event.type()
        if kind == QEvent.Type.Polish and isinstance(watched, _VALUES):
            if watched.focusPolicy() == Qt.FocusPolicy.WheelFocus:
                watched.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        elif kind == QEvent.Type.Wheel and isinstance(watched, _VALUES) and not watched.hasFocus():
            event.ignore()  # goes on to what is around it
            return True
        return False
