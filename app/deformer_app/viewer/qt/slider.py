"""Sliders over a linear or a geometric range."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QEvent, QSignalBlocker, Qt
from PySide6.QtGui import QFocusEvent, QKeyEvent, QMouseEvent
from PySide6.QtWidgets import QSlider

STEPS = 1000


class Slider(QSlider):
    """A slider with `STEPS` steps that tells a move from its end.

    Args:
        moved: called with the position, 0 to `STEPS`, while the user moves it.
        ended: called when the user lets go of its handle or, where that has moved it, of its
            groove, of a key that has moved it, and after each step of the wheel.
    """

    def __init__(self, moved: Callable[[int], Any], ended: Callable[[], Any]) -> None:
        """Start at the lower end."""
        super().__init__(Qt.Orientation.Horizontal)
        self._moved, self._ended = moved, ended
        self._on_groove = self._paged = self._key_held = False
        self.setRange(0, STEPS)
        self.valueChanged.connect(self._change)
        self.sliderReleased.connect(ended)

    def _change(self, position: int) -> None:
        self._moved(position)
        if self._on_groove or self._key_held:  # Qt goes on and on, until it is let go of
            self._paged = True
        elif not self.isSliderDown():  # the wheel: one step each
            self._ended()

    def mousePressEvent(self, ev: QMouseEvent) -> None:
        """Take hold of the handle, or go by pages towards the mouse."""
        before, self._on_groove = self._on_groove, True  # the press already goes by a page
        super().mousePressEvent(ev)
        self._on_groove = not self.isSliderDown() if ev.isAccepted() else before
        self._paged = self._paged and self._on_groove

    def mouseReleaseEvent(self, ev: QMouseEvent) -> None:
        """Let go."""
        super().mouseReleaseEvent(ev)
        if not ev.buttons():
            self._let_go()

    def keyPressEvent(self, ev: QKeyEvent) -> None:
        """Hold a key that moves the handle."""
        self._key_held = True
        super().keyPressEvent(ev)

    def keyReleaseEvent(self, ev: QKeyEvent) -> None:
        """Let go of a key."""
        super().keyReleaseEvent(ev)
        if not ev.isAutoRepeat():
            self._let_go()

    def focusOutEvent(self, event: QFocusEvent) -> None:
        """Let go of a key, whose release goes to another widget."""
        super().focusOutEvent(event)
        self._let_go()

    def changeEvent(self, e: QEvent) -> None:
        """Let go where it is disabled: no release of the mouse follows."""
        super().changeEvent(e)
        if e.type() == QEvent.Type.EnabledChange:
            self._let_go()

    def _let_go(self) -> None:
        paged, self._paged = self._paged, False
        self._on_groove = self._key_held = False
        if paged:
            self._ended()

    def show_position(self, position: float) -> None:
        """Show a position without calling anything, unless the user holds the slider."""
        if not (self.isSliderDown() or self._on_groove or self._key_held):
            with QSignalBlocker(self):
                self.setValue(round(position))


def geometric(position: int, low: float, high: float) -> float:
    """Return the value between `low` and `high` at a position of a geometric scale."""
    return low * (high / low) ** (position / STEPS)


def geometric_position(value: float, low: float, high: float) -> float:
    """Return the position of a value of a geometric scale from `low` to `high`."""
    return STEPS * math.log(value / low) / math.log(high / low)
