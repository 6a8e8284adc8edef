"""The tour: a line upon the picture whose next step follows when the user has done this one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QEvent, QObject, QPoint, QTimer
from PySide6.QtWidgets import QWidget

from deformer_app.viewer.changes import CameraMoved, Change, HandlesDragged, ModelOpened
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.later import later
from deformer_app.viewer.qt.strip import Strip

_PAUSE = 900  # milliseconds between what the user does and the next step
_WIDEST, _MARGIN = 660, 12  # pixels of the line, and between it and the picture's edges
_POLL = 200  # milliseconds between two looks whether the solver is ready
_WAITING = "The tour begins when the solver is ready. Drag anywhere to look around meanwhile."


@dataclass(frozen=True)
class _Step:
    """A step of the tour.

    Args:
        text: says what to do.
        done: true if a change, after which the editor has some more pins than before, does it; None
            for the last step, which only tells.
    """

    text: str
    done: Callable[[Change, int], bool] | None


_STEPS = (
    _Step(
        "Press on the surface and pull. The rest follows as in the examples.",
        lambda change, _: isinstance(change, HandlesDragged),
    ),
    _Step(
        "Look around: drag beside the shape to turn the view, turn the wheel to zoom.",
        lambda change, _: isinstance(change, CameraMoved),
    ),
    _Step(
        "Point at a place that should stay, and press P: it is pinned.",
        lambda _, pins: pins > 0,
    ),
    _Step("Ctrl+Z undoes your steps, one after the other. F1 lists all keys. Enjoy!", None),
)


class Tour(Strip):
    """The steps of the tour, one at a time; the first waits for a solver that answers to drags.

    A step that the user has done before its turn is left out. The line lies at the picture's lower
    edge: if the picture gave way to it, the shape would move under the cursor with every step.

    Args:
        editor: what the user tries it on.
        pages: the widget that the picture is in.
        picture: what the line lies upon.
    """

    def __init__(self, editor: Editor, pages: QWidget, picture: QWidget) -> None:
        """Start hidden."""
        super().__init__("tour", ("Next", self.go_on), ("End tour", self.end), ("Done", self.end))
        self.setParent(pages)
        self.hide()
        self.read_html()
        self._editor, self._pages, self._picture = editor, pages, picture
        for widget in (pages, picture):
            widget.installEventFilter(self)
        self._step: int | None = None  # −1 while the solver is being prepared
        self._done: set[int] = set()
        self._pins: frozenset[int] = frozenset()  # ids of the pins that are there
        self._poll = QTimer(self)
        self._poll.setInterval(_POLL)
        self._poll.timeout.connect(self._look)
        self._pause = later(self, _PAUSE, self._go_on_if_done)
        editor.on_change.append(self._hear)

    @property
    def running(self) -> bool:
        """True while a step is shown, or the tour waits for the solver."""
        return self._step is not None

    def begin(self) -> None:
        """Show the first step, as soon as the solver is ready."""
        self._done.clear()
        if self._editor.preparing:
            self._show(-1)
            self._poll.start()
        else:
            self._show(0)

    def _look(self) -> None:
        if self._step != -1:  # ended
            self._poll.stop()
        elif not self._editor.preparing:
            self._show(0)

    def go_on(self) -> None:
        """Show the next step that has not been done, or end after the last one."""
        step = -1 if self._step is None else self._step
        rest = [n for n in range(step + 1, len(_STEPS)) if n not in self._done]
        if rest:
            self._show(rest[0])
        else:
            self.end()

    def end(self) -> None:
        """Hide the tour."""
        self._step = None
        self._pause.stop()
        self.hide()

    def _show(self, step: int) -> None:
        self._step = step
        self._pins = self._present_pins()
        if step < 0:
            self.say(_WAITING)
        else:
            self.say(f"<b>{step + 1} of {len(_STEPS)}</b>&nbsp;&nbsp; {_STEPS[step].text}")
        last = step == len(_STEPS) - 1
        self.show_buttons(*(("Done",) if last else ("Next", "End tour")[step < 0 :]))
        self.show()
        self._arrange()

    def _arrange(self) -> None:
        """Put the line in the middle of the picture's lower edge, as high as its text needs."""
        corner = self._picture.mapTo(self._pages, QPoint(0, self._picture.height()))
        room = self._picture.width()
        width = max(min(_WIDEST, room - 2 * _MARGIN), 1)
        self.resize(width, self.height())  # the buttons may go below the text
        self.row.activate()
        height = self.row.totalHeightForWidth(width)
        x = corner.x() + (room - width) // 2
        self.setGeometry(x, corner.y() - _MARGIN - height, width, height)
        self.raise_()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Stay at the picture's edge as the picture or the window changes its size."""
        if self.running and event.type() in (QEvent.Type.Resize, QEvent.Type.Move):
            self._arrange()
        return super().eventFilter(watched, event)

    def _present_pins(self) -> frozenset[int]:
        editor = self._editor
        pins = [h.id for h in editor.edit.handles if h.kind == "pin"] if editor.is_open else []
        return frozenset(pins)

    def _hear(self, change: Change) -> None:
        if self._step is None or self._step < 0:
            return
        pins = self._pins
        self._pins = self._present_pins()
        if isinstance(change, ModelOpened):  # whose pins and camera nobody has made here
            return
        added = len(self._pins - pins)
        self._done |= {n for n, s in enumerate(_STEPS) if s.done and s.done(change, added)}
        if self._step in self._done:
            self._pause.start()  # again with each change, so not amid a drag of the view

    def _go_on_if_done(self) -> None:
        if self._editor.dragging:
            self._pause.start()
        elif self._step in self._done:
            self.go_on()
