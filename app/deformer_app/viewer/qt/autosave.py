"""The autosave: the session in the program's own folder, soon after every change."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from PySide6.QtWidgets import QWidget

from deformer import InputError
from deformer_app.viewer.changes import (
    Change,
    ComponentsNamed,
    HistoryChanged,
    MistakeMade,
    PosesChanged,
)
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.later import later
from deformer_app.viewer.settings import Settings
from deformer_app.viewer.thumbnails import save_thumbnail

_FIRST, _NEXT = 100, 1500  # milliseconds from a change until it is written
_LONGEST = 10.0  # seconds that one which is not at rest waits for its pose


class Autosave:
    """Writes the session of an editor to a file while it has changes that no other file has.

    The first change is written at once, later ones when the pose is at rest, but none waits longer
    than a few seconds. A file of a session that has no such changes any more, as by undo, is
    deleted: a crash would offer what the user has left.

    Args:
        parent: the window.
        editor: has the session.
        settings: say where it is written; its picture has the same name with the ending ".png".
        file: says where the user has saved the session; None for nowhere.

    Attributes:
        path: the file.
    """

    def __init__(
        self, parent: QWidget, editor: Editor, settings: Settings, file: Callable[[], Path | None]
    ) -> None:
        """Listen to the editor."""
        self._editor, self._settings, self._file = editor, settings, file
        self.path = settings.autosave
        self._timer = later(parent, _NEXT, self._write_if_due)
        self._since = 0.0  # when the first change was made that is not written yet
        editor.on_change.append(self._hear)

    def _begin(self) -> None:
        """Write soon, unless there is nothing to lose."""
        if not self._timer.isActive():
            self._since = time.monotonic()
            self._timer.start(_NEXT if self.path.exists() else _FIRST)

    def end(self) -> None:
        """Write no more."""
        self._timer.stop()

    def write(self, wait: bool = True) -> Path:
        """Write the session; return the file.

        Args:
            wait: True to wait for the pose of the present state, which is written with it.
        """
        editor = self._editor
        editor.write_copy(self.path, self._file(), wait)
        save_thumbnail(editor, self.path.with_suffix(".png"))
        return self.path

    def _hear(self, change: Change) -> None:
        if isinstance(change, HistoryChanged | PosesChanged | ComponentsNamed):
            self._begin()

    def _write_if_due(self) -> None:
        editor = self._editor
        if not editor.is_open:
            return
        if not editor.session.changed:
            self._settings.forget(self.path)
            return
        now, rests = time.monotonic(), editor.at_rest
        if rests or not self.path.exists() or now - self._since > _LONGEST:
            self._since = now
            try:
                self.write(wait=False)
            except (InputError, OSError) as error:
                editor.announce(MistakeMade.of(error))
        if not rests:  # once more, with its pose
            self._timer.start(_NEXT)
