"""A slim timeline for the dock of poses: the playhead and the keys of each frame."""

from __future__ import annotations

from PySide6.QtGui import QResizeEvent, QWheelEvent
from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout, QWidget

from deformer_app.viewer.qt.timeline_buttons import TimelineButtons
from deformer_app.viewer.qt.timeline_ruler import TimelineRuler
from deformer_app.viewer.qt.timeline_summary import TimelineSummary
from deformer_app.viewer.qt.timeline_view import LABELS, TimelineView

_HEIGHT = 34  # of the ruler with the diamonds below its numbers


class TimeStrip(QWidget):
    """Buttons of the timeline, and beside them its ruler with the keys of each frame upon it.

    Args:
        view: where frames are.

    Attributes:
        buttons: previous key, play, next key, and key.
        ruler: moves the playhead.
        summary: the keys of each frame, to select and to drag.
    """

    def __init__(self, view: TimelineView) -> None:
        """Lay out."""
        super().__init__()
        self._view = view
        self.buttons = TimelineButtons(view.timeline)
        self.ruler = TimelineRuler(view)
        self.ruler.setFixedHeight(_HEIGHT)
        self.ruler.setToolTip("Drag to move the playhead, or a diamond to move all keys of its "
                              "frame; the wheel zooms, with Shift it scrolls")  # fmt: skip
        column = QVBoxLayout(self)
        column.setContentsMargins(4, 2, 4, 0)  # frames are where the dock of the timeline has them
        column.addWidget(self.ruler)
        place = QWidget(self.ruler)
        place.setGeometry(0, 0, LABELS - 4, _HEIGHT)
        row = QHBoxLayout(place)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(0)
        for button in (*self.buttons.playback, self.buttons.key):
            row.addWidget(button)
        self.summary = TimelineSummary(view, slim=True)
        self.summary.setParent(self.ruler)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Keep the diamonds at the bottom of the ruler."""
        super().resizeEvent(event)
        below = _HEIGHT - self.summary.height()
        self.summary.setGeometry(0, below, self.ruler.width(), self.summary.height())

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Zoom about the mouse; with Shift, or sideways, scroll."""
        self._view.turn(event, event.position().x() - self.ruler.x() - LABELS)
