"""The dialog that trains a model on shapes, with progress and a button to cancel."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import (
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

import deformer
from deformer import io
from deformer_app.rendering.palette import Theme
from deformer_app.viewer.qt.questions import ask
from deformer_app.viewer.qt.up_axis_field import UpAxisField
from deformer_app.viewer.training_estimate import in_words
from deformer_app.viewer.training_job import TrainingJob, checkpoint_of

_SHAPE_FILES = f"Shapes ({' '.join(f'*{suffix}' for suffix in ('.npz', *io.SHAPE_SUFFIXES))})"
_BAR = 1000  # steps of the bar over all stages
_STOPPING = 10.0  # seconds that closing the window waits for the training to stop
_COMPILING = "compiling for this processor, once: a minute or two"
_POLL = 100  # milliseconds between two polls of the progress


def _free(folder: Path) -> Path:
    """Return a folder that does not exist: `folder`, or else with the first free number from 2."""
    if not folder.exists():
        return folder
    numbered = (folder.with_name(f"{folder.name}-{n}") for n in itertools.count(2))
    return next(other for other in numbered if not other.exists())


class TrainingDialog(QDialog):
    """Asks for shapes and trains; the window decides what becomes of the model.

    Args:
        parent: the window.
        take_model: called with the model's path once it has been written, and with True if the
            dialog was shown meanwhile, False if the training went on in the background.
        take_failure: called with the reason when a training in the background has failed.
        theme: gives the colours of the picture of the first shape.

    Attributes:
        shapes, output, components, epochs, up: fields that the user fills in.
        start_button, cancel_button: begin and stop the training.
        hide_button: leaves the training to the background.
        changed: emitted while the training goes on, and at its end.
        status: a line that says what is going on.
        ended: true once a model has been trained.
    """

    changed = Signal()

    def __init__(
        self,
        parent: QWidget,
        take_model: Callable[[Path, bool], Any],
        take_failure: Callable[[str], Any],
        theme: Callable[[], Theme],
    ) -> None:
        """Lay out."""
        super().__init__(parent)
        self.setWindowTitle("Train on shapes")
        self.setMinimumWidth(560)
        self._take_model, self._take_failure = take_model, take_failure
        self._job: TrainingJob | None = None
        self.ended = False
        self._suggested = ""  # folder that the dialog itself has filled in
        self.shapes, self.output = QLineEdit(), QLineEdit()
        self.shapes.setPlaceholderText("Folder of meshes, NPZ, GLB, glTF, USD or point cache")
        self.components, self.epochs = QSpinBox(), QSpinBox()
        self.components.setRange(0, 500)
        self.components.setSpecialValueText("as suits the shapes")
        self.components.setToolTip("More find finer differences of the shapes, if there are any")
        self.epochs.setRange(0, 100_000)
        self.epochs.setSpecialValueText("as usual")
        self.epochs.setToolTip("Steps of the optimiser")
        self.up = UpAxisField(theme)
        form = QFormLayout()
        folder = self._button("Folder…", self._choose_shapes)
        file = self._button("File…", self._choose_file)
        form.addRow("Shapes", self._row(self.shapes, folder, file))
        output = self._button("Folder…", self._choose_output)
        form.addRow("Model", self._row(self.output, output))
        form.addRow("Components", self.components)
        form.addRow("Steps", self.epochs)
        form.addRow("Up axis", self.up)
        self._bar, self.status = QProgressBar(), QLabel("Shapes must share one connectivity.")
        self.status.setWordWrap(True)
        self.status.setAlignment(Qt.AlignmentFlag.AlignTop | Qt.AlignmentFlag.AlignLeft)
        self.status.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._bar.setRange(0, _BAR)
        self._bar.setTextVisible(False)
        self._bar.setFixedHeight(8)
        self.start_button = self._button("Train", self._begin)
        self.start_button.setDefault(True)  # Enter in any field
        self.hide_button = self._button("Continue in the background", self.hide)
        self.hide_button.hide()
        self.cancel_button = self._button("Cancel", self._cancel_or_close)
        buttons = QHBoxLayout()
        buttons.addStretch(1)
        buttons.addWidget(self.cancel_button)
        buttons.addWidget(self.hide_button)
        buttons.addWidget(self.start_button)
        layout = QVBoxLayout(self)
        layout.addLayout(form)
        layout.addWidget(self._bar)
        layout.addWidget(self.status, 1)
        layout.addLayout(buttons)
        self.shapes.editingFinished.connect(self._look_at_shapes)
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
    def share(self) -> float:
        """Part of the training that is done, 0 to 1; 0 without one."""
        return 0.0 if self._job is None else self._job.estimate.share

    @property
    def stage(self) -> str:
        """Stage of the training; empty without one."""
        progress = None if self._job is None else self._job.progress
        return "" if progress is None else progress.stage

    def choose(self, shapes: Path) -> None:
        """Fill in the shapes, and a free name for the model beside them."""
        self.shapes.setText(str(shapes))
        self._look_at_shapes()

    def _look_at_shapes(self) -> None:
        """Show the first shape, and name a folder beside it unless the user has named one."""
        shapes = self.shapes.text().strip()
        if shapes:
            self.up.look_at(Path(shapes))
        if shapes and self.output.text() in ("", self._suggested):
            path = Path(shapes)
            name = path.name if path.is_dir() else path.stem
            self._suggested = str(_free(path.with_name(f"{name}-model")))
            self.output.setText(self._suggested)

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
            self._say("Choose the shapes, and a folder for the model.")
            return
        output = Path(self.output.text())
        if io.kind_of(output) == "model" and not self._wants_to_replace(output):
            return
        resume = deformer.has_checkpoint(checkpoint_of(output)) and self._wants_to_resume(output)
        if resume is None:
            return
        self._bar.setValue(0)
        self._job = TrainingJob(
            Path(self.shapes.text()),
            output,
            self.components.value() or None,
            self.epochs.value() or None,
            self.up.chosen,
            resume,
        )
        self._show_running(True)
        self._timer.start(_POLL)

    def _wants_to_replace(self, output: Path) -> bool:
        """Ask whether the training may replace the model that is in its folder."""
        text = (
            f"{output} holds a model; sessions made with it will not open with the new one. "
            "Replace it?"
        )
        return ask(self, text, "Replace", "Cancel", default=-1) == "Replace"

    def _wants_to_resume(self, output: Path) -> bool | None:
        """Ask whether to go on with a training that was stopped; None if the user cancels."""
        text = f"A training for {output} was stopped. Resume it?"
        answer = ask(self, text, "Resume", "Start anew", "Cancel")
        return None if answer == "Cancel" else answer == "Resume"

    def _show_running(self, running: bool) -> None:
        """Offer what can be done while a training runs, or without one."""
        self.start_button.setVisible(not running)
        self.hide_button.setVisible(running)
        self.cancel_button.setText("Stop" if running else "Cancel")
        if running:  # neither Enter nor Space may stop it
            self.hide_button.setFocus()
        else:
            self.start_button.setFocus()
        self.changed.emit()

    def _say(self, text: str) -> None:
        """Show a line below the bar; the dialog grows where it takes several."""
        if text == self.status.text():
            return
        self.status.setText(text)
        layout = self.layout()
        assert layout is not None
        layout.activate()
        height = layout.totalHeightForWidth(self.width())
        if height > self.height():
            self.resize(self.width(), height)

    def _poll(self) -> None:
        job = self._job
        assert job is not None
        progress = job.progress
        if progress is not None:
            self._bar.setValue(round(_BAR * job.estimate.share))
            loss = f"   loss {progress.loss:.4g}" if progress.loss else ""
            compiling = deformer.compiling()
            job.estimate.hold(compiling)
            left = _COMPILING if compiling else in_words(job.estimate.seconds_left)
            line = (
                f"{progress.stage.capitalize()} {progress.done} of {progress.total}{loss}   {left}"
            )
            self._say("\n".join(filter(None, (line, job.advice))))
            self.changed.emit()
        if not job.done:
            return
        self._timer.stop()
        self._job = None
        self._show_running(False)
        if job.error is not None:
            self._say(str(job.error))
            if not self.isVisible():
                self._take_failure(str(job.error))
        elif job.cancelled:
            kept = deformer.has_checkpoint(checkpoint_of(job.output))
            self._say(
                f"Stopped; what is finished is kept in {checkpoint_of(job.output)}."
                if kept
                else "Cancelled; nothing was written."
            )
        else:
            self.ended, watched = True, self.isVisible()
            self.hide()
            self._take_model(job.output, watched)

    def cancel(self, keep: bool = False) -> None:
        """Stop the training, if there is one; `keep` leaves what is needed to resume it."""
        if self._job is not None:
            self._job.cancel(keep)

    def may_stop(self) -> bool:
        """Ask what becomes of a running training before the window closes.

        Returns:
            False if it shall go on; otherwise it has been stopped.
        """
        if self._job is None:
            return True
        text = "A model is being trained. Close the window and stop the training?"
        keep, go_on = "Stop, keep for resuming", "Go on training"
        answer = ask(self.parentWidget(), text, keep, "Stop and discard", go_on, default=-1)
        if answer == go_on:
            return False
        self.cancel(keep=answer == keep)
        if self._job is not None:
            self._job.wait(_STOPPING)
        return True

    def _cancel_or_close(self) -> None:
        if self._job is None:
            self.hide()
        else:
            self._say("Stopping …")
            self.cancel()
