"""Dialogs that ask for files; each opens in the folder of the last one."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QFileDialog, QWidget


class FileDialogs:
    """Asks for files and folders.

    Args:
        parent: the window.
    """

    def __init__(self, parent: QWidget) -> None:
        """Start in the working directory."""
        self._parent = parent
        self._folder = Path.cwd()

    def ask_open(self, title: str, files: str) -> Path | None:
        """Ask for a file to read; None if the user cancels."""
        name, _ = QFileDialog.getOpenFileName(self._parent, title, str(self._folder), files)
        return self._chosen(name)

    def ask_folder(self, title: str) -> Path | None:
        """Ask for a folder; None if the user cancels."""
        name = QFileDialog.getExistingDirectory(self._parent, title, str(self._folder))
        return self._chosen(name)

    def ask_save(self, title: str, name: str, files: str) -> Path | None:
        """Ask for a file to write; None if the user cancels."""
        dialog = QFileDialog(self._parent, title, str(self._folder / name), files)
        dialog.setAcceptMode(QFileDialog.AcceptMode.AcceptSave)
        dialog.setDefaultSuffix(Path(name).suffix)
        return self._chosen(dialog.selectedFiles()[0] if dialog.exec() else "")

    def _chosen(self, name: str) -> Path | None:
        if not name:
            return None
        self._folder = Path(name).parent
        return Path(name)
