"""Lines of text with buttons at the upper edge of the picture, or of the start page."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QEvent, QObject, QPoint, QRect, QTimer
from PySide6.QtWidgets import QLabel, QStackedWidget, QVBoxLayout, QWidget

from deformer_app.viewer.qt.later import later
from deformer_app.viewer.qt.preparing_strip import PreparingStrip
from deformer_app.viewer.qt.strip import Strip
from deformer_app.viewer.view_cube import LEFT

_WIDEST, _NARROWEST = 660, 260  # pixels
_MARGIN = 12  # pixels between notices and the edges of the picture
_CUBE = round(LEFT)  # pixels at the right that belong to the orientation cube
_WORK = 100  # pixels on each side of what the user works on that notices leave free
# How long a note is shown, in milliseconds: to find it, and to read each of its characters.
_TO_FIND, _TO_READ = 2500, 60
_MISTAKE = 2  # times as long for a mistake, which was not expected


def reading_time(text: str) -> int:
    """Return the milliseconds that a person needs to notice and to read a text."""
    return _TO_FIND + _TO_READ * len(text)


class Mistakes(Strip):
    """Mistakes, the latest first; each stays until it is closed or there was time to read it.

    Args:
        changed: called when another one is shown, or none.

    Attributes:
        told: number of mistakes so far.
    """

    def __init__(self, changed: Callable[[], Any]) -> None:
        """Start empty."""
        super().__init__("mistake")
        self._changed = changed
        self._left: list[str] = []
        self.told = 0
        self._over: QTimer = later(self, _TO_FIND, self._read)
        self._count = QLabel()
        self._count.setProperty("rank", "second")
        self.row.addWidget(self._count)
        self.add_closing_mark(self.close_one)

    def add(self, text: str) -> None:
        """Show a mistake, once if it is already there."""
        if text in self._left:
            self._left.remove(text)
        self._left.append(text)
        self.told += 1
        self._show()

    def close_one(self) -> None:
        """Close the mistake that is shown; the one before it is shown again."""
        if self._left:
            self._left.pop()
        self._show()

    def clear(self) -> None:
        """Close all mistakes."""
        self._left.clear()
        self._show()

    def _read(self) -> None:
        if self.underMouse() or not self.isVisible():  # it is being read, or hidden by a drag
            self._over.start()
        else:
            self.close_one()

    def _show(self) -> None:
        self._over.stop()
        if self._left:
            self.say(self._left[-1])
            self._over.start(_MISTAKE * reading_time(self.text))
        self._count.setText(f"1 of {len(self._left)}")
        self._count.setVisible(len(self._left) > 1)
        self.setVisible(bool(self._left))
        self._changed()


class Notices(QWidget):
    """The strips upon the picture or the start page; hidden while the user drags.

    They lie at the upper edge, in the corner away from where the user works near that edge. If the
    picture gave way to them instead, what is being dragged would jump.

    Args:
        pages: what is shown: the page of the picture or another one.
        picture: what they lie upon while its page is shown.
        stop_recording: what the button of the recording does.
    """

    def __init__(
        self, pages: QStackedWidget, picture: QWidget, stop_recording: Callable[[], Any]
    ) -> None:
        """Lay out; nothing is shown."""
        super().__init__(pages)
        self._pages, self._picture, self._dragging = pages, picture, False
        self._work: float | None = None  # pixels from the picture's left, near its upper edge
        self._offers: list[Strip] = []
        self._noted = 0
        self.mistake = Mistakes(self._arrange)
        self.note = Strip("note")
        self.note.add_closing_mark(self.hide_note)
        self.recording = Strip("recording", ("Stop", stop_recording))
        self.recording.read_html()
        self.recording.say("<b>●</b>&nbsp; Recording what the picture shows")
        self.preparing = PreparingStrip(self._arrange)
        self.wait = Strip("waiting")
        self.wait.add_moving_bar()
        self._column = column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(6)
        for strip in self._strips:
            column.addWidget(strip)
        self._over: QTimer = later(self, _TO_FIND, self._note_read)
        self.hide()
        for widget in (pages, picture):
            widget.installEventFilter(self)
        pages.currentChanged.connect(self._arrange)

    @property
    def _strips(self) -> tuple[Strip, ...]:
        strips = self.mistake, self.note, self.recording, self.preparing, self.wait
        return *strips, *self._offers

    def add_offer(self, strip: Strip) -> None:
        """Add a strip below the others, hidden; see `show_strip`."""
        self._offers.append(strip)
        self._column.addWidget(strip)

    def show_mistake(self, text: str) -> None:
        """Tell the user of a mistake until it is closed, has been read, or something succeeds."""
        self.mistake.add(text)

    def hide_mistake(self) -> None:
        """Close all mistakes."""
        self.mistake.clear()

    @property
    def told(self) -> tuple[int, int]:
        """Numbers of mistakes and of notes so far."""
        return self.mistake.told, self._noted

    def forget(self, told: tuple[int, int]) -> None:
        """Hide what was told before something that succeeded.

        Args:
            told: as it was before. Mistakes stay if one has been told since, and a note likewise.
        """
        mistakes, notes = told
        if mistakes == self.mistake.told and not self.mistake.isHidden():
            self.mistake.clear()
        if notes == self._noted and not self.note.isHidden():
            self.hide_note()

    def show_note(self, text: str) -> None:
        """Show a message until it has been read; the next one takes its place."""
        self._noted += 1
        self.note.say(text)
        self._over.start(reading_time(text))
        self.show_strip(self.note)

    def hide_note(self) -> None:
        """Hide the message."""
        self._over.stop()
        self.show_strip(self.note, False)

    def _note_read(self) -> None:
        if self.note.underMouse():  # it is being read
            self._over.start()
        else:
            self.hide_note()

    def show_strip(self, strip: Strip, shown: bool = True) -> None:
        """Show or hide one of the strips."""
        strip.setVisible(shown)
        self._arrange()

    def show_wait(self, text: str) -> None:
        """Say what the user waits for, with a moving bar; an empty text ends it."""
        self.wait.say(text)
        self.show_strip(self.wait, bool(text))

    def keep_clear(self, dragging: bool, work: tuple[float, float] | None) -> None:
        """Leave the picture to a drag, and the part in which the user works to the user.

        Args:
            dragging: True while the mouse drags; all strips are hidden meanwhile.
            work: what the user works on, in pixels from the picture's upper left corner, or None.
        """
        near = work is not None and work[1] < self._picture.height() / 3
        place = work[0] if work is not None and near else None
        if (dragging, place) != (self._dragging, self._work):
            self._dragging, self._work = dragging, place
            self._arrange()

    def _arrange(self) -> None:
        shown = any(not strip.isHidden() for strip in self._strips)
        self.setVisible(shown and not self._dragging)
        self._column.activate()
        x, width = self._span()
        height = max(self._column.totalHeightForWidth(width), 1)
        self.setGeometry(x, self._frame.y() + _MARGIN, width, height)
        self.raise_()

    @property
    def _on_picture(self) -> bool:
        return self._picture.isVisibleTo(self._pages)

    @property
    def _frame(self) -> QRect:
        """What the strips lie upon, in pixels of the pages."""
        if not self._on_picture:
            return self._pages.rect()
        return QRect(self._picture.mapTo(self._pages, QPoint(0, 0)), self._picture.size())

    def _span(self) -> tuple[int, int]:
        """The strips' left edge and their width: in the middle, or beside the user's work."""
        frame = self._frame
        left = frame.x() + _MARGIN
        room = frame.width() - 2 * _MARGIN
        if self._on_picture and room - _CUBE >= _NARROWEST:  # else they cover the cube
            room -= _CUBE
        if self._work is None or not self._on_picture:
            width = max(min(_WIDEST, room), 1)
            return left + (room - width) // 2, width
        before = round(self._work) - _WORK - _MARGIN
        after = room - round(self._work) - _WORK + _MARGIN
        width = max(min(_WIDEST, max(before, after, _NARROWEST), room), 1)
        return (left if before >= after else left + room - width), width

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Keep the strips where they belong as the picture or the window changes its size."""
        if event.type() in (QEvent.Type.Resize, QEvent.Type.Move):
            self._arrange()
        return super().eventFilter(watched, event)
