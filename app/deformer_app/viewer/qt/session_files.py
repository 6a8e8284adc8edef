"""The model and the session of the window: opening, saving, recent ones, recovery."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from PySide6.QtWidgets import QMenu, QWidget

import deformer
from deformer import DeformationModel, InputError, io
from deformer_app.viewer.actions import Shell
from deformer_app.viewer.qt.autosave import Autosave
from deformer_app.viewer.qt.busy_mark import BusyMark
from deformer_app.viewer.qt.notices import Notices
from deformer_app.viewer.qt.questions import ask
from deformer_app.viewer.qt.recovery import offer_recovery
from deformer_app.viewer.session import Session
from deformer_app.viewer.settings import Settings
from deformer_app.viewer.thumbnails import save_thumbnail


class Host(Shell, Protocol):
    """What the window does for its files, beside being a `Shell`."""

    settings: Settings
    notices: Notices
    busy_mark: BusyMark

    def attempt(self, run: Callable[[], Any]) -> bool:
        """Run a function; on a mistake show its message and return False."""
        ...


class SessionFiles:
    """Which model and session the window shows, and the files that they come from and go to.

    Args:
        parent: the window, for questions.
        host: the window, for commands.

    Attributes:
        autosave: writes the session soon after every change.
    """

    def __init__(self, parent: QWidget, host: Host) -> None:
        """Begin without a model."""
        self._parent, self._host = parent, host
        self._file: Path | None = None
        self.autosave = Autosave(parent, host.editor, host.settings, lambda: self._file)

    @property
    def name(self) -> str:
        """Name of the session's file, or else of the model."""
        path = self._file or Path(self._host.editor.session.model.path)
        return path.name

    # Opening.

    def open(
        self,
        model: str | Path,
        session: Session | None,
        file: Path | None,
        loaded: DeformationModel | None = None,
    ) -> None:
        """Open a model, and a session that was read from a file.

        Args:
            model: directory or name of the model.
            session: a session of it; None begins one.
            file: that of the session, or None.
            loaded: the model, if it has been read already.

        Raises:
            InputError: see `Editor.open_model`.
        """
        editor = self._host.editor
        self._host.notices.hide_mistake()
        if session is not None and isinstance(session.view.get("look"), dict):
            session.view["look"]["dark"] = editor.state.look.dark  # the window keeps its theme
        with self._host.busy_mark.shown(f"Opening {(file or Path(model)).name} …"):
            editor.open_model(model, session, loaded)
        self._file = file
        model = editor.session.model.path
        self._host.settings.remember(str(file.resolve()) if file else model, model)

    def open_model(self, path: Path | str) -> None:
        """Open a model, unless the user wants to keep unsaved work; offer to train on shapes.

        The user is asked about unsaved work only for what can be opened.
        """
        folder = Path(path)
        if folder.is_dir() and io.kind_of(folder) != "model":
            question = f"{folder} holds no model. Train one on the shapes in it?"
            if ask(self._parent, question, "Train…", "Cancel") == "Train…":
                self._host.train().choose(folder)
        else:
            self._host.attempt(lambda: self._leave_for(path, None, None))

    def open_session(self, path: Path | str) -> None:
        """Open a session, unless the user wants to keep unsaved work; see `open_model`."""

        def load() -> None:
            session = Session.load(path)
            model = self._model_of(session, Path(path).name)
            if model is not None:
                self._leave_for(model, session, Path(path))

        self._host.attempt(load)

    def _leave_for(self, model: str | Path, session: Session | None, file: Path | None) -> None:
        """Do what `open` does, once the user has answered what becomes of unsaved work."""
        with self._host.busy_mark.shown(f"Opening {(file or Path(model)).name} …"):
            loaded = deformer.load_model(model)
            if session is not None and file is not None:
                session.check_fits(loaded, model, file)
        if not self.may_leave():
            return
        if file is not None and self._is_own(file):
            session = Session.load(file)  # the user may have saved to it just now
        self.open(model, session, file, loaded)

    def _is_own(self, file: Path) -> bool:
        """True for the file of the session that is open."""
        return self._file is not None and self._file.resolve() == file.resolve()

    def _model_of(self, session: Session, name: str) -> str | Path | None:
        """Return where a session's model is; where it has moved, the user is asked."""
        where = session.model.path
        if where in deformer.shipped_models() or Path(where).exists():
            return where
        return self._host.ask_folder(f"Find the model of {name}, which is no longer at {where}")

    def fill_recent(self, menu: QMenu) -> None:
        """List the recent models and sessions in a menu."""
        menu.clear()
        for name in self._host.settings.recent:
            opener = self.open_session if name.endswith(".json") else self.open_model
            item = menu.addAction(name)
            item.triggered.connect(lambda _=False, n=name, f=opener: f(n))

    def close(self) -> None:
        """Close the model, unless the user wants to keep unsaved work."""
        if self.may_leave():
            self._host.editor.close_model()
            self._file = None
            self._host.settings.forget(self._host.settings.autosave)

    # Saving.

    def save(self, elsewhere: bool) -> Path | None:
        """Save the session; return its file, None if the user cancels or it cannot be written."""
        host, path = self._host, self._file
        if path is None or elsewhere:
            path = host.ask_save("Save session", "session.json", "Sessions (*.json)")
        if path is None or not host.attempt(lambda: host.editor.save_session(path)):
            return None
        self._file = path
        host.settings.remember(str(path.resolve()), host.editor.session.model.path)
        save_thumbnail(host.editor, host.settings.thumbnail(str(path.resolve())))
        host.settings.forget(host.settings.autosave)
        return path

    @property
    def unsaved(self) -> bool:
        """True while there is work that no file has but the autosave."""
        return self._host.editor.is_open and self._host.editor.session.changed

    def may_leave(self) -> bool:
        """Ask if there is unsaved work; return False if the user cancels."""
        if not self.unsaved:
            return True
        question = "Save the changes to this session?"
        answer = ask(self._parent, question, "Save", "Discard", "Cancel")
        return self._host.save(False) if answer == "Save" else answer == "Discard"

    # Recovery.

    def restore(self, left: Path) -> bool:
        """Offer the autosave of a crash; return True once it is open.

        One that is left for later or cannot be opened stays, to be offered again.
        """
        answer = offer_recovery(self._parent, left)
        opened = answer == "Open" and self._host.attempt(lambda: self._open_restored(left))
        if opened or answer == "Discard":
            self._host.settings.forget(left)
        return opened

    def _open_restored(self, left: Path) -> None:
        session = Session.load(left)
        session.mark_unsaved()
        file = Path(session.saved_as) if session.saved_as else None
        model = self._model_of(session, left.name if file is None else file.name)
        if model is None:
            raise InputError(f"{left}: the session is not opened without its model")
        self.open(model, session, file)
        if left != self.autosave.path:
            self.autosave.write(wait=False)
