"""The widget that VTK draws into."""

from __future__ import annotations

from typing import Any

from pyvistaqt import QtInteractor


class Picture(QtInteractor):
    """VTK in a widget that shows what has been drawn.

    pyvistaqt (0.13.1) draws every frame a second time to show it, in case the scene has changed
    since; here it has not. Drawn in software, that halved the rate.
    """

    _drawn = False

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
