"""The running training in the status bar."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QWidget

from deformer_app.viewer.qt.training_dialog import TrainingDialog

_STEPS = 100  # of the bar


class TrainingBar(QWidget):
    """Shows how far a training is while it runs; a click opens its dialog.

    Args:
        open_dialog: called by a click.
    """

    def __init__(self, open_dialog: Callable[[], Any]) -> None:
        """Lay out, hidden."""
        super().__init__()
        self._open = open_dialog
        self._bar = QProgressBar()
        self._bar.setRange(0, _STEPS)
        self._bar.setTextVisible(False)
        self._bar.setFixedSize(90, 6)
        row = QHBoxLayout(self)
        row.setContentsMargins(6, 0, 6, 0)
        row.addWidget(QLabel("Training"))
        row.addWidget(self._bar)
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.hide()

    @property
    def percent(self) -> int:
        """What the bar shows, 0 to 100."""
        return self._bar.value()

    def follow(self, dialog: TrainingDialog) -> None:
        """Show the training of a dialog from now on."""
        dialog.changed.connect(lambda: self._show(dialog))

    def _show(self, dialog: TrainingDialog) -> None:
        self.setVisible(dialog.training)
        self._bar.setValue(round(_STEPS * dialog.share))
        self.setToolTip(f"{dialog.status.text()}\nA click shows the training")

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Open the dialog."""
        self._open()
        event.accept()
