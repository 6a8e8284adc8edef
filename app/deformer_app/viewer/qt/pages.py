"""The two pages of the window: the start page, and the picture with its docks."""

from __future__ import annotations

from PySide6.QtCore import QByteArray
from PySide6.QtWidgets import QDockWidget, QMainWindow, QStackedWidget, QToolBar, QWidget

from deformer_app.viewer.qt.start_page import StartPage


class Pages(QStackedWidget):
    """Shows one of the pages; docks and tool bars belong to the picture's.

    Args:
        window: has the docks and tool bars.
        start: the page without a model.
        picture: the page with one.
    """

    def __init__(self, window: QMainWindow, start: StartPage, picture: QWidget) -> None:
        """Show the picture's page."""
        super().__init__()
        self._window, self._start, self._picture = window, start, picture
        self._layout: QByteArray | None = None  # of docks and tool bars, while they are hidden
        self.addWidget(picture)
        self.addWidget(start)

    @property
    def layout_state(self) -> QByteArray:
        """The arrangement of docks and tool bars beside the picture."""
        return self._window.saveState() if self._layout is None else self._layout

    def refresh(self) -> None:
        """Show the recent models and sessions on the start page."""
        self._start.refresh()

    def show_start(self) -> None:
        """Show the start page, without docks and tool bars."""
        self._start.refresh()
        if self._layout is None:
            self._layout = self._window.saveState()
            for part in (*self._parts(QDockWidget), *self._parts(QToolBar)):
                part.hide()
        self.setCurrentWidget(self._start)

    def show_picture(self) -> None:
        """Show the picture, with docks and tool bars as they were."""
        self.setCurrentWidget(self._picture)
        if self._layout is not None:
            self._window.restoreState(self._layout)
            self._layout = None

    def _parts(self, kind: type[QWidget]) -> list[QWidget]:
        return self._window.findChildren(kind)
