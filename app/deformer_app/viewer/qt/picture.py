"""The widget that VTK draws into."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QEvent, Qt
from PySide6.QtGui import QKeyEvent, QMouseEvent, QWheelEvent
from pyvistaqt import QtInteractor

from deformer_app.viewer.events import Button
from deformer_app.viewer.typed_numbers import KEYS

_BUTTONS: dict[Qt.MouseButton, Button] = {
    Qt.MouseButton.LeftButton: "left",
    Qt.MouseButton.MiddleButton: "middle",
    Qt.MouseButton.RightButton: "right",
}


class Picture(QtInteractor):
    """VTK in a widget that shows what has been drawn.

    pyvistaqt (0.13.1) draws every frame a second time to show it, in case the scene has changed
    since; here it has not. Drawn in software, that halved the rate.

    Attributes:
        takes_numbers: says whether keys that are part of a number are for the picture now.
        buttons: those that are down while the mouse moves; None outside of such an event.
    """

    buttons: frozenset[Button] | None = None
    takes_numbers: Callable[[], bool] = staticmethod(lambda: False)
    _drawn = False

    def event(self, ev: QEvent) -> bool:
        """Keep keys that are part of a number from being shortcuts, and Tab from leaving."""
        if isinstance(ev, QKeyEvent) and self._is_for_number(ev):
            if ev.type() == QEvent.Type.ShortcutOverride:
                ev.accept()
                return True
            if ev.type() == QEvent.Type.KeyPress:
                super().keyPressEvent(ev)
                return True
        return super().event(ev)

    def _is_for_number(self, ev: QKeyEvent) -> bool:
        others = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier
        if not self.takes_numbers() or ev.modifiers() & others:
            return False
        return self._GetKeyCharAndKeySym(ev)[1] in KEYS

    def keyPressEvent(self, ev: QKeyEvent) -> None:
        """Leave a key to the window; VTK gets those alone that are part of a number."""
        ev.ignore()

    def keyReleaseEvent(self, ev: QKeyEvent) -> None:
        """Leave a key to the window."""
        ev.ignore()

    def mouseMoveEvent(self, ev: QMouseEvent) -> None:
        """Report the move, with the buttons that are down."""
        self.buttons = frozenset(name for button, name in _BUTTONS.items() if button & ev.buttons())
        super().mouseMoveEvent(ev)
        self.buttons = None

    def mouseReleaseEvent(self, ev: QMouseEvent) -> None:
        """Report the button that has come up.

        pyvistaqt (0.13.1) reports the one pressed last: with two down, the other stayed down.
        """
        self._active_button = ev.button()
        super().mouseReleaseEvent(ev)

    def wheelEvent(self, ev: QWheelEvent) -> None:
        """Report the wheel with the keys that are down.

        pyvistaqt (0.13.1) reports those of the last move: Shift and the wheel did not reach a pin.
        """
        at, (ctrl, shift) = ev.position(), self._GetCtrlShift(ev)
        self._setEventInformation(at.x(), at.y(), ctrl, shift, chr(0))
        super().wheelEvent(ev)

    def close(self) -> None:
        """Free what has been drawn.

        pyvistaqt (0.13.1) keeps the wrapper of a surface that Qt then deletes: PySide would take
        for it whatever Qt allocates there next, such as a button of the next window.
        """
        super().close()
        self._forget_context()

    def _cb_frame(self, obj: Any, evt: Any) -> None:
        self._drawn = not self._in_paint
        super()._cb_frame(obj, evt)

    def resizeGL(self, w: int, h: int) -> None:
        """Discard the frame, which has another size."""
        self._drawn = False
        super().resizeGL(w, h)

    def paintGL(self) -> None:
        """Show the frame, drawing it first if necessary."""
        self._in_paint, self._drawn = self._drawn, False
        super().paintGL()
        self._in_paint = False
