"""The end of a training: its model is opened, or offered by a note without taking the window."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QApplication

from deformer_app.viewer.changes import Change, ModelOpened
from deformer_app.viewer.qt.pages import Pages
from deformer_app.viewer.qt.session_files import Host, SessionFiles
from deformer_app.viewer.qt.strip import Strip


class TrainedModels:
    """Takes the models that trainings have written; all of them are among the recent ones.

    Args:
        host: the window.
        files: opens models, and knows whether something is unsaved.
        pages: has the start page, which lists the recent models.

    Attributes:
        offer: the note about the latest model that was not opened.
    """

    def __init__(self, host: Host, files: SessionFiles, pages: Pages) -> None:
        """Offer nothing."""
        self._host, self._files, self._pages = host, files, pages
        self._offered: Path | None = None
        self.offer = Strip("note", ("Open", self._open), ("Later", self._end))
        host.notices.add_offer(self.offer)
        host.editor.on_change.append(self._hear)

    def take(self, model: Path, watched: bool) -> None:
        """Open a model that has been trained, or offer it.

        Args:
            model: its folder.
            watched: true if the user waits for it. Only then it is opened at once, unless something
                is unsaved, a drag goes on, or a question is open.
        """
        model = model.resolve()
        busy = self._host.editor.dragging or QApplication.activeModalWidget() is not None
        if watched and not busy and not self._files.unsaved:
            self._files.open_model(model)
            return
        self._host.settings.remember(str(model), str(model))
        self._pages.refresh()
        self._offered = model
        self.offer.say(f"{model.name} is trained.")
        self.offer.setToolTip(str(model))
        self._host.notices.show_strip(self.offer)

    def take_failure(self, text: str) -> None:
        """Tell of a training that failed while its dialog was hidden."""
        self._host.notices.show_mistake(f"The training has failed. {text}")

    def _open(self) -> None:
        if self._offered is not None:
            self._files.open_model(self._offered)  # the offer stays if the user cancels

    def _end(self) -> None:
        self._offered = None
        self._host.notices.show_strip(self.offer, False)

    def _hear(self, change: Change) -> None:
        opened = isinstance(change, ModelOpened)
        if opened and self._host.editor.session.model.path == str(self._offered):
            self._end()
