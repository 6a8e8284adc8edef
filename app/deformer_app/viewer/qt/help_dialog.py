"""The dialog with all keys and the use of the mouse."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QDialog, QHBoxLayout, QLabel, QScrollArea, QVBoxLayout, QWidget

from deformer_app.viewer.help import help_groups

_COLUMNS = (("Mouse", "Panels", "Help"), ("File", "Edit"), ("Handles", "Timeline"), ("View",))
_WIDE = {"Mouse": (165, 200), "Panels": (165, 200)}  # pixels of the two cells; texts wrap in them
_SCREEN = 0.96  # of the screen's width and height, which the dialog fills at most


class HelpDialog(QDialog):
    """Keys and mouse, in columns."""

    def __init__(self, parent: QWidget) -> None:
        """Lay out."""
        super().__init__(parent)  # of a Tool, Qt gives keys to the window: Esc would not close it
        self.setWindowTitle("Keys and mouse")
        page = QWidget()
        columns = QHBoxLayout(page)
        columns.setContentsMargins(14, 14, 14, 14)
        columns.setSpacing(16)
        tables = {
            name: f"<tr><th colspan=2 align=left>{name}</th></tr>" + _rows(rows, _WIDE.get(name))
            for name, rows in help_groups().items()
        }
        gap = "<tr><td>&nbsp;</td></tr>"
        for names in _COLUMNS:
            label = QLabel(f"<table>{gap.join(tables[name] for name in names)}</table>")
            label.setAlignment(Qt.AlignmentFlag.AlignTop)
            label.setWordWrap(any(name in _WIDE for name in names))
            columns.addWidget(label)
        scroll = QScrollArea()
        scroll.setWidget(page)
        scroll.setWidgetResizable(True)
        around = QVBoxLayout(self)
        around.setContentsMargins(0, 0, 0, 0)
        around.addWidget(scroll)
        bar = scroll.verticalScrollBar().sizeHint().width()
        wanted = page.sizeHint() + QSize(bar, bar)
        self.resize(wanted.boundedTo(self.screen().availableSize() * _SCREEN))
        QShortcut(QKeySequence("F1"), self, self.hide)


def _rows(rows: list[tuple[str, str]], widths: tuple[int, int] | None) -> str:
    """Rows of a table; without widths each is one line."""
    first, second = (f" width={width}" for width in widths) if widths else ("", "")
    return "".join(
        f"<tr><td{first} style='padding-right: 12px'><b>{key}</b></td><td{second}>{what}</td></tr>"
        for key, what in rows
    )
