"""The dock of the model: start, prior and colours."""

from __future__ import annotations

from typing import Any, cast

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QComboBox,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QWidget,
)

from deformer_app.rendering.palette import BAD, FAIR, GOOD
from deformer_app.viewer.colouring import COLOURINGS
from deformer_app.viewer.edit import BODIES, NOISE, Body
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.model_files import start_codes
from deformer_app.viewer.qt.slider import Slider, geometric, geometric_position

_STRENGTHS = (0.1, 10.0)  # of the prior, in multiples of the default noise, from loose to firm
_BODY = {"auto": "Automatic", "stays": "Stays in place", "moves": "Free to move"}
_GHOSTS = {"none": "None", "reference": "Reference", "target": "Target"}


class ModelPanel(QWidget):
    """Where to start from, how strong the prior is, how the surface is coloured.

    Attributes:
        prior: slider of the prior's strength.
    """

    def __init__(self, editor: Editor) -> None:
        """Lay out; `refresh` fills it."""
        super().__init__()
        self._editor = editor
        self._name, self._start = QLabel(), QComboBox()
        self._name.setWordWrap(True)
        self._start.setToolTip("Begin at a training shape; handles are cleared")
        self._start.activated.connect(self._begin)
        self.prior = Slider(self._set_strength, lambda: editor.commit("Strength of the prior"))
        self.prior.setToolTip("Left: the pose follows the handles. Right: it keeps to the examples")
        strength = QHBoxLayout()
        for widget in (QLabel("loose"), self.prior, QLabel("firm")):
            strength.addWidget(widget)
        self._body = QComboBox()
        self._body.setToolTip("Automatic: in place, and free to move once three handles fix it")
        for body in BODIES:
            self._body.addItem(_BODY[body], body)
        self._body.activated.connect(lambda n: editor.set_body(cast(Body, self._body.itemData(n))))
        self._meter = QProgressBar()
        self._meter.setRange(0, 300)
        self._meter.setToolTip(
            "Distance of this pose from the nearest example; 100 % is as far as they are from "
            "each other"
        )
        self._colour, self._ghost = QComboBox(), QComboBox()
        self._colour.activated.connect(
            lambda n: editor.change_look(colour=self._colour.itemData(n))
        )
        self._ghost.activated.connect(lambda n: editor.change_look(ghost=self._ghost.itemData(n)))
        self._error = QLabel()
        form = QFormLayout(self)
        form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
        self._meter.setAlignment(Qt.AlignmentFlag.AlignCenter)
        for box in (self._start, self._body, self._colour, self._ghost):
            box.setMinimumContentsLength(8)
            box.setSizeAdjustPolicy(
                QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
            )
        rows: tuple[tuple[str, Any], ...] = (
            ("Model", self._name),
            ("Start from", self._start),
            ("Prior", strength),
            ("Body", self._body),
            ("Off data", self._meter),
            ("Colour", self._colour),
            ("Ghost", self._ghost),
            ("E_rms", self._error),
        )
        for label, field in rows:
            form.addRow(label, field)

    def _begin(self, row: int) -> None:
        name = self._start.itemText(row)
        self._editor.start_from(name, start_codes(self._editor.model)[name])

    def _set_strength(self, position: int) -> None:
        self._editor.set_noise(NOISE * geometric(position, *_STRENGTHS))

    def model_changed(self) -> None:
        """Another model is open."""
        editor = self._editor
        mesh = editor.model.reference
        self._name.setText(
            f"<b>{editor.session.model.path.rstrip('/').split('/')[-1]}</b><br>"
            f"{len(mesh.vertices):,} vertices<br>{editor.model.components} components"
        )
        self._start.clear()
        self._start.addItems(list(start_codes(editor.model)))

    def refresh(self) -> None:
        """Show the current state."""
        editor = self._editor
        self.prior.show_position(geometric_position(editor.edit.noise / NOISE, *_STRENGTHS))
        self._body.setCurrentIndex(BODIES.index(editor.edit.body))
        has_target = editor.state.target_mesh is not None
        colours = [n for n in COLOURINGS if n != "component" and (n != "error" or has_target)]
        titles = dict(COLOURINGS)
        kind, _, number = editor.state.look.colour.partition(":")
        if kind == "component":
            colours.append(editor.state.look.colour)
            titles[editor.state.look.colour] = editor.model.label(int(number)).capitalize()
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
        answer = editor.answer
        if answer is None:
            return
        percent = round(100 * answer.off_data)
        self._meter.setValue(min(percent, 300))
        self._meter.setFormat(f"{percent} %")
        colour = GOOD if percent <= 100 else FAIR if percent <= 200 else BAD
        self._meter.setStyleSheet(f"QProgressBar::chunk {{ background: {colour}; }}")
        self._error.setText("no target" if answer.error is None else f"{answer.error:.3g}")
