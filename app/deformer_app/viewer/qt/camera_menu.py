"""The menu of saved cameras, with keys for the first nine."""

from __future__ import annotations

from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import QMenu, QWidget

from deformer_app.viewer.editor import Editor

_KEYS = 9


class CameraMenu(QMenu):
    """Saved cameras by their names; another menu forgets them.

    Args:
        window: its keys are those of the cameras.
    """

    def __init__(self, window: QWidget) -> None:
        """Begin empty."""
        super().__init__("Cameras", window)
        self._forget = QMenu("Forget", window)
        self._names: list[str] = []
        self.setEnabled(False)

    def refresh(self, editor: Editor) -> None:
        """Show the cameras of an editor."""
        names = editor.state.cameras.names
        if names == self._names:
            return
        self._names = names
        self.clear()
        self._forget.clear()
        self.setEnabled(bool(names))
        for n, name in enumerate(names):
            item = self.addAction(name.replace("&", "&&"))
            if n < _KEYS:
                item.setShortcut(QKeySequence(f"Alt+{n + 1}"))
            item.triggered.connect(lambda _=False, name=name: self._look(editor, name))
            gone = self._forget.addAction(name.replace("&", "&&"))
            gone.triggered.connect(lambda _=False, name=name: self._remove(editor, name))
        self.addSeparator()
        self.addMenu(self._forget)

    def _look(self, editor: Editor, name: str) -> None:
        editor.state.viewpoint.set_camera(editor.state.cameras[name])

    def _remove(self, editor: Editor, name: str) -> None:
        editor.state.cameras.remove(name)
        editor.touch()
