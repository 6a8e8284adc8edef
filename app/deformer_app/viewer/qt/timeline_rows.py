"""The rows of the timeline: a diamond for every key of the sliders and of each handle."""

from __future__ import annotations

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPalette, QResizeEvent
from PySide6.QtWidgets import QFrame, QScrollArea, QSizePolicy

from deformer_app.rendering.palette import KINDS, SELECTED, TARGET
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.key_marks import ROW, KeyMarks, paint_key
from deformer_app.viewer.qt.timeline_view import LABELS, TimelineView
from deformer_app.viewer.timeline.keys import SLIDERS, KeyName

_FEWEST = 3  # rows in sight


class TimelineRows(KeyMarks):
    """A row for the sliders and for every handle; a press on a name selects the handle.

    Args:
        editor: whose handles and keys they are.
        view: where frames are.
    """

    def __init__(self, editor: Editor, view: TimelineView) -> None:
        """Lay out."""
        super().__init__(view)
        self._editor = editor
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.MinimumExpanding)

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
        return None if y is None else QPointF(LABELS + self.scale.x(name[1]), y)

    def keys_at(self, at: QPointF) -> frozenset[KeyName]:
        """The key at a point, if there is one."""
        row, rows = int(at.y() // ROW), self._timeline.rows
        if at.x() < LABELS or not 0 <= row < len(rows):
            return frozenset()
        owner, x = rows[row][0], at.x() - LABELS
        track = self._timeline.clip.track(owner)
        frames = track.frames if track else []
        near = self.nearest(frames, x)
        return frozenset() if near is None else frozenset({(owner, near)})

    def keys_in(self, box: QRectF) -> list[KeyName]:
        """The keys in a box."""
        found = []
        for name in self._timeline.clip.names:
            at = self.position(name)
            if at is not None and box.contains(at):
                found.append(name)
        return found

    def press_name(self, at: QPointF, more: bool) -> None:
        """Select the handle of a row."""
        row, rows = int(at.y() // ROW), self._timeline.rows
        if 0 <= row < len(rows) and rows[row][0] != SLIDERS:
            self._editor.handles.select([rows[row][0]], toggle=more)

    # The picture.

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw rows, names, keys, the box and the playhead."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), self.palette().color(QPalette.ColorRole.Base))
        kinds = {h.id: h.kind for h in self._editor.edit.handles} if self._editor.is_open else {}
        for n, (owner, title) in enumerate(self._timeline.rows):
            self._paint_row(
                painter, n, owner, title, QColor(KINDS.get(kinds.get(owner, ""), TARGET))
            )
        self.paint_time(painter)

    def _paint_row(self, painter: QPainter, n: int, owner: int, title: str, colour: QColor) -> None:
        palette, y = self.palette(), n * ROW
        ink = palette.color(QPalette.ColorRole.WindowText)
        painter.setClipping(False)
        if n % 2:
            stripe = QColor(ink)
            stripe.setAlpha(10)
            painter.fillRect(0, y, self.width(), ROW, stripe)
        if owner in self._editor.handles.selected:
            chosen = palette.color(QPalette.ColorRole.Highlight)
            chosen.setAlpha(70)
            painter.fillRect(0, y, LABELS, ROW, chosen)
        self.paint_title(painter, title, y)
        track = self._timeline.clip.track(owner)
        if track is None:
            return
        self.clip_to_frames(painter)
        middle, scale, moving = y + ROW / 2, self.scale, self._view.moving
        frames = [f + self._view.shift if (owner, f) in moving else f for f in track.frames]
        line = QColor(colour)
        line.setAlpha(110)
        painter.setPen(line)
        painter.drawLine(
            QPointF(LABELS + scale.x(min(frames)), middle),
            QPointF(LABELS + scale.x(max(frames)), middle),
        )
        half = self.half_of(track.measured)
        for frame, key in zip(frames, track.keys, strict=True):
            if not self.sees(frame, half):
                continue
            selected = (owner, key.frame) in self._timeline.selected
            painter.setPen(ink if selected else QColor(colour).darker(140))
            painter.setBrush(QColor(SELECTED) if selected else colour)
            paint_key(painter, LABELS + scale.x(frame), middle, half, key.ease == "linear")


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
