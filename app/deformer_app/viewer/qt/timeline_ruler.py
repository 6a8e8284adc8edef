"""The ruler of the timeline: numbers of frames, and the playhead that the mouse moves."""

from __future__ import annotations

from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import (
    QColor,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QPalette,
    QPolygonF,
    QResizeEvent,
)
from PySide6.QtWidgets import QWidget

from deformer_app.viewer.qt.key_marks import PLAYHEAD
from deformer_app.viewer.qt.timeline_view import LABELS, TimelineView

_HEIGHT = 26
_TICK = 6  # pixels between two ticks, at least


class TimelineRuler(QWidget):
    """Numbers of frames above the rows of keys; a press or a drag moves the playhead.

    Args:
        view: where frames are; fitted to the ruler's width.
    """

    def __init__(self, view: TimelineView) -> None:
        """Lay out."""
        super().__init__()
        self._view, self._timeline = view, view.timeline
        self.setFixedHeight(_HEIGHT)
        self.setFocusPolicy(Qt.FocusPolicy.ClickFocus)  # keys are no longer those of a list
        self.setToolTip("Drag to move the playhead; the wheel zooms, with Shift it scrolls")
        view.on_change.append(self.update)
        view.timeline.on_change.append(self.update)

    def pixel(self, frame: float) -> float:
        """Pixel of a frame."""
        return LABELS + self._view.scale.x(frame)

    def _scrub(self, event: QMouseEvent) -> None:
        self._timeline.stop()
        self._timeline.seek(self._view.scale.frame(event.position().x() - LABELS))

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Move the playhead to the mouse."""
        if event.button() == Qt.MouseButton.LeftButton and event.position().x() >= LABELS:
            self._scrub(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Let the playhead follow the mouse."""
        if event.buttons() & Qt.MouseButton.LeftButton:
            self._scrub(event)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Show the whole clip."""
        super().resizeEvent(event)
        self._view.fit(self.width())

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw ticks, numbers and the playhead."""
        painter, palette, scale = QPainter(self), self.palette(), self._view.scale
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        length, height = self._timeline.clip.length, _HEIGHT
        painter.fillRect(self.rect(), palette.color(QPalette.ColorRole.Window))
        ink = palette.color(QPalette.ColorRole.WindowText)
        faint = QColor(ink)
        faint.setAlpha(90)
        painter.setClipRect(LABELS, 0, self.width() - LABELS, self.height())
        small = next((n for n in (1, 2, 5, 10) if n * scale.width >= _TICK), scale.step)
        start = max(0, int(scale.first) // scale.step * scale.step)
        stop = min(length, scale.frame(self.width() - LABELS) + 2)
        for frame in range(start, stop, min(small, scale.step)):
            x, numbered = self.pixel(frame), frame % scale.step == 0
            painter.setPen(ink if numbered else faint)
            painter.drawLine(QPointF(x, height), QPointF(x, height - (7 if numbered else 4)))
            if numbered:
                painter.drawText(int(x) - 30, 0, 60, height - 8, _MIDDLE, str(frame))
        self._paint_playhead(painter, self.pixel(self._timeline.frame))

    def _paint_playhead(self, painter: QPainter, x: float) -> None:
        height, text = _HEIGHT, str(self._timeline.frame)
        wide = painter.fontMetrics().horizontalAdvance(text) + 10
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(PLAYHEAD)
        painter.drawRoundedRect(int(x - wide / 2), 1, wide, height - 9, 4, 4)
        tip = [(x - 4, height - 8), (x + 4, height - 8), (x, height)]
        painter.drawPolygon(QPolygonF([QPointF(*at) for at in tip]))
        painter.setPen(QColor("white"))
        painter.drawText(int(x - wide / 2), 1, wide, height - 9, _MIDDLE, text)


_MIDDLE = int(Qt.AlignmentFlag.AlignCenter)
