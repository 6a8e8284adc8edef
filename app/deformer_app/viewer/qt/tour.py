"""The tour: a line below the picture whose next step follows when the user has done this one."""

from __future__ import annotations

from PySide6.QtCore import QTimer

from deformer_app.viewer.changes import CameraMoved, Change, HandlesDragged, HistoryChanged
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.notices import Strip

_PAUSE = 900  # milliseconds between what the user does and the next step
_POLL = 200  # milliseconds between two looks whether the solver is ready
_WAITING = "The tour begins when the solver is ready. Drag anywhere to look around meanwhile."
# Text of each step, and the change that completes it.
_STEPS: tuple[tuple[str, type[Change] | None], ...] = (
    (
        "Press the left button on the surface and pull. The rest follows as in the examples.",
        HandlesDragged,
    ),
    ("Drag beside the body to look around it; the wheel zooms to the cursor.", CameraMoved),
    ("Click a place that should stay, and press P: it is pinned.", HistoryChanged),
    ("Ctrl+Z takes a step back, without end. F1 lists all keys. Enjoy!", None),
)


class Tour(Strip):
    """The steps of the tour, one at a time; the first waits for a solver that answers to drags.

    Args:
        editor: what the user tries it on.
    """

    def __init__(self, editor: Editor) -> None:
        """Start hidden."""
        super().__init__("tour", ("Next", self.go_on), ("End tour", self.end))
        self.read_html()
        self._editor = editor
        self._step: int | None = None  # −1 while the solver is being prepared
        self._timer = QTimer(self)
        self._timer.setInterval(_POLL)
        self._timer.timeout.connect(self._look)
        editor.on_change.append(self._hear)

    @property
    def running(self) -> bool:
        """True while a step is shown, or the tour waits for the solver."""
        return self._step is not None

    def begin(self) -> None:
        """Show the first step, as soon as the solver is ready."""
        if self._editor.preparing:
            self._step = -1
            self.say(_WAITING)
            self.show()
            self._timer.start()
        else:
            self._show(0)

    def _look(self) -> None:
        if self._step != -1:  # gone on or ended
            self._timer.stop()
        elif not self._editor.preparing:
            self._show(0)

    def go_on(self) -> None:
        """Show the next step, or end after the last one."""
        step = -1 if self._step is None else self._step
        if step + 1 < len(_STEPS):
            self._show(step + 1)
        else:
            self.end()

    def end(self) -> None:
        """Hide the tour."""
        self._step = None
        self.hide()

    def _show(self, step: int) -> None:
        self._step = step
        self.say(f"<b>{step + 1} of {len(_STEPS)}</b>&nbsp;&nbsp; {_STEPS[step][0]}")
        self.show()

    def _hear(self, change: Change) -> None:
        if self._step is None or self._step < 0:
            return
        done_by = _STEPS[self._step][1]
        if done_by is not None and isinstance(change, done_by):
            QTimer.singleShot(_PAUSE, lambda step=self._step: self._go_on_from(step))

    def _go_on_from(self, step: int) -> None:
        if self._step == step and not self._editor.dragging:
            self.go_on()
