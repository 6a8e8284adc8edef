"""The Qt window: menus, docks, dialogs and a timer around an editor."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QByteArray, QObject, Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QApplication,
    QDockWidget,
    QInputDialog,
    QLabel,
    QMainWindow,
    QMessageBox,
    QVBoxLayout,
    QWidget,
)

from deformer import InputError
from deformer_app.viewer.actions import Action
from deformer_app.viewer.changes import (
    Change,
    FrameDrawn,
    HistoryChanged,
    LookChanged,
    MistakeMade,
    ModelOpened,
    NoticeGiven,
    PoseChanged,
)
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.component_panel import ComponentPanel
from deformer_app.viewer.qt.file_dialogs import FileDialogs
from deformer_app.viewer.qt.handle_panel import HandlePanel
from deformer_app.viewer.qt.help_dialog import HelpDialog
from deformer_app.viewer.qt.menus import Menus
from deformer_app.viewer.qt.model_panel import ModelPanel
from deformer_app.viewer.qt.notices import Notices
from deformer_app.viewer.qt.picture import Picture
from deformer_app.viewer.qt.theme import apply_theme
from deformer_app.viewer.qt.tour import Tour
from deformer_app.viewer.qt.training_dialog import TrainingDialog
from deformer_app.viewer.recording import Recorder, save_recording, save_turntable
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.session import Session
from deformer_app.viewer.settings import Settings
from deformer_app.viewer.vtk_input import listen

_TICK = 4  # milliseconds between two ticks while the editor is busy
_PANELS = 120  # milliseconds after a change until the docks show it
_AUTOSAVE = 1500  # milliseconds after a step until the autosave
_PATIENCE = 700  # milliseconds of preparation after which the user is told
_MOVIES = "Animations (*.gif *.mp4)"
_RECORDINGS = "Animations and shapes (*.mp4 *.gif *.glb *.mdd *.pc2 *.usd *.usda *.usdc *.npz)"


class _Wake(QObject):
    """Carries a call from the solver's thread to the window's."""

    called = Signal()


class Window(QMainWindow):
    """An editor with menus and docks.

    Args:
        settings: what is remembered between two starts.

    Attributes:
        editor: what the user works with.
        menus, notices, tour: parts of the window.
        model_panel, handle_panel, component_panel: the docks.
        training: the dialog that trains a model, once it has been opened.
    """

    def __init__(self, settings: Settings) -> None:
        """Build the window, without a model."""
        super().__init__()
        self.settings = settings
        self.setWindowTitle("Deformer")
        self.resize(1360, 880)
        self.training: TrainingDialog | None = None
        self._file: Path | None = None
        self._dialogs = FileDialogs(self)
        self._recorder: Recorder | None = None
        self._help: HelpDialog | None = None
        self._may_close = False
        self._kept: Path | None = None  # the autosave, after Ctrl-C

        self._wake = _Wake()
        self._timer = QTimer(self)
        self._timer.setInterval(_TICK)
        self._timer.timeout.connect(self._tick)
        self._wake.called.connect(self._awake)
        self._refresh_soon = self._delayed(_PANELS, self._refresh)
        self._autosave = self._delayed(_AUTOSAVE, self._write_autosave)

        centre = QWidget()
        self.plotter = Picture(centre, auto_update=False, multi_samples=0)
        self.editor = Editor(
            MeshView(self.plotter, density=self.plotter.devicePixelRatioF), self._wake.called.emit
        )
        self.editor.on_change.append(self._hear)
        listen(self.editor.state.view, self.editor.controller.handle)
        self.tour = Tour(self.editor)
        column = QVBoxLayout(centre)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.plotter, 1)
        column.addWidget(self.tour)
        self.setCentralWidget(centre)
        self.notices = Notices(self.plotter, lambda: self.attempt(self.record))
        self.menus = Menus(self, self._run)
        self.menus.recent.aboutToShow.connect(self._list_recent)
        self._add_docks()
        self._hint, self._times = QLabel(), QLabel()
        self.statusBar().addWidget(self._hint, 1)
        self.statusBar().addPermanentWidget(self._times)
        QShortcut(QKeySequence("Esc"), self, self.escape)
        self._restore_layout()

    def _delayed(self, milliseconds: int, run: Callable[[], None]) -> QTimer:
        timer = QTimer(self)
        timer.setSingleShot(True)
        timer.setInterval(milliseconds)
        timer.timeout.connect(run)
        return timer

    def _add_docks(self) -> None:
        self.model_panel = ModelPanel(self.editor)
        self.handle_panel = HandlePanel(self.editor)
        self.component_panel = ComponentPanel(self.editor)
        left, right = Qt.DockWidgetArea.LeftDockWidgetArea, Qt.DockWidgetArea.RightDockWidgetArea
        docks = []
        for title, panel, area in (
            ("Model", self.model_panel, left),
            ("Handles", self.handle_panel, right),
            ("Components", self.component_panel, right),
        ):
            dock = QDockWidget(title, self)
            dock.setObjectName(title)
            dock.setWidget(panel)
            self.addDockWidget(area, dock)
            self.menus.menus["View"].addAction(dock.toggleViewAction())
            docks.append(dock)
        model, handles, components = docks
        self.resizeDocks([handles, components], [330, 370], Qt.Orientation.Vertical)
        self.resizeDocks([model, handles], [250, 310], Qt.Orientation.Horizontal)

    def _restore_layout(self) -> None:
        geometry, docks = (QByteArray.fromBase64(part.encode()) for part in self.settings.layout)
        self.restoreGeometry(geometry)
        self.restoreState(docks)

    def _note_layout(self) -> None:
        parts = (self.saveGeometry(), self.saveState())
        self.settings.note_layout(*(bytes(part.toBase64().data()).decode() for part in parts))

    @property
    def idle(self) -> bool:
        """True once the picture and the docks show the editor's state."""
        return self.editor.idle and not self._refresh_soon.isActive()

    # Models and sessions.

    def begin(self, model: str, session: Session | None, file: Path | None) -> None:
        """Open the first model; offer the autosave of a crash."""
        left = self.settings.left_by_crash()
        self.attempt(lambda: self._open(model, session, file))
        if left is not None and self._restore(left):
            return
        if not self.settings.tour_seen:
            self.settings.note_tour()
            self.tour.begin()

    def _restore(self, left: Path) -> bool:
        answer = QMessageBox.question(
            self,
            "Deformer",
            "The last session did not end well. Open what was saved of it?",
        )
        found = answer == QMessageBox.StandardButton.Yes and self.attempt(
            lambda: self._open_restored(left)
        )
        self.settings.forget(left)
        return bool(found)

    def _open_restored(self, left: Path) -> None:
        session = Session.load(left)
        session.mark_unsaved()
        self._open(session.model.path, session, None)
        self._autosave.start()

    def _open(self, model: str | Path, session: Session | None, file: Path | None) -> None:
        self.notices.hide_mistake()
        self.editor.open_model(model, session)
        self._file = file
        self.settings.remember(str(file.resolve()) if file else self.editor.session.model.path)

    def attempt(self, run: Callable[[], Any]) -> bool:
        """Run a function; on a mistake show its message and return False."""
        try:
            run()
        except (InputError, OSError) as error:
            self.notices.show_mistake(str(error))
            return False
        return True

    def _run(self, action: Action) -> None:
        self.attempt(lambda: action.run(self))
        self._refresh()

    def open_model(self, path: Path | str) -> None:
        """Open a model, unless the user wants to keep unsaved work; offer to train on shapes."""
        folder = Path(path)
        if folder.is_dir() and not (folder / "model.json").exists():
            question = f"{folder} holds no model. Train one on the shapes in it?"
            if QMessageBox.question(self, "Deformer", question) == QMessageBox.StandardButton.Yes:
                self.train().choose(folder)
        elif self.may_leave():
            self.attempt(lambda: self._open(path, None, None))

    def open_session(self, path: Path | str) -> None:
        """Open a session, unless the user wants to keep unsaved work."""

        def load() -> None:
            session = Session.load(path)
            self._open(session.model.path, session, Path(path))

        if self.may_leave():
            self.attempt(load)

    def _list_recent(self) -> None:
        self.menus.recent.clear()
        for name in self.settings.recent:
            opener = self.open_session if name.endswith(".json") else self.open_model
            item = self.menus.recent.addAction(name)
            item.triggered.connect(lambda _=False, n=name, f=opener: f(n))

    def save(self, elsewhere: bool) -> bool:
        """Save the session; return False if the user cancels."""
        path = self._file
        if path is None or elsewhere:
            path = self.ask_save("Save session", "session.json", "Sessions (*.json)")
        if path is None or not self.attempt(lambda: self.editor.save_session(path)):
            return False
        self._file = path
        self.settings.remember(str(path.resolve()))
        self.settings.forget(self.settings.autosave)
        self.statusBar().showMessage(f"Saved {path}", 4000)
        return True

    def may_leave(self) -> bool:
        """Ask if there is unsaved work; return False if the user cancels."""
        if not self.editor.is_open or not self.editor.session.changed:
            return True
        buttons = QMessageBox.StandardButton
        answer = QMessageBox.question(
            self,
            "Deformer",
            "Save the changes to this session?",
            buttons.Save | buttons.Discard | buttons.Cancel,
        )
        if answer == buttons.Save:
            return self.save(False)
        return answer == buttons.Discard

    def _write_autosave(self) -> None:
        if self.editor.is_open and self.editor.session.changed:
            self.attempt(lambda: self.editor.write_copy(self.settings.autosave))

    # Functions that actions call; see `actions.Shell`.

    def ask_open(self, title: str, files: str) -> Path | None:
        """Ask for a file to read."""
        return self._dialogs.ask_open(title, files)

    def ask_folder(self, title: str) -> Path | None:
        """Ask for a folder."""
        return self._dialogs.ask_folder(title)

    def ask_save(self, title: str, name: str, files: str) -> Path | None:
        """Ask for a file to write."""
        return self._dialogs.ask_save(title, name, files)

    def ask_number(self, title: str, about: str, start: int, most: int) -> int | None:
        """Ask for a whole number of 1 to `most`."""
        number, given = QInputDialog.getInt(self, title, about, start, 1, most)
        return number if given else None

    def train(self) -> TrainingDialog:
        """Open the dialog that trains a model on shapes."""
        if self.training is None or self.training.ended:
            self.training = TrainingDialog(self, self.open_model)
        self.training.show()
        return self.training

    @property
    def recording(self) -> bool:
        """True while the picture is being recorded."""
        return self._recorder is not None

    def record(self) -> None:
        """Begin or end a recording."""
        if self._recorder is None:
            self._recorder = Recorder(self.editor)
            self.notices.show_strip(self.notices.recording)
            return
        recorder, self._recorder = self._recorder, None
        self.notices.show_strip(self.notices.recording, False)
        pictures = recorder.stop()
        path = self.ask_save("Save recording", "drag.mp4", _RECORDINGS)
        if path is not None:
            self.editor.run(save_recording(self.editor, path, pictures))

    def turntable(self) -> None:
        """Write a turntable."""
        path = self.ask_save("Save turntable", "turntable.gif", _MOVIES)
        if path is not None:
            self.editor.run(save_turntable(self.editor, path))

    def help(self) -> None:
        """Show or hide the keys and what the mouse does."""
        if self._help is not None and self._help.isVisible():
            self._help.hide()
            return
        self._help = HelpDialog(self)
        self._help.show()

    def begin_tour(self) -> None:
        """Begin the tour."""
        self.tour.begin()

    # Events.

    def unexpected(self, kind: type[BaseException], error: BaseException, trace: Any) -> None:
        """Show an error of the program in the window, too, and continue: the session is intact."""
        sys.__excepthook__(kind, error, trace)
        self.notices.show_mistake(
            f"A fault of the program: {error!r}. Your session is kept; save it."
        )

    def escape(self) -> None:
        """Cancel the current drag; without one, go back to dragging and close the message."""
        if not self.editor.controller.cancel():
            self.editor.state.set_tool("drag")
            self.notices.hide_mistake()

    def _hear(self, change: Change) -> None:
        match change:
            case MistakeMade(text):
                self.notices.show_mistake(text)
            case NoticeGiven(text):
                self.statusBar().showMessage(text, 6000)
            case PoseChanged():
                self.notices.show_strip(self.notices.preparing, False)
            case ModelOpened():
                QTimer.singleShot(_PATIENCE, self._tell_of_preparation)
                self.model_panel.model_changed()
                self.component_panel.model_changed()
            case LookChanged():
                apply_theme(self.editor.state.view.theme)
            case HistoryChanged():
                self._autosave.start()
            case FrameDrawn():
                self._show_times()
        if not self._refresh_soon.isActive():
            self._refresh_soon.start()

    def _tell_of_preparation(self) -> None:
        self.notices.show_strip(self.notices.preparing, self.editor.preparing)

    def _awake(self) -> None:
        if not self._timer.isActive():  # restarting it with every answer would delay it
            self._timer.start()

    def _tick(self) -> None:
        self.editor.tick()
        if self.editor.idle:
            self._timer.stop()

    def _show_times(self) -> None:
        editor = self.editor
        solve = editor.answer.pose.milliseconds if editor.answer else 0.0
        frame = editor.state.view.frame_milliseconds
        text = f"solve {solve:.1f} ms   frame {frame:.1f} ms"
        if editor.latencies:
            text += f"   move to picture {1000 * editor.latencies[-1]:.0f} ms"
        self._times.setText(text)

    def _refresh(self) -> None:
        editor = self.editor
        self.menus.refresh(self)
        if not editor.is_open:
            return
        for panel in (self.model_panel, self.handle_panel, self.component_panel):
            panel.refresh()
        name = self._file.name if self._file else Path(editor.session.model.path).name
        preparing = " (preparing)" if editor.preparing else ""
        self.setWindowTitle(f"{name}[*] – Deformer{preparing}")
        self.setWindowModified(editor.session.changed)
        self._hint.setText(editor.stage.hint)

    def close_unsaved(self) -> None:
        """Close without asking, even with unsaved work."""
        self._may_close = True
        self.close()

    @property
    def kept(self) -> Path | None:
        """The autosave that `close_keeping` has left."""
        return self._kept

    def close_keeping(self) -> None:
        """Close without asking; keep the autosave if there was unsaved work."""
        while (dialog := QApplication.activeModalWidget()) is not None and dialog.close():
            pass
        if self.editor.is_open and self.editor.session.changed:
            self.editor.write_copy(self.settings.autosave)
            self._kept = self.settings.autosave
        self.close_unsaved()

    def closeEvent(self, event: QCloseEvent) -> None:
        """Ask if there is unsaved work, then close threads and view."""
        # Ctrl-C may come while `may_leave` asks.
        if self._may_close or self.may_leave() or self._may_close:
            self._may_close = True
            if self.training is not None:
                self.training.cancel()
            self._timer.stop()
            self._note_layout()
            self.editor.close()
            self.settings.close(keep=self._kept is not None)
            self.plotter.close()
            event.accept()
        else:
            event.ignore()
