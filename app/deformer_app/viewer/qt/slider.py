"""Sliders over a linear or a geometric range."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtWidgets import QSlider

STEPS = 1000


class Slider(QSlider):
    """A slider with `STEPS` steps that tells a move from its end.

    Args:
        moved: called with the position, 0 to `STEPS`, while the user moves it.
        ended: called when the user lets go of it, and after each step of keys or wheel.
    """

    def __init__(self, moved: Callable[[int], Any], ended: Callable[[], Any]) -> None:
        """Start at the lower end."""
        super().__init__(Qt.Orientation.Horizontal)
        self._moved, self._ended = moved, ended
        self.setRange(0, STEPS)
        self.valueChanged.connect(self._change)
        self.sliderReleased.connect(ended)

    def _change(self, position: int) -> None:
        self._moved(position)
        if not self.isSliderDown():  # the wheel, the keys: one step each
            self._ended()

    def show_position(self, position: float) -> None:
        """Show a position without calling anything, unless the user holds the slider."""
        if not self.isSliderDown():
            with QSignalBlocker(self):
                self.setValue(round(position))


def geometric(position: int, low: float, high: float) -> float:
    """Return the value between `low` and `high` at a position of a geometric scale."""
    return low * (high / low) ** (position / STEPS)


def geometric_position(value: float, low: float, high: float) -> float:
    """Return the position of a value of a geometric scale from `low` to `high`."""
    return STEPS * math.log(value / low) / math.log(high / low)
