"""The rows of the timeline: a diamond for every key, to select, box and drag."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import (
    QColor,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QPalette,
    QPolygonF,
    QResizeEvent,
)
from PySide6.QtWidgets import QFrame, QScrollArea, QSizePolicy, QWidget

from deformer_app.rendering.palette import KINDS, SELECTED, TARGET
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.timeline_ruler import LABELS, PLAYHEAD
from deformer_app.viewer.timeline.keys import SLIDERS, KeyName, shift_within
from deformer_app.viewer.timeline.scale import Scale

ROW = 20  # pixels
_FEWEST = 3  # rows in sight
_HALF = 5.0  # half the width of a diamond
_NEAR = 7.0  # pixels from a diamond within which a press is on it
_STILL = 4.0  # pixels of the mouse that are no drag


class TimelineRows(QWidget):
    """A row for the sliders and for every handle.

    A press on a diamond selects its key, with Shift one more, and drags the selected ones; a drag
    beside them selects by a box; a press on a name selects the handle.

    Args:
        editor: whose handles and keys they are.
        scale: gives where frames are.
    """

    def __init__(self, editor: Editor, scale: Callable[[], Scale]) -> None:
        """Lay out."""
        super().__init__()
        self._editor, self._timeline, self._scale = editor, editor.timeline, scale
        self._pressed: QPointF | None = None
        self._grabbed: KeyName | None = None
        self._box: QRectF | None = None
        self._shift = 0
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.MinimumExpanding)
        self.setMouseTracking(True)

    def sizeHint(self) -> QSize:
        """As high as all rows."""
        return QSize(LABELS + 200, ROW * max(len(self._timeline.rows), 1))

    def minimumSizeHint(self) -> QSize:
        """As high as all rows."""
        return self.sizeHint()

    # Where things are.

    def middle(self, owner: int) -> float | None:
        """The middle of a handle's row, in pixels from the top; None without a row."""
        owners = [row for row, _ in self._timeline.rows]
        return (owners.index(owner) + 0.5) * ROW if owner in owners else None

    def position(self, name: KeyName) -> QPointF | None:
        """The middle of a key's diamond; None for a key without a row."""
        y = self.middle(name[0])
        return None if y is None else QPointF(LABELS + self._scale().x(name[1]), y)

    def _key_at(self, at: QPointF) -> KeyName | None:
        row = int(at.y() // ROW)
        rows = self._timeline.rows
        if at.x() < LABELS or not 0 <= row < len(rows):
            return None
        track = self._timeline.clip.track(rows[row][0])
        frames = track.frames if track else []
        scale, x = self._scale(), at.x() - LABELS
        near = [f for f in frames if abs(scale.x(f) - x) <= _NEAR]
        return (rows[row][0], min(near, key=lambda f: abs(scale.x(f) - x))) if near else None

    def _keys_in(self, box: QRectF) -> list[KeyName]:
        found = []
        for name in self._timeline.clip.names:
            at = self.position(name)
            if at is not None and box.contains(at):
                found.append(name)
        return found

    # The mouse.

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Select a key or a handle, or begin a box."""
        if event.button() != Qt.MouseButton.LeftButton:
            return
        at, timeline = event.position(), self._timeline
        more = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
        if at.x() < LABELS:
            self._select_row(int(at.y() // ROW), more)
            return
        self._pressed, self._grabbed, self._shift = at, self._key_at(at), 0
        if self._grabbed is None:
            return
        if more:
            timeline.keys.select([self._grabbed], toggle=True)
        elif self._grabbed not in timeline.selected:
            timeline.keys.select([self._grabbed])

    def _select_row(self, row: int, more: bool) -> None:
        rows = self._timeline.rows
        if 0 <= row < len(rows) and rows[row][0] != SLIDERS:
            self._editor.handles.select([rows[row][0]], toggle=more)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Drag the selected keys, or a box."""
        at = event.position()
        if self._pressed is None:
            self.setCursor(
                Qt.CursorShape.SizeHorCursor if self._key_at(at) else Qt.CursorShape.ArrowCursor
            )
            return
        if (at - self._pressed).manhattanLength() < _STILL and self._box is None:
            return
        if self._grabbed is None:
            self._box = QRectF(self._pressed, at).normalized()
        else:
            frames = self._scale().frame(at.x() - LABELS) - self._scale().frame(
                self._pressed.x() - LABELS
            )
            keys = self._timeline.clip.copied(self._timeline.selected)
            self._shift = shift_within(keys, frames)
        self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """End the drag: the keys are moved, or the box selects."""
        if event.button() != Qt.MouseButton.LeftButton or self._pressed is None:
            return
        timeline = self._timeline
        more = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
        box, shift, grabbed = self._box, self._shift, self._grabbed
        self._pressed = self._grabbed = self._box = None
        self._shift = 0
        if shift:
            timeline.keys.move(shift)
        elif grabbed is None:
            found = [] if box is None else self._keys_in(box)
            timeline.keys.select([*found, *(timeline.selected if more else ())])
        self.update()

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Move the playhead to a key, or to the frame under the mouse."""
        at = event.position()
        if event.button() == Qt.MouseButton.LeftButton and at.x() >= LABELS:
            name = self._key_at(at)
            self._timeline.seek(name[1] if name else self._scale().frame(at.x() - LABELS))

    # The picture.

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw rows, names, keys, the box and the playhead."""
        painter, palette = QPainter(self), self.palette()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        ink = palette.color(QPalette.ColorRole.WindowText)
        painter.fillRect(self.rect(), palette.color(QPalette.ColorRole.Base))
        kinds = {h.id: h.kind for h in self._editor.edit.handles} if self._editor.is_open else {}
        for n, (owner, title) in enumerate(self._timeline.rows):
            self._paint_row(
                painter, n, owner, title, QColor(KINDS.get(kinds.get(owner, ""), TARGET))
            )
        scale = self._scale()
        after = LABELS + scale.x(self._timeline.clip.length - 1) + 1
        painter.setClipRect(LABELS, 0, self.width() - LABELS, self.height())
        veil = QColor(ink)
        veil.setAlpha(18)
        painter.fillRect(QRectF(after, 0, max(self.width() - after, 0), self.height()), veil)
        x = LABELS + scale.x(self._timeline.frame)
        painter.setPen(PLAYHEAD)
        painter.drawLine(QPointF(x, 0), QPointF(x, self.height()))
        if self._box is not None:
            fill = palette.color(QPalette.ColorRole.Highlight)
            painter.setPen(fill)
            fill.setAlpha(50)
            painter.setBrush(fill)
            painter.drawRect(self._box)

    def _paint_row(self, painter: QPainter, n: int, owner: int, title: str, colour: QColor) -> None:
        palette, y = self.palette(), n * ROW
        ink = palette.color(QPalette.ColorRole.WindowText)
        if n % 2:
            stripe = QColor(ink)
            stripe.setAlpha(10)
            painter.fillRect(0, y, self.width(), ROW, stripe)
        painter.setClipping(False)
        if owner in self._editor.handles.selected:
            chosen = palette.color(QPalette.ColorRole.Highlight)
            chosen.setAlpha(70)
            painter.fillRect(0, y, LABELS, ROW, chosen)
        painter.setPen(ink)
        flags = int(Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft)
        room = LABELS - 12
        short = painter.fontMetrics().elidedText(title, Qt.TextElideMode.ElideMiddle, room)
        painter.drawText(8, y, room, ROW, flags, short)
        track = self._timeline.clip.track(owner)
        if track is None:
            return
        painter.setClipRect(LABELS, 0, self.width() - LABELS, self.height())
        middle, scale = y + ROW / 2, self._scale()
        frames = [f + self._shift if (owner, f) in self._moving else f for f in track.frames]
        line = QColor(colour)
        line.setAlpha(110)
        painter.setPen(line)
        painter.drawLine(
            QPointF(LABELS + scale.x(min(frames)), middle),
            QPointF(LABELS + scale.x(max(frames)), middle),
        )
        half = min(_HALF, max(1.5, 0.45 * scale.width)) if track.measured else _HALF
        right = self.width()
        for frame, key in zip(frames, track.keys, strict=True):
            x = LABELS + scale.x(frame)
            if not -half <= x - LABELS or x > right + half:
                continue
            selected = (owner, key.frame) in self._timeline.selected
            painter.setPen(ink if selected else QColor(colour).darker(140))
            painter.setBrush(QColor(SELECTED) if selected else colour)
            _paint_key(painter, x, middle, half, key.ease == "linear")

    @property
    def _moving(self) -> frozenset[KeyName]:
        return self._timeline.selected if self._shift else frozenset()


class WholeRows(QScrollArea):
    """Scrolls rows up and down, and cuts none of them.

    Args:
        rows: what is shown.
    """

    def __init__(self, rows: TimelineRows) -> None:
        """Show the rows."""
        super().__init__()
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setFocusPolicy(Qt.FocusPolicy.ClickFocus)  # a row has nothing that Tab could reach
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setWidget(rows)
        self.setMinimumHeight(_FEWEST * ROW)
        self.verticalScrollBar().setSingleStep(ROW)
        self.verticalScrollBar().sliderReleased.connect(self._to_whole_row)

    def _to_whole_row(self) -> None:
        bar = self.verticalScrollBar()
        bar.setValue(round(bar.value() / ROW) * ROW)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Leave free at the bottom what is too little for a row."""
        super().resizeEvent(event)
        self.setViewportMargins(0, 0, 0, self.height() % ROW)


def _paint_key(painter: QPainter, x: float, y: float, half: float, linear: bool) -> None:
    """A diamond; one that is linear has a corner cut off on the right."""
    corners = [(x - half, y), (x, y - half), (x + half, y), (x, y + half)]
    if linear:
        corners[2:3] = [(x + half / 2, y - half / 2), (x + half / 2, y + half / 2)]
    painter.drawPolygon(QPolygonF([QPointF(*corner) for corner in corners]))
