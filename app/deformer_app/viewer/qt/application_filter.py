"""What sees the events of all widgets of the program."""

from __future__ import annotations

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QApplication


class ApplicationFilter(QObject):
    """An event filter of the whole application, as long as its parent lives.

    Args:
        parent: the window that needs it.
    """

    def __init__(self, parent: QObject) -> None:
        """Watch the application's events."""
        super().__init__(parent)
        application = QApplication.instance()
        assert application is not None
        application.installEventFilter(self)
