"""A field for a number that may have a fraction."""

from __future__ import annotations

from typing import cast

from PySide6.QtCore import QLocale, QSignalBlocker
from PySide6.QtWidgets import QDoubleSpinBox


class NumberField(QDoubleSpinBox):
    """A number that is typed with a point or a comma, in any country.

    Qt takes the comma of an English system, and the point of a German one, for a separator of
    thousands and drops it: 0,5 would become 5.

    Args:
        least, most: smallest and largest value.
        decimals: digits after the point.
    """

    def __init__(self, least: float, most: float, decimals: int) -> None:
        """Start at 0, or at the nearest value to it."""
        super().__init__()
        self.setLocale(QLocale.c())
        self.setRange(least, most)
        self.setDecimals(decimals)
        self.setKeyboardTracking(False)  # the value changes once all of it has been typed
        self.editingFinished.connect(lambda: self.lineEdit().setModified(False))

    @property
    def being_typed(self) -> bool:
        """True while the user types another value."""
        return self.lineEdit().isModified()

    def show_value(self, value: float) -> None:
        """Show a value without a signal."""
        with QSignalBlocker(self):
            self.setValue(value)

    def validate(self, input: str, pos: int) -> object:
        """Turn commas into points."""
        return super().validate(input.replace(",", "."), pos)

    def valueFromText(self, text: str) -> float:
        """Return the number in a text."""
        return cast(float, super().valueFromText(text.replace(",", ".")))
