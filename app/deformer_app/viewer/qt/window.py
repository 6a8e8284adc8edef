"""The Qt window: menus, docks, dialogs and a timer around an editor."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QByteArray, QObject, QPoint, QSize, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QKeySequence, QShortcut, QShowEvent
from PySide6.QtWidgets import (
    QApplication,
    QInputDialog,
    QLabel,
    QMainWindow,
    QVBoxLayout,
    QWidget,
)

from deformer import InputError
from deformer_app.mistakes import mistake
from deformer_app.viewer.actions import Action, carry_out
from deformer_app.viewer.changes import (
    Change,
    FrameDrawn,
    HandlesDragged,
    MenuAsked,
    MistakeMade,
    ModelClosed,
    ModelOpened,
    NoticeGiven,
    PlaybackBegun,
    WaitBegun,
    WaitEnded,
)
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.about_dialog import AboutDialog
from deformer_app.viewer.qt.busy_mark import BusyMark
from deformer_app.viewer.qt.context_menu import ContextMenu
from deformer_app.viewer.qt.docks import Docks
from deformer_app.viewer.qt.drops import Drops
from deformer_app.viewer.qt.elided_label import ElidedLabel
from deformer_app.viewer.qt.field_focus import FieldFocus
from deformer_app.viewer.qt.file_dialogs import FileDialogs
from deformer_app.viewer.qt.help_dialog import HelpDialog
from deformer_app.viewer.qt.history_dialog import HistoryDialog
from deformer_app.viewer.qt.later import later
from deformer_app.viewer.qt.menus import Menus
from deformer_app.viewer.qt.notices import Notices
from deformer_app.viewer.qt.own_keys import OwnKeys
from deformer_app.viewer.qt.pages import Pages
from deformer_app.viewer.qt.picture import Picture
from deformer_app.viewer.qt.recordings import Recordings
from deformer_app.viewer.qt.session_files import SessionFiles
from deformer_app.viewer.qt.start_page import StartPage
from deformer_app.viewer.qt.still_wheel import StillWheel
from deformer_app.viewer.qt.surroundings import Surroundings
from deformer_app.viewer.qt.theme_choice import ThemeChoice
from deformer_app.viewer.qt.timeline_view import TimelineView
from deformer_app.viewer.qt.tour import Tour
from deformer_app.viewer.qt.trained_models import TrainedModels
from deformer_app.viewer.qt.training_bar import TrainingBar
from deformer_app.viewer.qt.training_dialog import TrainingDialog
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.session import Session
from deformer_app.viewer.settings import Settings
from deformer_app.viewer.shape_thumbnails import Thumbnails
from deformer_app.viewer.vtk_input import listen

_SMALLEST = (254, 150)  # pixels of a picture: room for the orientation cube and a colour bar
_TICK = 4  # milliseconds between two ticks while the editor is busy
_PANELS = 120  # milliseconds after a change until the docks show it
_FRAMED = 300  # milliseconds after which a window manager has framed the window


class _Wake(QObject):
    """Carries a call from the solver's thread to the window's."""

    called = Signal()


class Window(QMainWindow):
    """An editor with menus and docks.

    Args:
        settings: what is remembered between two starts.

    Attributes:
        editor: what the user works with.
        menus, notices, busy_mark, tour: parts of the window.
        theme: whether the window is light or dark.
        context_menu: menus of the right button.
        files: the model and session that are open, with their files.
        docks: the panels around the picture.
        thumbnails: small pictures of shapes, for the docks.
        training: the dialog that trains a model, once it has been opened.
    """

    def __init__(self, settings: Settings) -> None:
        """Build the window, without a model."""
        super().__init__()
        self.settings = settings
        self.setWindowTitle("Deformer")
        self.resize(QSize(1360, 880).boundedTo(self.screen().availableSize()))
        self.training: TrainingDialog | None = None
        self._dialogs = FileDialogs(self)
        self._help: HelpDialog | None = None
        self._history: HistoryDialog | None = None
        self._may_close = False
        self._kept: Path | None = None  # the autosave, after Ctrl-C

        self._wake = _Wake()
        self._timer = QTimer(self)
        self._timer.setInterval(_TICK)
        self._timer.timeout.connect(self._tick)
        self._wake.called.connect(self._awake)
        self._refresh_soon = later(self, _PANELS, self._refresh)

        centre = QWidget()
        self.plotter = Picture(centre, auto_update=False, multi_samples=0)
        self.editor = Editor(
            MeshView(self.plotter, density=self.plotter.devicePixelRatioF), self._wake.called.emit
        )
        self.editor.on_change.append(self._hear)
        listen(
            self.editor.state.view,
            self.editor.controller.handle,
            self.editor.controller.handle_key,
            buttons=lambda: self.plotter.buttons,
        )
        self.plotter.setMinimumSize(*_SMALLEST)
        self.plotter.takes_numbers = lambda: self.editor.controller.takes_numbers
        OwnKeys(self)
        StillWheel(self)
        FieldFocus(self, self.plotter)
        self.thumbnails = Thumbnails(self.editor, density=self.plotter.devicePixelRatioF())
        column = QVBoxLayout(centre)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.plotter, 1)
        self.plotter.setAcceptDrops(False)  # the window takes what is dropped on it
        self.start_page = StartPage(self, settings)
        self.pages = Pages(self, self.start_page, centre)
        self.setCentralWidget(self.pages)
        self.tour = Tour(self.editor, self.pages, self.plotter)
        Drops(self, self, self.attempt)
        self.notices = Notices(self.pages, self.plotter, lambda: self.attempt(self.record))
        self.busy_mark = BusyMark(self)
        self._recordings = Recordings(
            self, lambda on: self.notices.show_strip(self.notices.recording, on)
        )
        self.menus = Menus(self, self._run)
        self.context_menu = ContextMenu(self.plotter, self, self.menus)
        self.files = SessionFiles(self, self)
        self._trained = TrainedModels(self, self.files, self.pages)
        self.menus.recent.aboutToShow.connect(lambda: self.files.fill_recent(self.menus.recent))
        self.docks = Docks(
            self,
            Surroundings(
                self.editor,
                self.thumbnails,
                self.settings,
                TimelineView(self.editor.timeline),
                self.attempt,
            ),
            self.plotter,
        )
        self.menus.menus["View"].addActions(list(self.docks.toggles))
        self._hint, self._times = ElidedLabel(), QLabel()
        self.statusBar().addWidget(self._hint, 1)
        self._training_bar = TrainingBar(self.train)
        self.statusBar().addPermanentWidget(self._training_bar)
        self.statusBar().addPermanentWidget(self._times)
        QShortcut(QKeySequence("Esc"), self, self.escape)
        self.theme = ThemeChoice(self.editor, settings)
        self._restore_layout()

    def _restore_layout(self) -> None:
        geometry, docks = (QByteArray.fromBase64(part.encode()) for part in self.settings.layout)
        self.restoreGeometry(geometry)
        self.restoreState(docks)

    def _note_layout(self) -> None:
        self.docks.bring_back()
        parts = (self.saveGeometry(), self.pages.layout_state)
        self.settings.note_layout(*(bytes(part.toBase64().data()).decode() for part in parts))

    @property
    def idle(self) -> bool:
        """True once the picture and the docks show the editor's state."""
        return self.editor.idle and not self._refresh_soon.isActive()

    # Models and sessions.

    def begin(self, model: str | None, session: Session | None, file: Path | None) -> None:
        """Open the first model, or the start page without one; offer the autosave of a crash."""
        left = self.settings.left_by_crash()
        if model is None or not self.attempt(lambda: self.files.open(model, session, file)):
            self.pages.show_start()
        if left is not None:
            self.files.restore(left)

    def attempt(self, run: Callable[[], Any]) -> bool:
        """Run a function; on a mistake show its message and return False."""
        told = self.notices.told
        try:
            run()
        except (InputError, OSError) as error:
            self.notices.show_mistake(mistake(error))
            return False
        self.notices.forget(told)
        return True

    def _run(self, action: Action) -> None:
        self.attempt(lambda: carry_out(action, self))
        self._refresh()

    # Functions that actions call; see `actions.Shell`.

    def open_model(self, path: Path | str) -> None:
        """Open a model, unless the user wants to keep unsaved work; offer to train on shapes."""
        self.files.open_model(path)

    def open_session(self, path: Path | str) -> None:
        """Open a session, unless the user wants to keep unsaved work."""
        self.files.open_session(path)

    def close_model(self) -> None:
        """Close the model, unless the user wants to keep unsaved work."""
        self.files.close()

    def act(self, action: str) -> None:
        """Run an action by its id."""
        self.menus.items[action].trigger()

    def save(self, elsewhere: bool) -> bool:
        """Save the session; return False if the user cancels."""
        path = self.files.save(elsewhere)
        if path is not None:
            self.notices.show_note(f"Saved {path}")
        return path is not None

    def may_leave(self) -> bool:
        """Ask if there is unsaved work; return False if the user cancels."""
        return self.files.may_leave()

    def ask_open(self, title: str, files: str) -> Path | None:
        """Ask for a file to read."""
        return self._dialogs.ask_open(title, files)

    def ask_folder(self, title: str) -> Path | None:
        """Ask for a folder."""
        return self._dialogs.ask_folder(title)

    def ask_save(self, title: str, name: str, files: str) -> Path | None:
        """Ask for a file to write."""
        return self._dialogs.ask_save(title, name, files)

    def ask_text(self, title: str, about: str, start: str) -> str | None:
        """Ask for a line of text."""
        text, given = QInputDialog.getText(self, title, about, text=start)
        return text if given else None

    def copy_text(self, text: str) -> None:
        """Put a text on the clipboard."""
        QApplication.clipboard().setText(text)

    def copied_text(self) -> str:
        """Return the text on the clipboard; empty if there is none."""
        return QApplication.clipboard().text()

    def ask_number(self, title: str, about: str, start: int, most: int) -> int | None:
        """Ask for a whole number of 1 to `most`."""
        number, given = QInputDialog.getInt(self, title, about, start, 1, most)
        return number if given else None

    def train(self) -> TrainingDialog:
        """Open the dialog that trains a model on shapes."""
        if self.training is None or self.training.ended:
            self.training = TrainingDialog(
                self,
                self._trained.take,
                self._trained.take_failure,
                lambda: self.editor.state.view.theme,
            )
            self._training_bar.follow(self.training)
        self.training.show()
        self.training.raise_()
        return self.training

    @property
    def recording(self) -> bool:
        """True while the picture is being recorded."""
        return self._recordings.running

    def record(self) -> None:
        """Begin or end a recording."""
        self._recordings.toggle()

    def turntable(self) -> None:
        """Write a turntable."""
        self._recordings.turntable()

    def help(self) -> None:
        """Show or hide the keys and what the mouse does."""
        if self._help is not None and self._help.isVisible():
            self._help.hide()
            return
        self._help = HelpDialog(self)
        self._help.show()

    def history(self) -> None:
        """Show or hide the steps of the history."""
        if self._history is None:
            keys = [self.menus.items[name] for name in ("undo", "redo", "history")]
            self._history = HistoryDialog(self, self.editor, keys)
        self._history.toggle(self.plotter.mapToGlobal(QPoint()))

    def about(self) -> None:
        """Show the version, licences and the model's card."""
        AboutDialog(self, self.editor).show()

    def choose_theme(self, dark: bool | None) -> None:
        """Show the dark or the light theme from now on, or the system's for None."""
        if dark is None:
            self.theme.follow_system()
        else:
            self.theme.choose(dark)

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
        """Cancel the drag, slide or animation; else go back to dragging and close the message."""
        editor = self.editor
        if not (editor.controller.cancel() or editor.filming.give_up() or editor.give_up()):
            self.editor.stage.set_tool("drag")
            self.notices.hide_note()
            self.notices.mistake.close_one()

    def _hear(self, change: Change) -> None:
        match change:
            case MistakeMade(text):
                self.notices.show_mistake(text)
            case NoticeGiven(text):
                self.notices.show_note(text)
            case WaitBegun(text):
                self.notices.show_wait(text)
            case WaitEnded():
                self.notices.show_wait("")
            case PlaybackBegun() | HandlesDragged():
                self.notices.forget(self.notices.told)
            case ModelOpened():
                self.pages.show_picture()
                self.plotter.setFocus()
                self._begin_first_tour()
                self.notices.preparing.follow(self.editor)
                self.docks.model_changed()
            case MenuAsked(pixel, hover):
                self.context_menu.popup(pixel, hover)
            case ModelClosed():
                self.tour.end()
                self.docks.bring_back()  # before their layout is kept
                self.pages.show_start()
            case FrameDrawn():
                self._show_times()
        if not self._refresh_soon.isActive():
            self._refresh_soon.start()

    def _begin_first_tour(self) -> None:
        if not self.settings.tour_seen:
            self.settings.note_tour()
            self.tour.begin()

    def _awake(self) -> None:
        # Restarting it with every answer would delay it; an answer may come after the last tick.
        if not self._timer.isActive() and not self._may_close:
            self._timer.start()

    def _tick(self) -> None:
        self.editor.tick()
        self.notices.keep_clear(self.editor.dragging, self._work())
        if self.editor.idle:
            self._timer.stop()

    def _work(self) -> tuple[float, float] | None:
        """Pixels from the picture's left and top to the manipulator, if it is shown."""
        gizmo, state = self.editor.stage.gizmo, self.editor.state
        if gizmo is None:
            return None
        x, y = state.camera.project(np.array([gizmo.centre]), state.view.size)[0][:2]
        return float(x), float(y)

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
            self.setWindowTitle("Deformer")
            self.setWindowModified(False)
            self._hint.clear()
            self._times.clear()
            return
        self.docks.refresh()
        preparing = " (preparing)" if editor.preparing else ""
        self.setWindowTitle(f"{self.files.name}[*] – Deformer{preparing}")
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
        if self.files.unsaved:
            self._kept = self.files.autosave.write()
        self.close_unsaved()

    def _may_stop_training(self) -> bool:
        return self.training is None or self.training.may_stop()

    def showEvent(self, event: QShowEvent) -> None:
        """Fit the screen once there is a frame around the window."""
        super().showEvent(event)
        if not event.spontaneous():
            QTimer.singleShot(_FRAMED, self._fit_screen)

    def _fit_screen(self) -> None:
        """Shrink the window if its frame and title bar bring it beyond the screen's free part."""
        free, frame = self.screen().availableGeometry(), self.frameGeometry()
        if free.contains(frame) or self.isMaximized() or self.isFullScreen():
            return
        self.resize(self.size() - (frame.size() - frame.size().boundedTo(free.size())))
        frame.setSize(frame.size().boundedTo(free.size()))
        corner = frame.topLeft()
        self.move(
            max(free.left(), min(corner.x(), free.right() + 1 - frame.width())),
            max(free.top(), min(corner.y(), free.bottom() + 1 - frame.height())),
        )

    def closeEvent(self, event: QCloseEvent) -> None:
        """Ask if there is unsaved work, then close threads and view."""
        # Ctrl-C may come while one of them asks.
        if self._may_close or (self._may_stop_training() and self.may_leave()) or self._may_close:
            self._may_close = True
            if self.training is not None:
                self.training.cancel(keep=True)
            self._timer.stop()
            self.files.autosave.end()
            self._note_layout()
            self.editor.close()
            self.settings.close(keep=self._kept is not None)
            self.thumbnails.close()
            self.plotter.close()
            event.accept()
        else:
            event.ignore()
