"""Diamonds of keys, to select, box and drag: what all rows of the timeline have in common."""

from __future__ import annotations

import math
from collections.abc import Iterable

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPalette, QPolygonF
from PySide6.QtWidgets import QWidget

from deformer_app.rendering.palette import HANDLE
from deformer_app.viewer.qt.timeline_view import LABELS, TimelineView
from deformer_app.viewer.timeline.keys import KeyName, shift_within
from deformer_app.viewer.timeline.scale import Scale

ROW = 20  # pixels
PLAYHEAD = QColor(HANDLE)
HALF = 5.0  # half the width of a diamond
_NEAR = 7.0  # pixels from a diamond within which a press is on it
_STILL = 4.0  # pixels of the mouse that are no drag


class KeyMarks(QWidget):
    """Diamonds along the frames.

    A press on a diamond selects its keys, with Shift these more, and drags the selected ones; a
    drag beside them selects by a box; a double click moves the playhead.

    Args:
        view: where frames are.
    """

    def __init__(self, view: TimelineView) -> None:
        """Lay out."""
        super().__init__()
        self._view, self._timeline = view, view.timeline
        self._pressed: QPointF | None = None
        self._grabbed: frozenset[KeyName] = frozenset()
        self._box: QRectF | None = None
        self.setMouseTracking(True)
        view.on_change.append(self.update)
        view.timeline.on_change.append(self.update)

    def keys_at(self, at: QPointF) -> frozenset[KeyName]:
        """The keys of the diamond at a point; none beside the diamonds."""
        raise NotImplementedError

    def keys_in(self, box: QRectF) -> list[KeyName]:
        """The keys whose diamonds have their middle in a box."""
        raise NotImplementedError

    def press_name(self, at: QPointF, more: bool) -> None:
        """Take a press left of the frames; `more` with Shift."""

    @property
    def scale(self) -> Scale:
        """Where frames are, right of `LABELS`."""
        return self._view.scale

    def nearest(self, frames: Iterable[int], x: float) -> int | None:
        """The frame whose diamond is nearest to a pixel right of `LABELS`; None if none is near."""
        near = [(abs(self.scale.x(frame) - x), frame) for frame in frames]
        distance, frame = min(near, default=(math.inf, 0))
        return frame if distance <= _NEAR else None

    # The mouse.

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Select keys, or begin a box."""
        if event.button() != Qt.MouseButton.LeftButton:
            return
        at, keys, selected = event.position(), self._timeline.keys, self._timeline.selected
        more = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
        if at.x() < LABELS:
            self.press_name(at, more)
            return
        self._pressed, self._grabbed = at, self.keys_at(at)
        known = self._grabbed <= selected
        if self._grabbed and more:
            keys.select(selected - self._grabbed if known else selected | self._grabbed)
        elif not known:
            keys.select(self._grabbed)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Drag the selected keys, or a box."""
        at = event.position()
        if self._pressed is None:
            self.setCursor(
                Qt.CursorShape.SizeHorCursor if self.keys_at(at) else Qt.CursorShape.ArrowCursor
            )
            return
        begun = self._box is not None or self._view.shift
        if not begun and (at - self._pressed).manhattanLength() < _STILL:
            return
        if self._grabbed:
            frames = self.scale.frame(at.x() - LABELS) - self.scale.frame(
                self._pressed.x() - LABELS
            )
            keys = self._timeline.clip.copied(self._timeline.selected)
            self._view.drag(shift_within(keys, frames))
        else:
            self._box = QRectF(self._pressed, at).normalized()
            self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """End the drag: the keys are moved, or the box selects."""
        if event.button() != Qt.MouseButton.LeftButton or self._pressed is None:
            return
        timeline = self._timeline
        more = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
        box, shift, grabbed = self._box, self._view.shift, self._grabbed
        self._pressed = self._box = None
        self._view.drag(0)
        if shift:
            timeline.keys.move(shift)
        elif not grabbed:
            found = [] if box is None else self.keys_in(box)
            timeline.keys.select([*found, *(timeline.selected if more else ())])

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Move the playhead to a key, or to the frame under the mouse."""
        at = event.position()
        if event.button() == Qt.MouseButton.LeftButton and at.x() >= LABELS:
            frames = {frame for _, frame in self.keys_at(at)}
            self._timeline.seek(frames.pop() if frames else self.scale.frame(at.x() - LABELS))

    # The picture.

    def clip_to_frames(self, painter: QPainter) -> None:
        """Draw right of the names only."""
        painter.setClipRect(LABELS, 0, self.width() - LABELS, self.height())

    def paint_time(self, painter: QPainter) -> None:
        """Draw what lies upon the keys: the veil after the clip's end, the playhead, the box."""
        palette = self.palette()
        after = LABELS + self.scale.x(self._timeline.clip.length - 1) + 1
        self.clip_to_frames(painter)
        veil = palette.color(QPalette.ColorRole.WindowText)
        veil.setAlpha(18)
        painter.fillRect(QRectF(after, 0, max(self.width() - after, 0), self.height()), veil)
        self.paint_playhead(painter)
        if self._box is not None:
            fill = palette.color(QPalette.ColorRole.Highlight)
            painter.setPen(fill)
            fill.setAlpha(50)
            painter.setBrush(fill)
            painter.drawRect(self._box)

    def paint_playhead(self, painter: QPainter) -> None:
        """Draw the line of the playhead."""
        x = LABELS + self.scale.x(self._timeline.frame)
        painter.setPen(PLAYHEAD)
        painter.drawLine(QPointF(x, 0), QPointF(x, self.height()))

    def half_of(self, measured: bool) -> float:
        """Half the width of a diamond; measurements, one a frame, are narrower than a frame."""
        return min(HALF, max(1.5, 0.45 * self.scale.width)) if measured else HALF

    def sees(self, frame: int, half: float) -> bool:
        """True if a diamond at a frame is in sight."""
        return -half <= self.scale.x(frame) <= self.width() - LABELS + half

    def paint_title(self, painter: QPainter, title: str, y: float) -> None:
        """Draw the name of a row whose top is at y, in pixels."""
        painter.setPen(self.palette().color(QPalette.ColorRole.WindowText))
        room = LABELS - 12
        short = painter.fontMetrics().elidedText(title, Qt.TextElideMode.ElideMiddle, room)
        flags = int(Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft)
        painter.drawText(8, int(y), room, ROW, flags, short)


def paint_key(painter: QPainter, x: float, y: float, half: float, linear: bool) -> None:
    """Draw a diamond; one that is linear has a corner cut off on the right."""
    corners = [(x - half, y), (x, y - half), (x + half, y), (x, y + half)]
    if linear:
        corners[2:3] = [(x + half / 2, y - half / 2), (x + half / 2, y + half / 2)]
    painter.drawPolygon(QPolygonF([QPointF(*corner) for corner in corners]))
