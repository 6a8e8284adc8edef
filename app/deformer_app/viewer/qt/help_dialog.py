"""The dialog with all keys and the use of the mouse."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QDialog, QHBoxLayout, QLabel, QWidget

from deformer_app.viewer.help import help_groups

_COLUMNS = (("Mouse", "Help"), ("File", "Edit"), ("Handles",), ("View",))


class HelpDialog(QDialog):
    """Keys and mouse, in columns."""

    def __init__(self, parent: QWidget) -> None:
        """Lay out."""
        super().__init__(parent, Qt.WindowType.Tool)
        self.setWindowTitle("Keys and mouse")
        columns = QHBoxLayout(self)
        columns.setContentsMargins(18, 14, 18, 14)
        columns.setSpacing(28)
        tables = {
            name: f"<tr><th colspan=2 align=left>{name}</th></tr>"
            + "".join(
                f"<tr><td><b>{key}</b>&nbsp;&nbsp;&nbsp;</td><td>{what}</td></tr>"
                for key, what in rows
            )
            for name, rows in help_groups().items()
        }
        gap = "<tr><td>&nbsp;</td></tr>"
        for names in _COLUMNS:
            label = QLabel(f"<table>{gap.join(tables[name] for name in names)}</table>")
            label.setAlignment(Qt.AlignmentFlag.AlignTop)
            columns.addWidget(label)
        QShortcut(QKeySequence("F1"), self, self.hide)
