"""A row of the timeline for all keys: a diamond at every frame at which anything is keyed."""

from __future__ import annotations

from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPaintEvent, QPalette, QPen

from deformer_app.rendering.palette import SELECTED
from deformer_app.viewer.qt.key_marks import HALF, ROW, KeyMarks, paint_key
from deformer_app.viewer.qt.timeline_view import LABELS, TimelineView
from deformer_app.viewer.timeline.keys import KeyName

SLIM = 12  # pixels of the row without a name


class TimelineSummary(KeyMarks):
    """The keys of each frame as one diamond: a press selects all of them.

    A diamond is yellow where all of them are selected, and has a yellow edge where some are.

    Args:
        view: where frames are.
        slim: True for a row without name and ground that lies upon something else, which gets the
            presses beside the diamonds.
    """

    def __init__(self, view: TimelineView, slim: bool = False) -> None:
        """Lay out."""
        super().__init__(view)
        self._slim = slim
        self.setFixedHeight(SLIM if slim else ROW)

    # Where things are.

    def position(self, frame: float) -> QPointF:
        """The middle of a frame's diamond."""
        return QPointF(LABELS + self.scale.x(frame), self.height() / 2)

    def keys_at(self, at: QPointF) -> frozenset[KeyName]:
        """The keys of the frame whose diamond is at a point."""
        by_frame, x = self._timeline.clip.by_frame, at.x() - LABELS
        near = self.nearest(by_frame, x) if x >= 0 else None
        return frozenset() if near is None else frozenset(by_frame[near])

    def keys_in(self, box: QRectF) -> list[KeyName]:
        """The keys of frames in a box, however high it is."""
        return [
            name
            for frame, names in self._timeline.clip.by_frame.items()
            if box.left() <= self.position(frame).x() <= box.right()
            for name in names
        ]

    # The mouse.

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Select the keys of a frame, or leave the press to what is below."""
        if self._slim and not self.keys_at(event.position()):
            event.ignore()
            return
        super().mousePressEvent(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Drag the selected keys, or leave the drag to what is below."""
        super().mouseMoveEvent(event)
        if self._slim and self._pressed is None:
            event.ignore()

    # The picture.

    def _marks(self) -> dict[int, list[KeyName]]:
        """Keys by the frame at which they are shown."""
        moving, by_frame = self._view.moving, self._timeline.clip.by_frame
        if not moving:
            return by_frame
        marks: dict[int, list[KeyName]] = {}
        for name in (name for names in by_frame.values() for name in names):
            at = name[1] + (self._view.shift if name in moving else 0)
            marks.setdefault(at, []).append(name)
        return marks

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the name, the diamonds and the playhead."""
        painter, palette = QPainter(self), self.palette()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if self._slim:
            self.clip_to_frames(painter)
            self.paint_playhead(painter)
            self._paint_marks(painter)
            return
        painter.fillRect(self.rect(), palette.color(QPalette.ColorRole.Base))
        band = palette.color(QPalette.ColorRole.WindowText)
        band.setAlpha(22)
        painter.fillRect(self.rect(), band)
        self.paint_title(painter, "All keys", 0)
        self.clip_to_frames(painter)
        self._paint_marks(painter)
        self.paint_time(painter)

    def _paint_marks(self, painter: QPainter) -> None:
        clip, selected = self._timeline.clip, self._timeline.selected
        measured = {track.owner for track in clip.tracks if track.measured}
        ink, grey = (
            self.palette().color(role)
            for role in (QPalette.ColorRole.WindowText, QPalette.ColorRole.PlaceholderText)
        )
        middle = self.height() / 2
        marks = [
            (self.half_of(all(owner in measured for owner, _ in names)), frame, names)
            for frame, names in self._marks().items()
            if self.sees(frame, HALF)
        ]
        for half, frame, names in sorted(marks):  # wide diamonds lie upon narrow ones
            chosen = sum(name in selected for name in names)
            fill = QColor(SELECTED) if chosen == len(names) else grey
            some = 0 < chosen < len(names)
            painter.setPen(QPen(QColor(SELECTED), 2.0) if some else ink)
            painter.setBrush(fill)
            at = LABELS + self.scale.x(frame)
            paint_key(painter, at, middle, half, clip.linear.issuperset(names))
