"""What all widgets of the timeline show alike: the scale, and keys that are being dragged."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtGui import QWheelEvent

from deformer_app.viewer.timeline.keys import KeyName
from deformer_app.viewer.timeline.scale import Scale
from deformer_app.viewer.timeline.timeline import Timeline

LABELS = 164  # pixels left of the frames, for the names of rows or for buttons
_SCROLL_BAR = 10  # pixels that the bar of the rows may cover at the right, as in the style sheet
_ZOOM = 1.2  # a notch of the wheel
_NOTCH = 120  # Qt's units of a notch


class TimelineView:
    """The scale of a timeline, for all docks that show it.

    Args:
        timeline: whose keys are shown.

    Attributes:
        timeline: the timeline.
        scale: where frames are, in pixels right of `LABELS`.
        shift: frames by which the selected keys are being dragged.
        on_change: called after every change of scale or shift.
    """

    def __init__(self, timeline: Timeline) -> None:
        """Start with any scale; `fit` finds the one that shows the whole clip."""
        self.timeline, self.scale, self.shift = timeline, Scale(), 0
        self.on_change: list[Callable[[], Any]] = []
        self._fitted_to = (0, 0)
        timeline.on_change.append(lambda: self.fit(self._fitted_to[1]))

    @property
    def moving(self) -> frozenset[KeyName]:
        """Names of the keys that are being dragged."""
        return self.timeline.selected if self.shift else frozenset()

    def drag(self, shift: int) -> None:
        """Show the selected keys so many frames from where they are."""
        self.shift = shift
        self._tell()

    def fit(self, width: int) -> None:
        """Show the whole clip once its length or the width of a widget (pixels) has changed."""
        wanted = (self.timeline.clip.length, width)
        if wanted != self._fitted_to:
            self._fitted_to = wanted
            self._show(Scale.of(wanted[0], width - LABELS - _SCROLL_BAR))

    def turn(self, wheel: QWheelEvent, x: float) -> None:
        """Zoom about a pixel right of `LABELS` by the wheel; with Shift, or sideways, scroll."""
        delta = wheel.angleDelta()
        shift = wheel.modifiers() & Qt.KeyboardModifier.ShiftModifier
        sideways = delta.x() or (delta.y() if shift else 0)
        if sideways:
            self._show(self.scale.scrolled(-sideways, self.timeline.clip.length))
        else:
            self._show(self.scale.zoomed(_ZOOM ** (delta.y() / _NOTCH), x))
        wheel.accept()

    def _show(self, scale: Scale) -> None:
        self.scale = scale
        self._tell()

    def _tell(self) -> None:
        for listener in tuple(self.on_change):
            listener()
