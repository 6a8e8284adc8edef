"""The first seconds of `deformer edit`: a window at once, and everything heavy beside it.

VTK, pyvista and the numerics take seconds to import. A thread imports them while a plain window is
on the screen and says so; the editor's window then replaces it. This module imports only Qt.
"""

from __future__ import annotations

import importlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, cast

from PySide6.QtCore import (
    QEventLoop,
    QSize,
    QSocketNotifier,
    Qt,
    QTimer,
    QtMsgType,
    qInstallMessageHandler,
)
from PySide6.QtGui import QFont
from PySide6.QtWidgets import QApplication, QLabel, QProgressBar, QVBoxLayout, QWidget

from deformer_app.viewer.qt.icons import window_icon
from deformer_app.viewer.qt.project_style import ProjectStyle
from deformer_app.viewer.qt.theme import apply_theme, preferred_theme
from deformer_app.viewer.settings import EditInterrupted, Settings

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
        self.resize(QSize(*_SIZE).boundedTo(self.screen().availableSize()))
        column = QVBoxLayout(self)
        column.setAlignment(Qt.AlignmentFlag.AlignCenter)
        column.setSpacing(14)
        bar = QProgressBar()
        bar.setRange(0, 0)
        bar.setFixedSize(240, 6)
        for text, rank in (("Deformer", "title"), ("Loading what computes and draws …", "second")):
            label = QLabel(text)
            label.setProperty("rank", rank)
            column.addWidget(label, alignment=Qt.AlignmentFlag.AlignCenter)
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


class _CtrlC:
    """Ctrl-C in the terminal, as something that Qt's loop hears.

    Attributes:
        pressed: true after Ctrl-C.
    """

    def __init__(self) -> None:
        """Nobody listens yet."""
        self.pressed = False
        self._listener: Callable[[], object] = lambda: None

    def heard_by(self, listener: Callable[[], object]) -> None:
        """Have `listener` called in Qt's loop, in place of the one before."""
        self._listener = listener
        self.tell()

    def press(self, number: int, frame: object) -> None:
        """Handle the signal: Python may be anywhere, so only note it."""
        self.pressed = True

    def tell(self) -> None:
        """Call the listener after Ctrl-C."""
        if self.pressed:
            self._listener()


@contextmanager
def _ctrl_c() -> Iterator[_CtrlC]:
    """Within the block, Ctrl-C wakes Qt's loop, which would else not give Python its turn."""
    found, previous = _CtrlC(), signal.getsignal(signal.SIGINT)
    if not callable(previous):  # a shell has the command ignore it
        yield found
        return
    reader, writer = socket.socketpair()
    for end in (reader, writer):
        end.setblocking(False)
    notifier = QSocketNotifier(reader.fileno(), QSocketNotifier.Type.Read)

    def woken() -> None:
        reader.recv(64)
        found.tell()

    notifier.activated.connect(woken)
    wakeup = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    signal.signal(signal.SIGINT, found.press)
    try:
        yield found
    finally:
        signal.signal(signal.SIGINT, previous)
        signal.set_wakeup_fd(wakeup)
        notifier.setEnabled(False)
        reader.close()
        writer.close()


@contextmanager
def _fatal_messages_told() -> Iterator[None]:
    """Within the block, what makes Qt abort is one line on stderr and exit status 2."""
    told: list[str] = []

    def hear(kind: QtMsgType, context: object, text: str) -> None:
        told.append(text)
        if kind == QtMsgType.QtFatalMsg:  # Qt aborts the process after this
            line = " ".join(told[0].split())
            os.write(2, f"deformer: edit: no window can be opened: {line}\n".encode())
            os._exit(2)

    before = qInstallMessageHandler(hear)
    try:
        yield
    finally:
        qInstallMessageHandler(before)


def run_editor(model: str | None, saved: Session | None, path: Path | None) -> Session | None:
    """Show the editor until its window is closed.

    Args:
        model: directory or name of the model to open; None shows the start page.
        saved: the session to go on with, or None.
        path: file of that session, or None.

    Returns:
        The session; None if the window was closed before there was one.

    Raises:
        EditInterrupted: Ctrl-C in the terminal.
    """
    with _fatal_messages_told():
        app = cast(QApplication, QApplication.instance() or QApplication(sys.argv[:1]))
    with _ctrl_c() as ctrl_c:
        return _run_editor(app, ctrl_c, model, saved, path)


def program_font() -> QFont:
    """Return the system's font, in a size that can be read."""
    font = QFont()
    font.setPointSizeF(max(font.pointSizeF(), 9.5))
    return font


def _run_editor(
    app: QApplication,
    ctrl_c: _CtrlC,
    model: str | None,
    saved: Session | None,
    path: Path | None,
) -> Session | None:
    app.setApplicationName("Deformer")
    app.setStyle(ProjectStyle())
    app.setWindowIcon(window_icon())
    app.setFont(program_font())
    settings = Settings()
    apply_theme(preferred_theme(settings))
    opening_window = _OpeningWindow()
    opening_window.show()
    importing = _Importing()
    importing.start()
    waiting = QEventLoop()  # QApplication.quit would close the window
    ctrl_c.heard_by(opening_window.close)
    app.lastWindowClosed.connect(waiting.quit)
    timer = QTimer()
    timer.timeout.connect(lambda: None if importing.is_alive() else waiting.quit())
    timer.start(_POLL)
    waiting.exec()
    timer.stop()
    app.lastWindowClosed.disconnect(waiting.quit)
    importing.join()
    if ctrl_c.pressed or not opening_window.isVisible() or importing.error is not None:
        settings.close()
        if ctrl_c.pressed:
            raise EditInterrupted(None)
        if importing.error is not None:
            raise importing.error
        return None
    from deformer_app.viewer.qt.window import Window

    window = Window(settings)
    ctrl_c.heard_by(window.close_keeping)
    window.show()
    app.processEvents()  # draws the window before the other one closes
    opening_window.close()
    QTimer.singleShot(0, lambda: window.begin(model, saved, path))
    sys.excepthook = window.unexpected
    if window.isVisible():  # it may have been closed already
        app.exec()
    if ctrl_c.pressed:
        raise EditInterrupted(window.kept)
    return window.editor.session if window.editor.is_open else None
