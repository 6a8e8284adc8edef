"""The tour: a line below the picture whose next step follows when the user has done this one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QTimer

from deformer_app.viewer.changes import CameraMoved, Change, HandlesDragged, ModelOpened
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.later import later
from deformer_app.viewer.qt.strip import Strip

_PAUSE = 900  # milliseconds between what the user does and the next step
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

    A step that the user has done before its turn is left out.

    Args:
        editor: what the user tries it on.
    """

    def __init__(self, editor: Editor) -> None:
        """Start hidden."""
        super().__init__("tour", ("Next", self.go_on), ("End tour", self.end), ("Done", self.end))
        self.read_html()
        self._editor = editor
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
