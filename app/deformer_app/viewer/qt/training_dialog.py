"""The dialog that trains a model on shapes, with progress and a way out."""

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

from deformer_app.viewer.training_job import TrainingJob

_LOOK = 100  # milliseconds between two looks at the progress


class TrainingDialog(QDialog):
    """Asks for shapes, trains, opens the model.

    Args:
        parent: the window.
        opened: called with the model's path when it is there.
    """

    def __init__(self, parent: QWidget, opened: Callable[[Path], Any]) -> None:
        """Lay out."""
        super().__init__(parent)
        self.setWindowTitle("Train on shapes")
        self.setMinimumWidth(560)
        self._opened = opened
        self._job: TrainingJob | None = None
        self.ended = False
        self._shapes, self._output = QLineEdit(), QLineEdit()
        self._shapes.setPlaceholderText("Folder of OBJ, PLY, OFF, STL or GLB files, or an NPZ")
        self._components, self._epochs = QSpinBox(), QSpinBox()
        self._components.setRange(1, 500)
        self._components.setValue(50)
        self._epochs.setRange(0, 100_000)
        self._epochs.setSpecialValueText("as usual")
        self._up = QComboBox()
        self._up.addItems(["y", "z", "x", "-x", "-y", "-z"])
        form = QFormLayout()
        folder = self._button("Folder…", self._choose_shapes)
        file = self._button("NPZ…", self._choose_file)
        form.addRow("Shapes", self._row(self._shapes, folder, file))
        output = self._button("Folder…", self._choose_output)
        form.addRow("Model", self._row(self._output, output))
        form.addRow("Components", self._components)
        form.addRow("Steps", self._epochs)
        form.addRow("Up axis", self._up)
        self._bar, self._state = QProgressBar(), QLabel("Shapes must share one connectivity.")
        self._state.setWordWrap(True)
        self._start = self._button("Train", self._begin)
        self._stop = self._button("Cancel", self._cancel_or_close)
        buttons = QHBoxLayout()
        buttons.addStretch(1)
        buttons.addWidget(self._stop)
        buttons.addWidget(self._start)
        layout = QVBoxLayout(self)
        layout.addLayout(form)
        layout.addWidget(self._bar)
        layout.addWidget(self._state)
        layout.addLayout(buttons)
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)

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

    def choose(self, shapes: Path) -> None:
        """Fill in the shapes, and a name for the model beside them."""
        self._shapes.setText(str(shapes))
        if not self._output.text():
            self._output.setText(str(shapes.with_name(f"{shapes.stem}-model")))

    def _choose_shapes(self) -> None:
        name = QFileDialog.getExistingDirectory(self, "Shapes")
        if name:
            self.choose(Path(name))

    def _choose_file(self) -> None:
        name, _ = QFileDialog.getOpenFileName(self, "Shapes", "", "Shapes (*.npz)")
        if name:
            self.choose(Path(name))

    def _choose_output(self) -> None:
        name = QFileDialog.getExistingDirectory(self, "Model")
        if name:
            self._output.setText(name)

    def _begin(self) -> None:
        if not self._shapes.text() or not self._output.text():
            self._state.setText("Choose the shapes, and a folder for the model.")
            return
        self._start.setEnabled(False)
        self._job = TrainingJob(
            Path(self._shapes.text()),
            Path(self._output.text()),
            self._components.value(),
            self._epochs.value() or None,
            self._up.currentText(),
        )
        self._timer.start(_LOOK)

    def _look(self) -> None:
        job = self._job
        assert job is not None
        progress = job.progress
        if progress is not None:
            self._bar.setRange(0, progress.total)
            self._bar.setValue(progress.done)
            loss = f"   loss {progress.loss:.4g}" if progress.loss else ""
            self._state.setText(f"{progress.stage} {progress.done} of {progress.total}{loss}")
        if not job.done:
            return
        self._timer.stop()
        self._job = None
        self._start.setEnabled(True)
        if job.error is not None:
            self._state.setText(str(job.error))
        elif job.cancelled:
            self._state.setText("Cancelled; nothing was written.")
        else:
            self.ended = True
            self.hide()
            self._opened(job.output)

    def cancel(self) -> None:
        """Stop the training, if there is one."""
        if self._job is not None:
            self._job.cancel()

    def _cancel_or_close(self) -> None:
        if self._job is None:
            self.hide()
        else:
            self._state.setText("Stopping …")
            self.cancel()
