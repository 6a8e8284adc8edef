"""Sliders over a linear or a geometric range."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QEvent, QPointF, QRect, QSignalBlocker, Qt
from PySide6.QtGui import QKeyEvent, QMouseEvent
from PySide6.QtWidgets import QSlider, QStyle, QStyleOptionSlider

from deformer_app.viewer.qt.held import Held

STEPS = 1000


class Slider(QSlider):
    """A slider with `STEPS` steps that tells a move from its end.

    A press beside the handle brings it to the mouse, and a drag goes on from there. Esc brings a
    handle that is held back to where it was; the window's Esc discards what it has changed.

    Args:
        moved: called with the position, 0 to `STEPS`, while the user moves it.
        ended: called when the user lets go of its handle or of a key that has moved it, and after
            each step of the wheel.
    """

    def __init__(self, moved: Callable[[int], Any], ended: Callable[[], Any]) -> None:
        """Start at the lower end."""
        super().__init__(Qt.Orientation.Horizontal)
        self._moved = moved
        self.setRange(0, STEPS)
        self._held = Held(self, ended)
        self.valueChanged.connect(self._change)

    def _change(self, position: int) -> None:
        self._moved(position)
        self._held.note()
        self._held.settle()

    def handle_area(self) -> QRect:
        """Return where the handle is drawn, in pixels of the slider."""
        option = QStyleOptionSlider()
        self.initStyleOption(option)
        return self.style().subControlRect(
            QStyle.ComplexControl.CC_Slider, option, QStyle.SubControl.SC_SliderHandle, self
        )

    def mousePressEvent(self, ev: QMouseEvent) -> None:
        """Take hold of the handle; the left button beside it brings it to the mouse first."""
        left, handle = Qt.MouseButton.LeftButton, self.handle_area()
        beside = not handle.contains(ev.position().toPoint())
        if ev.button() == left == ev.buttons() and beside:
            self.setSliderDown(True)
            x, span = ev.position().x(), self.width() - handle.width()
            self.setSliderPosition(
                QStyle.sliderValueFromPosition(
                    self.minimum(), self.maximum(), round(x - handle.width() / 2), span
                )
            )
            # Qt takes hold of the handle only where it is drawn.
            at = QPointF(x, handle.center().y())
            ev = QMouseEvent(ev.type(), at, ev.globalPosition(), left, left, ev.modifiers())
        super().mousePressEvent(ev)

    def mouseMoveEvent(self, ev: QMouseEvent) -> None:
        """Drag the handle, until Esc."""
        if self.isSliderDown():
            super().mouseMoveEvent(ev)

    def event(self, event: QEvent) -> bool:
        """Go back by Esc while something is held; the window has the key, too."""
        if (
            event.type() == QEvent.Type.ShortcutOverride
            and isinstance(event, QKeyEvent)
            and event.key() == Qt.Key.Key_Escape
            and self._held.on
        ):
            self.setValue(round(self._held.start))
            self._held.forget()
            self.setSliderDown(False)
        return super().event(event)

    def show_position(self, position: float) -> None:
        """Show a position without calling anything, unless the user holds the slider."""
        if not self._held.on:
            with QSignalBlocker(self):
                self.setValue(round(position))


def geometric(position: int, low: float, high: float) -> float:
    """Return the value between `low` and `high` at a position of a geometric scale."""
    return low * (high / low) ** (position / STEPS)


def geometric_position(value: float, low: float, high: float) -> float:
    """Return the position of a value of a geometric scale from `low` to `high`."""
    return STEPS * math.log(value / low) / math.log(high / low)
