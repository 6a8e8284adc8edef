"""The window's recordings of what the picture shows, and turntables."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from deformer_app.viewer.actions import Shell
from deformer_app.viewer.recording import Recorder, save_recording, save_turntable

_MOVIES = "Animations (*.gif *.mp4)"
_RECORDINGS = "Animations and shapes (*.mp4 *.gif *.glb *.mdd *.pc2 *.usd *.usda *.usdc *.npz)"


class Recordings:
    """Records the picture and asks where to save it.

    Args:
        shell: the window.
        show: called with True when a recording begins, with False when it ends.
    """

    def __init__(self, shell: Shell, show: Callable[[bool], Any]) -> None:
        """Begin without a recording."""
        self._shell, self._show = shell, show
        self._recorder: Recorder | None = None

    @property
    def running(self) -> bool:
        """True while the picture is being recorded."""
        return self._recorder is not None

    def toggle(self) -> None:
        """Begin a recording, or end it and save it."""
        shell = self._shell
        if self._recorder is None:
            self._recorder = Recorder(shell.editor)
            self._show(True)
            return
        recorder, self._recorder = self._recorder, None
        self._show(False)
        pictures = recorder.stop()
        path = shell.ask_save("Save recording", "drag.mp4", _RECORDINGS)
        if path is not None:
            shell.editor.run(save_recording(shell.editor, path, pictures))

    def turntable(self) -> None:
        """Ask for a file and write a turntable."""
        path = self._shell.ask_save("Save turntable", "turntable.gif", _MOVIES)
        if path is not None:
            self._shell.editor.run(save_turntable(self._shell.editor, path))
