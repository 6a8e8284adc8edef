"""A field for a number that may have a fraction."""

from __future__ import annotations

import math
from typing import cast

from PySide6.QtCore import QLocale, QSignalBlocker, Signal
from PySide6.QtWidgets import QDoubleSpinBox

from deformer_app.viewer.qt.held import Held

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
        self._held = Held(self, self.settled.emit)
        self.valueChanged.connect(self._held.note)
        self.editingFinished.connect(self._finish)

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

    def _finish(self) -> None:
        self.lineEdit().setModified(False)
        self._held.let_go()

    def stepBy(self, steps: int) -> None:
        """Go on by steps."""
        super().stepBy(steps)
        self._held.settle()

    def validate(self, input: str, pos: int) -> object:
        """Turn commas into points."""
        return super().validate(input.replace(",", "."), pos)

    def valueFromText(self, text: str) -> float:
        """Return the number in a text."""
        return cast(float, super().valueFromText(text.replace(",", ".")))
