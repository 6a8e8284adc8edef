"""Files and folders dropped anywhere on the window."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QEvent, QObject
from PySide6.QtGui import QCursor, QDragEnterEvent, QDropEvent
from PySide6.QtWidgets import QMenu, QWidget

from deformer import InputError
from deformer_app.viewer.actions import Shell
from deformer_app.viewer.dropped import kind_of
from deformer_app.viewer.pose_commands import import_poses
from deformer_app.viewer.qt.icons import put_icon
from deformer_app.viewer.rigs import load_handles


class Drops(QObject):
    """Opens what is dropped on a window.

    Args:
        window: where it is dropped.
        shell: the same window, for commands.
        attempt: runs a function and shows its mistake.
    """

    def __init__(
        self, window: QWidget, shell: Shell, attempt: Callable[[Callable[[], Any]], bool]
    ) -> None:
        """Accept drops from now on."""
        super().__init__(window)
        self._window, self._shell, self._attempt = window, shell, attempt
        window.setAcceptDrops(True)
        window.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Take files and folders, and nothing else."""
        if isinstance(event, QDragEnterEvent) and _paths(event):
            event.acceptProposedAction()
            return True
        if isinstance(event, QDropEvent) and event.type() == QEvent.Type.Drop and _paths(event):
            event.acceptProposedAction()
            paths = _paths(event)
            self._attempt(lambda: self.open(paths))
            return True
        return super().eventFilter(watched, event)

    def open(self, paths: list[Path]) -> None:
        """Open the one path that was dropped.

        Raises:
            InputError: several paths, or nothing that can be opened.
        """
        if len(paths) != 1:
            raise InputError(
                f"{paths[0]} and {len(paths) - 1} more were dropped: drop one file, or the folder "
                "of shapes to train on"
            )
        (path,), shell = paths, self._shell
        kind = kind_of(path)
        if kind == "model":
            shell.open_model(path)
        elif kind == "session":
            shell.open_session(path)
        elif kind == "shapes":
            shell.train().choose(path)
        elif not shell.editor.is_open:
            train = "; to train one, drop the folder of its shapes" if kind == "mesh" else ""
            raise InputError(
                f"{path}: {kind} can be used with a model only; open the model first{train}"
            )
        elif kind == "handles":
            load_handles(shell.editor, path)
        elif kind == "poses":
            import_poses(shell.editor, path)
        elif kind == "picture":
            shell.editor.picture.open_reference(path)
        else:
            self._ask_use(path)

    def _ask_use(self, path: Path) -> None:
        """Ask what a mesh is for, where it was dropped."""
        editor, menu = self._shell.editor, QMenu(self._window)
        for title, name, run in (
            ("Start from this mesh", "file-box", editor.prior.start_from_mesh),
            ("Compare with this mesh", "target", editor.picture.load_target),
            ("Train on its shapes…", "graduation-cap", lambda p: self._shell.train().choose(p)),
        ):
            item = menu.addAction(title)
            put_icon(item, name)
            item.triggered.connect(lambda _=False, f=run: self._attempt(lambda: f(path)))
        menu.popup(QCursor.pos())


def _paths(event: QDropEvent) -> list[Path]:
    return [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
