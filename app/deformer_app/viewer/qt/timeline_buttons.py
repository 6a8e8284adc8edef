"""The buttons of the timeline that more than one dock has."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtWidgets import QToolButton

from deformer_app.viewer.timeline.timeline import Timeline


def tool_button(text: str, tip: str, run: Callable[[], Any]) -> QToolButton:
    """Return a narrow button with a text and a tool tip that runs a function."""
    button = QToolButton()
    button.setText(text)
    button.setToolTip(tip)
    button.setProperty("narrow", True)
    button.clicked.connect(lambda _=False: run())
    return button


class TimelineButtons:
    """Buttons that go to keys, play and key.

    Args:
        timeline: what they act on.

    Attributes:
        previous, play, next: go to the key before, play or stop, go to the next key.
        key: sets keys at the playhead.
    """

    def __init__(self, timeline: Timeline) -> None:
        """Make them; a layout places them."""
        self._timeline = timeline
        self.previous = tool_button("◂◆", "Previous key  Ctrl+Left", lambda: timeline.go_to_key(-1))
        self.play = tool_button("▶", "Play or stop  Space", timeline.play_or_stop)
        self.next = tool_button("◆▸", "Next key  Ctrl+Right", lambda: timeline.go_to_key(1))
        self.key = tool_button("◆ Key", "Key the selected handles, or all  K", timeline.keys.set)
        timeline.on_change.append(self._show)

    def _show(self) -> None:
        self.play.setText("■" if self._timeline.playing else "▶")

    @property
    def playback(self) -> tuple[QToolButton, ...]:
        """The buttons that move the playhead."""
        return self.previous, self.play, self.next
