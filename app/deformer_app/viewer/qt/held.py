"""The many steps that a held key or button makes in a field or slider, as one change."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent, QMouseEvent
from PySide6.QtWidgets import QApplication, QDoubleSpinBox, QSlider

_Type = QEvent.Type


class Held(QObject):
    """Tells the end of a change of a widget's value: once no key or button is held any more.

    Args:
        widget: the field or slider, whose events are watched.
        ended: called after a change.

    Attributes:
        on: true while a key, or a button other than the right one, is held on the widget.
        start: the widget's value before it was taken hold of.
    """

    def __init__(self, widget: QDoubleSpinBox | QSlider, ended: Callable[[], Any]) -> None:
        """Watch the widget."""
        super().__init__(widget)
        self._widget, self._ended = widget, ended
        self.on = self._changed = False
        self.start = widget.value()
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Take hold before the widget changes its value, and let go."""
        kind = event.type()
        if kind == _Type.KeyPress:
            self._take()
        elif isinstance(event, QKeyEvent) and kind == _Type.KeyRelease:
            if not event.isAutoRepeat():
                self.let_go()
        elif isinstance(event, QMouseEvent) and kind != _Type.MouseMove:
            if kind == _Type.MouseButtonRelease:
                if not event.buttons():
                    self.let_go()
            elif event.button() != Qt.MouseButton.RightButton:  # a double click is a press, too
                self._take()
        elif kind == _Type.FocusOut:  # the release of a key goes to another widget
            if not QApplication.mouseButtons():
                self.let_go()
        elif kind == _Type.EnabledChange:  # no release follows
            self.let_go()
        return False

    def _take(self) -> None:
        if not self.on:
            self.on, self.start = True, self._widget.value()

    def note(self) -> None:
        """Note that the value has changed."""
        self._changed = True

    def settle(self) -> None:
        """End the change, unless something is held: each step of the wheel is one."""
        if not self.on:
            self.let_go()

    def let_go(self) -> None:
        """End the change, if there is one."""
        changed = self._changed
        self.forget()
        if changed:
            self._ended()

    def forget(self) -> None:
        """Hold nothing, and end no change."""
        self.on = self._changed = False
