"""A field for a number that may have a fraction."""

from __future__ import annotations

import math
from typing import cast

from PySide6.QtCore import QLocale, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QKeyEvent, QMouseEvent
from PySide6.QtWidgets import QDoubleSpinBox

_STEPS = (Qt.Key.Key_Up, Qt.Key.Key_Down, Qt.Key.Key_PageUp, Qt.Key.Key_PageDown)

_DIGITS = 4  # of a body of size 1, after the point
_MOST_DIGITS = 12
_STEP = 0.002  # of a body's size


class NumberField(QDoubleSpinBox):
    """A number that is typed with a point or a comma, in any country.

    Qt takes the comma of an English system, and the point of a German one, for a separator of
    thousands and drops it: 0,5 would become 5.

    Args:
        least, most: smallest and largest value.
        decimals: digits after the point; see `fit_size` for those of a place.

    Attributes:
        settled: signal after a number that has been typed, and after the steps of an arrow or a key
            once it is let go of; `valueChanged` is for each step.
    """

    settled = Signal()

    def __init__(self, least: float, most: float, decimals: int = 4) -> None:
        """Start at 0, or at the nearest value to it."""
        super().__init__()
        self.setLocale(QLocale.c())
        self.setRange(least, most)
        self.setDecimals(decimals)
        self.setKeyboardTracking(False)  # the value changes once all of it has been typed
        self._held = self._changed = False
        self.valueChanged.connect(self._note)
        self.editingFinished.connect(self._settle)

    def fit_size(self, size: float) -> None:
        """Take digits and steps for places in a body of a size, whatever its units."""
        self.setDecimals(min(max(_DIGITS - math.floor(math.log10(size)), 0), _MOST_DIGITS))
        self.setSingleStep(_STEP * size)

    @property
    def being_typed(self) -> bool:
        """True while the user types another value."""
        return self.lineEdit().isModified()

    def show_value(self, value: float) -> None:
        """Show a value without a signal."""
        with QSignalBlocker(self):
            self.setValue(value)

    def _note(self) -> None:
        self._changed = True

    def _settle(self) -> None:
        changed, self._held, self._changed = self._changed, False, False
        self.lineEdit().setModified(False)
        if changed:
            self.settled.emit()

    def stepBy(self, steps: int) -> None:
        """Go on by steps."""
        super().stepBy(steps)
        if not self._held:  # the wheel
            self._settle()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Hold an arrow."""
        self._held = True
        super().mousePressEvent(event)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """Let go of an arrow."""
        super().mouseReleaseEvent(event)
        self._settle()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Hold a key that steps, or type."""
        self._held = self._held or event.key() in _STEPS
        super().keyPressEvent(event)

    def keyReleaseEvent(self, event: QKeyEvent) -> None:
        """Let go of a key that steps."""
        super().keyReleaseEvent(event)
        if event.key() in _STEPS and not event.isAutoRepeat():
            self._settle()

    def validate(self, input: str, pos: int) -> object:
        """Turn commas into points."""
        return super().validate(input.replace(",", "."), pos)

    def valueFromText(self, text: str) -> float:
        """Return the number in a text."""
        return cast(float, super().valueFromText(text.replace(",", ".")))
