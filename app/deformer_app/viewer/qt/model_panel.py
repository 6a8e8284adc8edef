"""The dock of the model: prior and colours."""

from __future__ import annotations

from typing import Any, cast

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QWidget,
)

from deformer_app.rendering.palette import BAD, FAIR, GOOD
from deformer_app.viewer.colouring import COLOURINGS
from deformer_app.viewer.component_names import component_title
from deformer_app.viewer.edit import BODIES, NOISE, Body
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.pose_worker import Answer
from deformer_app.viewer.qt.number_field import NumberField
from deformer_app.viewer.qt.slider import Slider, geometric, geometric_position

_STRENGTHS = (0.1, 10.0)  # of the prior, in multiples of the default noise, from loose to firm
_BODY = {"auto": "Automatic", "stays": "Stays in place", "moves": "Free to move"}
_GHOSTS = {
    "none": "None", "reference": "Reference", "target": "Target", "previous": "Previous pose",
}  # fmt: skip


class ModelPanel(QWidget):
    """How strong the prior is, and how the surface is coloured.

    Attributes:
        prior: slider of the prior's strength.
    """

    def __init__(self, editor: Editor) -> None:
        """Lay out; `refresh` fills it."""
        super().__init__()
        self._editor = editor
        self._name = QLabel()
        self._name.setWordWrap(True)
        self.prior = Slider(self._set_strength, lambda: editor.commit("Strength of the prior"))
        self.prior.setToolTip("Left: the pose follows the handles. Right: it keeps to the examples")
        strength = QHBoxLayout()
        for widget in (QLabel("loose"), self.prior, QLabel("firm")):
            strength.addWidget(widget)
        self._body = QComboBox()
        self._body.setToolTip(
            "Automatic: in place under gentle pulls; strong ones move it, unless most of it is "
            "still in all examples"
        )
        for body in BODIES:
            self._body.addItem(_BODY[body], body)
        self._body.activated.connect(
            lambda n: editor.prior.set_body(cast(Body, self._body.itemData(n)))
        )
        self._meter = QProgressBar()
        self._meter.setRange(0, 200)
        self._meter.setToolTip(
            "How far this pose is from all examples: as far as so many per cent of them are, each "
            "left out in turn; or, beyond all of them, how many times as far as the farthest"
        )
        self._colour, self._ghost = QComboBox(), QComboBox()
        self._colour.activated.connect(
            lambda n: editor.picture.change_look(colour=self._colour.itemData(n))
        )
        self._ghost.activated.connect(
            lambda n: editor.picture.change_look(ghost=self._ghost.itemData(n))
        )
        self._floor, self._height = QCheckBox(), NumberField(-1e9, 1e9)
        self._floor.setToolTip("A plane where the examples stand, which no part passes")
        self._floor.clicked.connect(lambda _: editor.floor.switch())
        self._height.setMinimumWidth(90)  # Qt's is that of the largest height
        self._height.setToolTip("Height of the floor along the model's up axis")
        self._height.valueChanged.connect(editor.floor.slide)
        self._height.settled.connect(lambda: editor.commit("Floor"))
        floor = QHBoxLayout()
        floor.addWidget(self._floor)
        floor.addWidget(self._height, 1)
        self._error = QLabel()
        form = QFormLayout(self)
        form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
        self._meter.setAlignment(Qt.AlignmentFlag.AlignCenter)
        for box in (self._body, self._colour, self._ghost):
            box.setMinimumContentsLength(8)
            box.setSizeAdjustPolicy(
                QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
            )
        rows: tuple[tuple[str, Any], ...] = (
            ("Model", self._name),
            ("Prior", strength),
            ("Body", self._body),
            ("Floor", floor),
            ("Off data", self._meter),
            ("Colour", self._colour),
            ("Ghost", self._ghost),
            ("E_rms", self._error),
        )
        for label, field in rows:
            form.addRow(label, field)

    def _set_strength(self, position: int) -> None:
        self._editor.prior.set_noise(NOISE * geometric(position, *_STRENGTHS))

    def model_changed(self) -> None:
        """Another model is open."""
        editor = self._editor
        mesh = editor.model.reference
        self._height.fit_size(mesh.bounding_diagonal)
        self._name.setText(
            f"<b>{editor.session.model.path.rstrip('/').split('/')[-1]}</b><br>"
            f"{len(mesh.vertices):,} vertices<br>{editor.model.components} components"
        )

    def _show_floor(self, height: float | None) -> None:
        self._floor.setChecked(height is not None)
        self._height.setEnabled(height is not None)
        if height is not None and not self._height.being_typed:
            self._height.show_value(height)

    def refresh(self) -> None:
        """Show the current state."""
        editor = self._editor
        self.prior.show_position(geometric_position(editor.edit.noise / NOISE, *_STRENGTHS))
        self._body.setCurrentIndex(BODIES.index(editor.edit.body))
        self._show_floor(editor.floor.height)
        has_target = editor.state.target_mesh is not None
        colours = [n for n in COLOURINGS if n != "component" and (n != "error" or has_target)]
        titles = dict(COLOURINGS)
        kind, _, number = editor.state.look.colour.partition(":")
        if kind == "component":
            colours.append(editor.state.look.colour)
            titles[editor.state.look.colour] = component_title(editor.model, int(number))
        ghosts = [n for n in _GHOSTS if n != "target" or has_target]
        for box, names, texts, now in (
            (self._colour, colours, titles, editor.state.look.colour),
            (self._ghost, ghosts, _GHOSTS, editor.state.look.ghost),
        ):
            if [box.itemData(n) for n in range(box.count())] != names:
                box.clear()
                for name in names:
                    box.addItem(texts[name], name)
            box.setCurrentIndex(names.index(now) if now in names else 0)
        self._show_answer(editor.answer)

    def _show_answer(self, answer: Answer | None) -> None:
        """Show how far the newest pose is off; nothing while a model is being prepared."""
        if answer is None:
            self._meter.setValue(0)
            self._meter.setFormat("…")
            self._error.setText("…")
            return
        percent = answer.off_data
        self._meter.setValue(round(min(percent, 200.0)))
        beyond = f"{percent / 100:.1f} × the farthest"
        self._meter.setFormat(f"{percent:.0f} % of examples" if percent <= 100 else beyond)
        colour = GOOD if percent <= 100 else FAIR if percent <= 150 else BAD
        text = " QProgressBar { color: #ffffff; }" if colour == BAD else ""  # it lies on the bar
        self._meter.setStyleSheet(f"QProgressBar::chunk {{ background: {colour}; }}{text}")
        self._error.setText("no target" if answer.error is None else f"{answer.error:.3g}")
