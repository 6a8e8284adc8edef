"""The dialog that trains a model on shapes, with progress and a button to cancel."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import (
    QComboBox,
    QDialog,
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from deformer import io
from deformer_app.viewer.training_job import TrainingJob

_SHAPE_FILES = f"Shapes ({' '.join(f'*{suffix}' for suffix in ('.npz', *io.SHAPE_SUFFIXES))})"
_POLL = 100  # milliseconds between two polls of the progress


class TrainingDialog(QDialog):
    """Asks for shapes, trains, opens the model.

    Args:
        parent: the window.
        open_model: called with the model's path once it has been written.

    Attributes:
        shapes, output, components, epochs: fields that the user fills in.
        start_button, cancel_button: begin and stop the training.
        status: a line that says what is going on.
        ended: true once a model has been trained and opened.
    """

    def __init__(self, parent: QWidget, open_model: Callable[[Path], Any]) -> None:
        """Lay out."""
        super().__init__(parent)
        self.setWindowTitle("Train on shapes")
        self.setMinimumWidth(560)
        self._open_model = open_model
        self._job: TrainingJob | None = None
        self.ended = False
        self.shapes, self.output = QLineEdit(), QLineEdit()
        self.shapes.setPlaceholderText("Folder of meshes, NPZ, GLB, glTF, USD or point cache")
        self.components, self.epochs = QSpinBox(), QSpinBox()
        self.components.setRange(1, 500)
        self.components.setValue(50)
        self.epochs.setRange(0, 100_000)
        self.epochs.setSpecialValueText("as usual")
        self._up = QComboBox()
        self._up.addItems(["y", "z", "x", "-x", "-y", "-z"])
        form = QFormLayout()
        folder = self._button("Folder…", self._choose_shapes)
        file = self._button("NPZ…", self._choose_file)
        form.addRow("Shapes", self._row(self.shapes, folder, file))
        output = self._button("Folder…", self._choose_output)
        form.addRow("Model", self._row(self.output, output))
        form.addRow("Components", self.components)
        form.addRow("Steps", self.epochs)
        form.addRow("Up axis", self._up)
        self._bar, self.status = QProgressBar(), QLabel("Shapes must share one connectivity.")
        self.status.setWordWrap(True)
        self.start_button = self._button("Train", self._begin)
        self.cancel_button = self._button("Cancel", self._cancel_or_close)
        buttons = QHBoxLayout()
        buttons.addStretch(1)
        buttons.addWidget(self.cancel_button)
        buttons.addWidget(self.start_button)
        layout = QVBoxLayout(self)
        layout.addLayout(form)
        layout.addWidget(self._bar)
        layout.addWidget(self.status)
        layout.addLayout(buttons)
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._poll)

    def _button(self, title: str, run: Callable[[], None]) -> QPushButton:
        button = QPushButton(title)
        button.setAutoDefault(False)
        button.clicked.connect(lambda _: run())
        return button

    def _row(self, field: QLineEdit, *buttons: QPushButton) -> QWidget:
        row = QWidget()
        layout = QHBoxLayout(row)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(field, 1)
        for button in buttons:
            layout.addWidget(button)
        return row

    @property
    def training(self) -> bool:
        """True while a model is being trained."""
        return self._job is not None

    @property
    def stage(self) -> str:
        """Stage of the training; empty without one."""
        progress = None if self._job is None else self._job.progress
        return "" if progress is None else progress.stage

    def choose(self, shapes: Path) -> None:
        """Fill in the shapes, and a name for the model beside them."""
        self.shapes.setText(str(shapes))
        if not self.output.text():
            self.output.setText(str(shapes.with_name(f"{shapes.stem}-model")))

    def _choose_shapes(self) -> None:
        name = QFileDialog.getExistingDirectory(self, "Shapes")
        if name:
            self.choose(Path(name))

    def _choose_file(self) -> None:
        name, _ = QFileDialog.getOpenFileName(self, "Shapes", "", _SHAPE_FILES)
        if name:
            self.choose(Path(name))

    def _choose_output(self) -> None:
        name = QFileDialog.getExistingDirectory(self, "Model")
        if name:
            self.output.setText(name)

    def _begin(self) -> None:
        if not self.shapes.text() or not self.output.text():
            self.status.setText("Choose the shapes, and a folder for the model.")
            return
        self.start_button.setEnabled(False)
        self._job = TrainingJob(
            Path(self.shapes.text()),
            Path(self.output.text()),
            self.components.value(),
            self.epochs.value() or None,
            self._up.currentText(),
        )
        self._timer.start(_POLL)

    def _poll(self) -> None:
        job = self._job
        assert job is not None
        progress = job.progress
        if progress is not None:
            self._bar.setRange(0, progress.total)
            self._bar.setValue(progress.done)
            loss = f"   loss {progress.loss:.4g}" if progress.loss else ""
            self.status.setText(f"{progress.stage} {progress.done} of {progress.total}{loss}")
        if not job.done:
            return
        self._timer.stop()
        self._job = None
        self.start_button.setEnabled(True)
        if job.error is not None:
            self.status.setText(str(job.error))
        elif job.cancelled:
            self.status.setText("Cancelled; nothing was written.")
        else:
            self.ended = True
            self.hide()
            self._open_model(job.output)

    def cancel(self) -> None:
        """Stop the training, if there is one."""
        if self._job is not None:
            self._job.cancel()

    def _cancel_or_close(self) -> None:
        if self._job is None:
            self.hide()
        else:
            self.status.setText("Stopping …")
            self.cancel()
