"""The first seconds of `deformer edit`: a window at once, and everything heavy beside it.

VTK, pyvista and the numerics take seconds to import. A thread imports them while a plain window is
on the screen and says so; the editor's window then replaces it. This module imports only Qt.
"""

from __future__ import annotations

import importlib
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, cast

from PySide6.QtCore import QEventLoop, Qt, QTimer
from PySide6.QtGui import QFont
from PySide6.QtWidgets import QApplication, QLabel, QProgressBar, QVBoxLayout, QWidget

if TYPE_CHECKING:
    from deformer_app.viewer.session import Session

_POLL = 10  # milliseconds between two looks at the thread
_SIZE = (1360, 880)


class _OpeningWindow(QWidget):
    """The window on the screen until the editor is ready."""

    def __init__(self) -> None:
        """Say what is going on."""
        super().__init__()
        self.setWindowTitle("Deformer")
        self.resize(*_SIZE)
        column = QVBoxLayout(self)
        column.setAlignment(Qt.AlignmentFlag.AlignCenter)
        text = QLabel("Loading the model and the picture…")
        text.setAlignment(Qt.AlignmentFlag.AlignCenter)
        bar = QProgressBar()
        bar.setRange(0, 0)
        bar.setFixedSize(240, 8)
        column.addWidget(text)
        column.addWidget(bar, alignment=Qt.AlignmentFlag.AlignCenter)


class _Importing(threading.Thread):
    """Imports the editor's window.

    Attributes:
        error: what went wrong, or None.
    """

    def __init__(self) -> None:
        """Prepare the thread."""
        super().__init__(name="importing", daemon=True)
        self.error: BaseException | None = None

    def run(self) -> None:
        """Import; store a failure for the thread of the window."""
        try:
            importlib.import_module("deformer_app.viewer.qt.window")
        except BaseException as error:
            self.error = error


def run_editor(model: str, saved: Session | None, path: Path | None) -> Session | None:
    """Show the editor until its window is closed.

    Args:
        model: directory or name of the model to open.
        saved: the session to go on with, or None.
        path: file of that session, or None.

    Returns:
        The session; None if the window was closed before there was one.
    """
    app = cast(QApplication, QApplication.instance() or QApplication(sys.argv[:1]))
    app.setApplicationName("Deformer")
    app.setStyle("Fusion")
    font = QFont()
    font.setPointSizeF(max(font.pointSizeF(), 9.5))
    app.setFont(font)
    opening_window = _OpeningWindow()
    opening_window.show()
    importing = _Importing()
    importing.start()
    waiting = QEventLoop()  # QApplication.quit would close the window
    app.lastWindowClosed.connect(waiting.quit)
    timer = QTimer()
    timer.timeout.connect(lambda: None if importing.is_alive() else waiting.quit())
    timer.start(_POLL)
    waiting.exec()
    timer.stop()
    app.lastWindowClosed.disconnect(waiting.quit)
    importing.join()
    if not opening_window.isVisible():
        return None
    if importing.error is not None:
        raise importing.error
    from deformer_app.viewer.qt.window import Window
    from deformer_app.viewer.settings import Settings

    window = Window(Settings())
    window.show()
    app.processEvents()  # draws the window before the other one closes
    opening_window.close()
    QTimer.singleShot(0, lambda: window.begin(model, saved, path))
    sys.excepthook = window.unexpected
    if window.isVisible():  # it may have been closed already
        app.exec()
    return window.editor.session if window.editor.is_open else None
