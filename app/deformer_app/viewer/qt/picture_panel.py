"""The dock of the reference picture: which one, where, how strong, at which time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from PySide6.QtWidgets import (
    QCheckBox,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QWidget,
)

from deformer_app.rendering.footage import PICTURES, VIDEOS
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.file_dialogs import FileDialogs
from deformer_app.viewer.qt.number_field import NumberField
from deformer_app.viewer.qt.slider import STEPS, Slider

_FILES = f"Pictures and videos ({' '.join(f'*{suffix}' for suffix in PICTURES + VIDEOS)})"


class PicturePanel(QWidget):
    """Places the reference picture of an editor.

    Attributes:
        opacity: slider of its opacity.
        time: slider of the time of a video or a folder of pictures.
        numbers: boxes of its place and size by the names of `Placement`.
        in_front: shows it in front of the model.
    """

    def __init__(self, editor: Editor) -> None:
        """Lay out; `refresh` fills it."""
        super().__init__()
        self._reference, self._editor = editor.state.reference_picture, editor
        self._dialogs = FileDialogs(self)
        self._name, self._frame = QLabel(), QLabel()
        self._name.setWordWrap(True)
        choose, folder, self._remove = (
            QPushButton("Open…"), QPushButton("Folder…"), QPushButton("Remove"),
        )  # fmt: skip
        choose.setToolTip("A picture or a video")
        folder.setToolTip("A folder of pictures, shown as a video")
        choose.clicked.connect(
            lambda: self._open(self._dialogs.ask_open("Reference picture", _FILES))
        )
        folder.clicked.connect(lambda: self._open(self._dialogs.ask_folder("Folder of pictures")))
        self._remove.clicked.connect(self._close)
        buttons = QHBoxLayout()
        buttons.setSpacing(4)
        for button in (choose, folder, self._remove):
            button.setProperty("narrow", True)
            buttons.addWidget(button, 1)
        self.opacity = Slider(lambda n: self._place(opacity=n / STEPS), editor.touch)
        self.time = Slider(self._go_to, lambda: None)
        self.in_front = QCheckBox("In front of the model")
        self.in_front.clicked.connect(lambda on: self._place(in_front=on, ended=True))
        self.numbers = {
            "scale": self._number(0.01, 100.0, "Height in heights of the view"),
            "x": self._number(-100.0, 100.0, "To the right, in heights of the view"),
            "y": self._number(-100.0, 100.0, "Upwards, in heights of the view"),
        }
        for name, box in self.numbers.items():
            box.valueChanged.connect(lambda v, name=name: self._place(ended=True, **{name: v}))
        form = QFormLayout(self)
        form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
        form.addRow(self._name)
        form.addRow(buttons)
        rows: tuple[tuple[str, Any], ...] = (
            ("Opacity", self.opacity),
            ("Size", self.numbers["scale"]),
            ("Right", self.numbers["x"]),
            ("Up", self.numbers["y"]),
            ("", self.in_front),
            ("Time", self.time),
            ("", self._frame),
        )
        for label, field in rows:
            form.addRow(label, field)

    def _number(self, least: float, most: float, about: str) -> NumberField:
        box = NumberField(least, most, 3)
        box.setSingleStep(0.02)
        box.setToolTip(about)
        box.setMinimumWidth(60)
        return box

    def _open(self, path: Path | None) -> None:
        """Open a file or folder; the window tells what is wrong with it."""
        if path is None:
            return

        def job() -> Iterator[None]:
            self._editor.picture.open_reference(path)
            yield

        self._editor.run(job())

    def _close(self) -> None:
        self._reference.close()
        self._editor.touch()

    def _place(self, ended: bool = False, **changes: Any) -> None:
        self._reference.place(**changes)
        if ended:
            self._editor.touch()

    def _go_to(self, position: int) -> None:
        footage = self._reference.footage
        if footage is not None:
            last = (footage.count - 1) / footage.fps
            self._reference.set_frame(last * position / STEPS)

    def model_changed(self) -> None:
        """Another model is open: its session has its own picture, which `refresh` shows."""

    def refresh(self) -> None:
        """Show the current state."""
        reference = self._reference
        footage, placement = reference.footage, reference.placement
        for widget in (self._remove, self.opacity, self.in_front, *self.numbers.values()):
            widget.setEnabled(footage is not None)
        self._name.setText("No picture" if footage is None else Path(footage.path).name)
        self._name.setToolTip("" if footage is None else footage.path)
        self.opacity.show_position(STEPS * placement.opacity)
        for name, box in self.numbers.items():
            if not box.being_typed:
                box.show_value(getattr(placement, name))
        self.in_front.setChecked(placement.in_front)
        moving = footage is not None and footage.count > 1
        self.time.setEnabled(moving)
        self._frame.setText("")
        if footage is not None and moving:
            last = (footage.count - 1) / footage.fps
            self.time.show_position(STEPS * min(reference.seconds / last, 1.0))
            self._frame.setText(
                f"{reference.seconds:.2f} s, frame {reference.frame + 1} of {footage.count}"
            )
