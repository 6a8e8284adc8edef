"""The slider of a component, with zero in its middle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QRectF
from PySide6.QtGui import QMouseEvent, QPainter, QPaintEvent, QPalette

from deformer_app.viewer.component_scale import ComponentScale
from deformer_app.viewer.qt.slider import STEPS, Slider

_SNAP = 8  # steps from zero within which a dragged handle goes to zero


class ComponentSlider(Slider):
    """A slider over weights of a component; ticks show zero and the prior's mean.

    Args:
        scale: of the component.
        moved: called with a weight while the user moves the slider.
        ended: called when the user lets go of it, and after each step of keys or wheel.
    """

    def __init__(
        self, scale: ComponentScale, moved: Callable[[float], Any], ended: Callable[[], Any]
    ) -> None:
        """Start at zero."""
        super().__init__(lambda position: moved(self._weight(position)), ended)
        self._scale = scale
        self._mean = 0.0
        self.setMinimumWidth(60)
        self.show_weight(0.0, 0.0)

    def show_weight(self, weight: float, mean: float) -> None:
        """Show the weight of the pose and that of the prior's mean, without calling anything."""
        self.show_position(self._position(weight))
        if mean != self._mean:
            self._mean = mean
            self.update()

    def _weight(self, position: int) -> float:
        off = position - STEPS / 2
        if abs(off) <= _SNAP and self.isSliderDown():
            return 0.0
        return self._scale.reach * off / (STEPS / 2)

    def _position(self, weight: float) -> float:
        position = STEPS / 2 * (1.0 + weight / self._scale.reach)
        return min(max(position, 0.0), float(STEPS))

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Go to zero, as a step of the history."""
        self.setValue(STEPS // 2)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the range of the examples and the ticks, and the slider over them."""
        painter = QPainter(self)
        palette, height = self.palette(), self.height()
        muted = palette.color(QPalette.ColorGroup.Disabled, QPalette.ColorRole.WindowText)
        low, high = (self._at(weight) for weight in (self._scale.low, self._scale.high))
        painter.fillRect(QRectF(low, height - 2, max(high - low, 1.0), 2), muted)
        zero = self._at(0.0)
        painter.fillRect(QRectF(zero - 0.5, 0, 1, height), palette.windowText())
        if abs(self._mean) > 1e-9:
            mean = self._at(self._mean)
            painter.fillRect(QRectF(mean - 1, 0, 2, height), palette.highlight())
        painter.end()
        super().paintEvent(event)

    def _at(self, weight: float) -> float:
        """Pixels from the left edge to the middle of the handle at a weight."""
        handle = self.handle_area()
        span = self.width() - handle.width()
        return handle.width() / 2 + span * self._position(weight) / STEPS
