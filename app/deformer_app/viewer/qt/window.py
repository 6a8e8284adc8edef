"""The Qt window: menus, docks, dialogs and a timer around an editor."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from PySide6.QtCore import QByteArray, QEvent, QObject, Qt, QTimer, Signal
from PySide6.QtGui import QAction, QCloseEvent, QColor, QFont, QKeySequence, QPalette, QShortcut
from PySide6.QtWidgets import (
    QApplication,
    QDialog,
    QDockWidget,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QMainWindow,
    QMenu,
    QMessageBox,
    QProgressBar,
    QPushButton,
    QToolBar,
    QVBoxLayout,
    QWidget,
)
from pyvistaqt import QtInteractor

from deformer import InputError
from deformer_app.rendering.palette import NOTICE, NOTICE_INK
from deformer_app.viewer.actions import ACTIONS, MENUS, Action, help_groups
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.events import listen
from deformer_app.viewer.qt.panels import ComponentPanel, HandlePanel, ModelPanel
from deformer_app.viewer.qt.training_dialog import TrainingDialog
from deformer_app.viewer.recording import Recorder, save_turntable, saving
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.session import Session
from deformer_app.viewer.settings import Places

_TICK = 4  # milliseconds between two looks at the solver while something is going on
_PANELS = 120  # milliseconds after a change until the docks show it
_AUTOSAVE = 1500  # milliseconds after a step until it is written
_PATIENCE = 700  # milliseconds of preparation after which the user is told
_MOVIES = "Animations (*.gif *.mp4)"
_TOOLBAR = {"Undo", "Redo", "Manipulator: move", "Manipulator: rotate", "Manipulator: scale",
            "Paint region", "Mirror", "Suggest next handle", "Frame all"}  # fmt: skip
_HELP_COLUMNS = (("Mouse", "Help"), ("File", "Edit"), ("Handles",), ("View",))
_TOUR = (
    ("Press the left button on a hand and pull it. The rest follows as in the examples.", "drag"),
    ("Drag beside the body to look around it; the wheel zooms to the cursor.", "camera"),
    ("Click a foot and press P: pinned, it stays where it is.", "history"),
    ("Ctrl+Z takes a step back, without end. F1 lists all keys. Enjoy!", ""),
)


class _Wake(QObject):
    """Carries a call from the solver's thread to the window's."""

    called = Signal()


class _Picture(QtInteractor):
    """VTK in a widget that shows what has been drawn.

    pyvistaqt (0.13.1) draws every frame a second time to show it, in case the scene has changed
    since; here it has not. Drawn in software, that halved the rate.
    """

    _drawn = False

    def _cb_frame(self, obj: Any, evt: Any) -> None:
        self._drawn = not self._in_paint
        super()._cb_frame(obj, evt)

    def resizeGL(self, w: int, h: int) -> None:
        """Forget the frame: it has another size."""
        self._drawn = False
        super().resizeGL(w, h)

    def paintGL(self) -> None:
        """Show the frame; draw it if that has not been done."""
        self._in_paint, self._drawn = self._drawn, False
        super().paintGL()
        self._in_paint = False


class Window(QMainWindow):
    """An editor with menus and docks.

    Args:
        places: what is remembered between two starts.
    """

    def __init__(self, places: Places) -> None:
        """Build the window, without a model."""
        super().__init__()
        self.places = places
        self.setWindowTitle("Deformer")
        self.resize(1360, 880)
        self._file: Path | None = None
        self._folder = Path.cwd()
        self._recorder: Recorder | None = None
        self._training: TrainingDialog | None = None
        self._help: QDialog | None = None
        self._tour_step: int | None = None
        self._ended = False

        self._wake = _Wake()
        self._timer = QTimer(self)
        self._timer.setInterval(_TICK)
        self._timer.timeout.connect(self._tick)
        self._wake.called.connect(self._awake)
        self._later = self._delayed(_PANELS, self._refresh)
        self._autosave = self._delayed(_AUTOSAVE, self._write_autosave)

        centre = QWidget()
        column = QVBoxLayout(centre)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        self._banner, self._banner_text = self._strip("mistake", ("Close", self._hide_banner))
        self._tour, self._tour_text = self._strip(
            "tour", ("Next", self._next_step), ("End tour", self._end_tour)
        )
        self.plotter = _Picture(centre, auto_update=False, multi_samples=0)
        self._film, film = self._strip("recording", ("Stop", lambda: self._guard(self.record)))
        film.setText("<b>●</b>&nbsp; Recording what the picture shows")
        self._wait, wait = self._strip("waiting")
        wait.setText("Preparing the solver. The first time after an installation this takes a "
                     "minute. You can look around already.")  # fmt: skip
        bar = QProgressBar()
        bar.setRange(0, 0)
        bar.setFixedSize(120, 8)
        cast(QHBoxLayout, self._wait.layout()).addWidget(bar)
        column.addWidget(self.plotter, 1)
        column.addWidget(self._tour)
        self.setCentralWidget(centre)
        # They lie upon the picture: if it gave way to them, what is being dragged would jump.
        self._notes = QWidget(centre)
        notes = QVBoxLayout(self._notes)
        notes.setContentsMargins(0, 0, 0, 0)
        notes.setSpacing(0)
        for strip in (self._banner, self._film, self._wait):
            notes.addWidget(strip)
        self._notes.hide()
        self.plotter.installEventFilter(self)

        view = MeshView(self.plotter, density=self.plotter.devicePixelRatioF)
        self.editor = Editor(view, self._wake.called.emit)
        self.editor.on_change.append(self._changed)
        listen(self.editor.view, self.editor.controller)
        self._actions = self._make_menus()
        self._model = ModelPanel(self.editor)
        self._handles = HandlePanel(self.editor)
        self._components = ComponentPanel(self.editor)
        model = self._dock("Model", self._model, Qt.DockWidgetArea.LeftDockWidgetArea)
        handles = self._dock("Handles", self._handles, Qt.DockWidgetArea.RightDockWidgetArea)
        components = self._dock(
            "Components", self._components, Qt.DockWidgetArea.RightDockWidgetArea
        )
        self.resizeDocks([handles, components], [330, 370], Qt.Orientation.Vertical)
        self.resizeDocks([model, handles], [250, 310], Qt.Orientation.Horizontal)
        self._hint, self._times = QLabel(), QLabel()
        self.statusBar().addWidget(self._hint, 1)
        self.statusBar().addPermanentWidget(self._times)
        QShortcut(QKeySequence("Esc"), self, self._escape)
        self._restore_layout()

    def _delayed(self, milliseconds: int, run: Callable[[], None]) -> QTimer:
        timer = QTimer(self)
        timer.setSingleShot(True)
        timer.setInterval(milliseconds)
        timer.timeout.connect(run)
        return timer

    def _strip(self, kind: str, *buttons: tuple[str, Callable[[], Any]]) -> tuple[QWidget, QLabel]:
        """A coloured line of text with buttons, hidden."""
        strip, text = QWidget(), QLabel()
        strip.setStyleSheet(f"background: {NOTICE[kind]}; color: {NOTICE_INK};")
        text.setWordWrap(True)
        row = QHBoxLayout(strip)
        row.addWidget(text, 1)
        for title, run in buttons:
            button = QPushButton(title)
            button.clicked.connect(lambda _, f=run: f())
            row.addWidget(button)
        strip.hide()
        return strip, text

    def _dock(self, title: str, panel: QWidget, area: Qt.DockWidgetArea) -> QDockWidget:
        dock = QDockWidget(title, self)
        dock.setObjectName(title)
        dock.setWidget(panel)
        self.addDockWidget(area, dock)
        self._menus["View"].addAction(dock.toggleViewAction())
        return dock

    def _make_menus(self) -> list[tuple[Action, QAction]]:
        self._menus = {name: self.menuBar().addMenu(f"&{name}") for name in MENUS}
        bar = QToolBar("Tools", self)
        bar.setObjectName("Tools")
        bar.setMovable(False)
        self.addToolBar(bar)
        made = []
        for action in ACTIONS:
            item = QAction(action.title, self)
            if action.key:
                item.setShortcut(QKeySequence(action.key))
            item.setStatusTip(action.about or action.title)
            item.setToolTip(f"{action.about or action.title}  {action.key}")
            item.setCheckable(action.checked is not None)
            item.triggered.connect(lambda _=False, a=action: self._run(a))
            if action.rule:
                self._menus[action.menu].addSeparator()
            self._menus[action.menu].addAction(item)
            if action.title in _TOOLBAR:
                item.setIconText(
                    action.title.split(": ")[-1].removesuffix(" next handle").capitalize()
                )
                bar.addAction(item)
            if action.title == "Open session…":
                self._recent = QMenu("Open recent", self)
                self._recent.aboutToShow.connect(self._list_recent)
                self._menus["File"].addMenu(self._recent)
            made.append((action, item))
        self._menus["View"].addSeparator()  # above the docks
        return made

    def _restore_layout(self) -> None:
        geometry, docks = (QByteArray.fromBase64(part.encode()) for part in self.places.layout)
        self.restoreGeometry(geometry)
        self.restoreState(docks)

    def _note_layout(self) -> None:
        parts = (self.saveGeometry(), self.saveState())
        self.places.note_layout(*(bytes(part.toBase64().data()).decode() for part in parts))

    @property
    def idle(self) -> bool:
        """True once the picture and the docks show the editor's state."""
        return self.editor.idle and not self._later.isActive()

    # Models, sessions, files.

    def begin(self, model: str, session: Session | None, file: Path | None) -> None:
        """Open the first model; offer what a crash has left."""
        left = self.places.left_by_crash()
        self._guard(lambda: self._open(model, session, file))
        if left is not None and self._restore(left):
            return
        if not self.places.tour_seen:
            self.places.note_tour()
            self.tour()

    def _restore(self, left: Path) -> bool:
        answer = QMessageBox.question(
            self,
            "Deformer",
            "The last session did not end well. Open what was saved of it?",
        )
        found = answer == QMessageBox.StandardButton.Yes and self._guard(
            lambda: self._open_restored(left)
        )
        self.places.forget(left)
        return bool(found)

    def _open_restored(self, left: Path) -> None:
        session = Session.load(left)
        session.mark_unsaved()
        self._open(session.model.path, session, None)
        self._autosave.start()

    def _open(self, model: str | Path, session: Session | None, file: Path | None) -> None:
        self._hide_banner()
        self.editor.open_model(model, session)
        self._file = file
        self.places.remember(str(file.resolve()) if file else self.editor.session.model.path)

    def _guard(self, run: Callable[[], Any]) -> bool:
        """Run; a mistake becomes a message and false."""
        try:
            run()
        except (InputError, OSError) as error:
            self._say(str(error))
            return False
        return True

    def _run(self, action: Action) -> None:
        self._guard(lambda: action.run(self))  # pyright: ignore[reportArgumentType]
        self._refresh()

    def open_model(self, path: Path | str) -> None:
        """Open a model, unless the user wants to keep unsaved work; offer to train on shapes."""
        folder = Path(path)
        if folder.is_dir() and not (folder / "model.json").exists():
            question = f"{folder} holds no model. Train one on the shapes in it?"
            if QMessageBox.question(self, "Deformer", question) == QMessageBox.StandardButton.Yes:
                self.train()
                assert self._training is not None
                self._training.choose(folder)
        elif self._may_leave():
            self._guard(lambda: self._open(path, None, None))

    def open_session(self, path: Path | str) -> None:
        """Open a session, unless the user wants to keep unsaved work."""

        def load() -> None:
            session = Session.load(path)
            self._open(session.model.path, session, Path(path))

        if self._may_leave():
            self._guard(load)

    def _list_recent(self) -> None:
        self._recent.clear()
        for name in self.places.recent:
            opener = self.open_session if name.endswith(".json") else self.open_model
            item = self._recent.addAction(name)
            item.triggered.connect(lambda _=False, n=name, f=opener: f(n))

    def save(self, elsewhere: bool) -> bool:
        """Save the session; false if the user thought better of it."""
        path = self._file
        if path is None or elsewhere:
            path = self.ask_save("Save session", "session.json", "Sessions (*.json)")
        if path is None or not self._guard(lambda: self.editor.save_session(path)):
            return False
        self._file = path
        self.places.remember(str(path.resolve()))
        self.places.forget(self.places.autosave)
        self.statusBar().showMessage(f"Saved {path}", 4000)
        return True

    def _may_leave(self) -> bool:
        """Ask, if something would be lost."""
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
            self._guard(lambda: self.editor.write_copy(self.places.autosave))

    def ask_open(self, title: str, files: str) -> Path | None:
        """Ask for a file to read."""
        name, _ = QFileDialog.getOpenFileName(self, title, str(self._folder), files)
        return self._chosen(name)

    def ask_folder(self, title: str) -> Path | None:
        """Ask for a folder."""
        return self._chosen(QFileDialog.getExistingDirectory(self, title, str(self._folder)))

    def ask_save(self, title: str, name: str, files: str) -> Path | None:
        """Ask for a file to write."""
        dialog = QFileDialog(self, title, str(self._folder / name), files)
        dialog.setAcceptMode(QFileDialog.AcceptMode.AcceptSave)
        dialog.setDefaultSuffix(Path(name).suffix)
        return self._chosen(dialog.selectedFiles()[0] if dialog.exec() else "")

    def _chosen(self, name: str) -> Path | None:
        """What a dialog has given; the next one begins in the same folder."""
        if not name:
            return None
        self._folder = Path(name).parent
        return Path(name)

    def train(self) -> None:
        """Train a model on shapes that the user chooses."""
        if self._training is None or self._training.ended:
            self._training = TrainingDialog(self, self.open_model)
        self._training.show()

    def record(self) -> None:
        """Begin or end a recording."""
        if self._recorder is None:
            self._recorder = Recorder(self.editor)
            self._show(self._film)
            return
        recorder, self._recorder = self._recorder, None
        self._show(self._film, False)
        pictures = recorder.stop()
        path = self.ask_save("Save recording", "drag.mp4", _MOVIES)
        if path is not None:
            self.editor.run(saving(self.editor, path, pictures))

    def turntable(self) -> None:
        """Write a turntable."""
        path = self.ask_save("Save turntable", "turntable.gif", _MOVIES)
        if path is not None:
            self.editor.run(save_turntable(self.editor, path))

    # Help.

    def help(self) -> None:
        """Show or hide the keys and what the mouse does."""
        if self._help is not None and self._help.isVisible():
            self._help.hide()
            return
        self._help = QDialog(self, Qt.WindowType.Tool)
        self._help.setWindowTitle("Keys and mouse")
        columns = QHBoxLayout(self._help)
        columns.setContentsMargins(18, 14, 18, 14)
        columns.setSpacing(28)
        texts = {
            name: f"<tr><th colspan=2 align=left>{name}</th></tr>"
            + "".join(
                f"<tr><td><b>{key}</b>&nbsp;&nbsp;&nbsp;</td><td>{what}</td></tr>"
                for key, what in rows
            )
            for name, rows in help_groups().items()
        }
        gap = "<tr><td>&nbsp;</td></tr>"
        for names in _HELP_COLUMNS:
            label = QLabel(f"<table>{gap.join(texts[name] for name in names)}</table>")
            label.setAlignment(Qt.AlignmentFlag.AlignTop)
            columns.addWidget(label)
        QShortcut(QKeySequence("F1"), self._help, self._help.hide)
        self._help.show()

    def tour(self) -> None:
        """Begin the tour."""
        self._tour_step = -1
        self._next_step()

    def _next_step(self) -> None:
        step = -1 if self._tour_step is None else self._tour_step
        if step + 1 >= len(_TOUR):
            self._end_tour()
            return
        self._tour_step = step + 1
        self._tour_text.setText(
            f"<b>{step + 2} of {len(_TOUR)}</b>&nbsp;&nbsp; {_TOUR[step + 1][0]}"
        )
        self._tour.show()

    def _end_tour(self) -> None:
        self._tour_step = None
        self._tour.hide()

    def unexpected(self, kind: type[BaseException], error: BaseException, trace: Any) -> None:
        """Tell of a fault of the program in the window, too, and go on: the session is whole."""
        sys.__excepthook__(kind, error, trace)
        self._say(f"A fault of the program: {error!r}. Your session is kept; save it.")

    def _say(self, text: str) -> None:
        self._banner_text.setText(text)
        self._show(self._banner)

    def _hide_banner(self) -> None:
        self._show(self._banner, False)

    def _show(self, strip: QWidget, shown: bool = True) -> None:
        """Show or hide one of the strips at the top of the picture."""
        strip.setVisible(shown)
        self._place_notes()

    def _place_notes(self) -> None:
        layout, frame = cast(QVBoxLayout, self._notes.layout()), self.plotter.geometry()
        strips = (self._banner, self._film, self._wait)
        self._notes.setVisible(any(not strip.isHidden() for strip in strips))
        layout.activate()
        height = layout.totalHeightForWidth(frame.width())
        self._notes.setGeometry(frame.x(), frame.y(), frame.width(), max(height, 1))
        self._notes.raise_()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Keep the strips as wide as the picture."""
        if watched is self.plotter and event.type() == QEvent.Type.Resize:
            self._place_notes()
        return super().eventFilter(watched, event)

    # Events.

    def _escape(self) -> None:
        if not self.editor.controller.cancel():
            self.editor.set_mode("drag")
            self._hide_banner()

    def _changed(self, event: str) -> None:
        """The editor says that something is different."""
        if event == "message":
            self._say(self.editor.message)
        elif event == "notice":
            self.statusBar().showMessage(self.editor.notice, 6000)
        elif event == "pose":
            self._show(self._wait, False)
        elif event == "model":
            QTimer.singleShot(_PATIENCE, lambda: self._show(self._wait, self.editor.preparing))
            self._model.model_changed()
            self._components.model_changed()
        elif event == "look":
            self._dress()
        if event == "history":
            self._autosave.start()
        if self._tour_step is not None and event == _TOUR[self._tour_step][1]:
            QTimer.singleShot(900, lambda step=self._tour_step: self._advance(step))
        if event == "frame":
            self._show_times()
        if not self._later.isActive():
            self._later.start()

    def _advance(self, step: int) -> None:
        if self._tour_step == step and not self.editor.controller.dragging:
            self._next_step()

    def _awake(self) -> None:
        if not self._timer.isActive():  # to start it anew with every answer would put it off
            self._timer.start()

    def _tick(self) -> None:
        self.editor.tick()
        if self.editor.idle:
            self._timer.stop()

    def _show_times(self) -> None:
        editor = self.editor
        solve = editor.answer.pose.milliseconds if editor.answer else 0.0
        text = f"solve {solve:.1f} ms   frame {editor.view.frame_milliseconds:.1f} ms"
        if editor.latencies:
            text += f"   move to picture {1000 * editor.latencies[-1]:.0f} ms"
        self._times.setText(text)

    def _refresh(self) -> None:
        editor = self.editor
        if not editor.is_open:
            return
        for panel in (self._model, self._handles, self._components):
            panel.refresh()
        for action, item in self._actions:
            if action.checked is not None:
                item.setChecked(action.checked(editor))
            if action.title == "Undo":
                item.setEnabled(editor.session.can_undo)
            elif action.title == "Redo":
                item.setEnabled(editor.session.can_redo)
            elif action.title == "Record":
                item.setText("Stop recording" if self._recorder else "Record")
        name = self._file.name if self._file else Path(editor.session.model.path).name
        preparing = " (preparing)" if editor.preparing else ""
        self.setWindowTitle(f"{name}[*] – Deformer{preparing}")
        self.setWindowModified(editor.session.changed)
        self._hint.setText(editor.hint)

    def _dress(self) -> None:
        """Give the widgets the colours of the picture."""
        theme = self.editor.view.theme
        palette, roles = QPalette(), QPalette.ColorRole
        for name, colour in theme.widgets:
            palette.setColor(roles[name], QColor(colour))
        for role in (roles.Text, roles.ButtonText, roles.WindowText):
            palette.setColor(QPalette.ColorGroup.Disabled, role, QColor(theme.disabled))
        QApplication.setPalette(palette)

    def closeEvent(self, event: QCloseEvent) -> None:
        """Ask if something would be lost, then let everything go."""
        if self._ended or self._may_leave():
            self._ended = True
            if self._training is not None:
                self._training.cancel()
            self._timer.stop()
            self._note_layout()
            self.editor.close()
            self.places.close()
            self.plotter.close()
            event.accept()
        else:
            event.ignore()


def run_window(model: str, session: Session | None, file: Path | None) -> Session:
    """Show the window until it is closed; the session."""
    app = QApplication.instance() or QApplication(sys.argv[:1])
    app.setApplicationName("Deformer")
    app.setStyle("Fusion")  # pyright: ignore[reportAttributeAccessIssue]
    font = QFont()
    font.setPointSizeF(max(font.pointSizeF(), 9.5))
    app.setFont(font)  # pyright: ignore[reportAttributeAccessIssue]
    window = Window(Places())
    window.show()
    QTimer.singleShot(0, lambda: window.begin(model, session, file))
    sys.excepthook = window.unexpected
    app.exec()
    return window.editor.session
