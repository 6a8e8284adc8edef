"""The docks of the Qt window: model, handles, components. They read the editor and command it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from PySide6.QtCore import QEvent, QObject, QSignalBlocker, Qt
from PySide6.QtWidgets import (
    QAbstractItemView,
    QButtonGroup,
    QComboBox,
    QDoubleSpinBox,
    QFormLayout,
    QGridLayout,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QProgressBar,
    QPushButton,
    QScrollArea,
    QSlider,
    QTableWidget,
    QTableWidgetItem,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from deformer_app.rendering.palette import BAD, FAIR, GOOD
from deformer_app.viewer.colouring import COLOURINGS
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.session import BODIES, KINDS, NOISE, Body, Kind

_STEPS = 1000  # of a slider
_DIAL = (0.1, 10.0)  # of the default noise: the prior's dial, from loose to hard
_WEIGHTS = (0.05, 50.0)
_BODY = {"auto": "Automatic", "stays": "Stays in place", "moves": "Free to move"}
_GHOSTS = {"none": "None", "reference": "Reference", "target": "Target"}


def _slider(changed: Callable[[int], None], released: Callable[[], None]) -> QSlider:
    slider = QSlider(Qt.Orientation.Horizontal)
    slider.setRange(0, _STEPS)
    slider.valueChanged.connect(changed)
    slider.sliderReleased.connect(released)
    return slider


def _set(slider: QSlider, value: float) -> None:
    if not slider.isSliderDown():
        with QSignalBlocker(slider):
            slider.setValue(round(value))


def _geometric(position: int, low: float, high: float) -> float:
    return low * (high / low) ** (position / _STEPS)


def _place(value: float, low: float, high: float) -> float:
    return _STEPS * math.log(value / low) / math.log(high / low)


def _waiting() -> QLabel:
    label = QLabel("Measuring the components …")
    label.setAlignment(Qt.AlignmentFlag.AlignCenter)
    return label


class ModelPanel(QWidget):
    """Where to start from, how hard the prior holds, how the surface is coloured."""

    def __init__(self, editor: Editor) -> None:
        """Lay out; `refresh` fills it."""
        super().__init__()
        self._editor = editor
        self._name, self._start = QLabel(), QComboBox()
        self._name.setWordWrap(True)
        self._start.setToolTip("Begin at a training shape; handles are cleared")
        self._start.activated.connect(self._begin)
        self._dial = _slider(self._turn, lambda: editor.commit("Strength of the prior"))
        self._dial.setToolTip("Left: handles win. Right: the examples hold hard")
        prior = QHBoxLayout()
        for widget in (QLabel("loose"), self._dial, QLabel("firm")):
            prior.addWidget(widget)
        self._body = QComboBox()
        self._body.setToolTip("Automatic: in place, and free to move once three handles hold it")
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
            ("Prior", prior),
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
        self._editor.start_from(name, self._editor.start_codes()[name])

    def _turn(self, position: int) -> None:
        self._editor.set_noise(NOISE * _geometric(position, *_DIAL))
        if not self._dial.isSliderDown():  # the wheel, the keys: one step each
            self._editor.commit("Strength of the prior")

    def model_changed(self) -> None:
        """Another model is open."""
        editor = self._editor
        mesh = editor.model.reference
        self._name.setText(
            f"<b>{editor.session.model.path.rstrip('/').split('/')[-1]}</b><br>"
            f"{len(mesh.vertices):,} vertices<br>{editor.model.components} components"
        )
        self._start.clear()
        self._start.addItems(list(editor.start_codes()))

    def refresh(self) -> None:
        """Show the present state."""
        editor = self._editor
        _set(self._dial, _place(editor.edit.noise / NOISE, *_DIAL))
        self._body.setCurrentIndex(BODIES.index(editor.edit.body))
        has_target = editor.target is not None
        colours = [n for n in COLOURINGS if n != "component" and (n != "error" or has_target)]
        titles = dict(COLOURINGS)
        kind, _, number = editor.look.colour.partition(":")
        if kind == "component":
            colours.append(editor.look.colour)
            titles[editor.look.colour] = editor.model.label(int(number)).capitalize()
        ghosts = [n for n in _GHOSTS if n != "target" or has_target]
        for box, names, texts, now in (
            (self._colour, colours, titles, editor.look.colour),
            (self._ghost, ghosts, _GHOSTS, editor.look.ghost),
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


class HandlePanel(QWidget):
    """All handles, and exact numbers for the selected ones."""

    def __init__(self, editor: Editor) -> None:
        """Lay out; `refresh` fills it."""
        super().__init__()
        self._editor = editor
        self._shown: tuple = ()
        self._table = QTableWidget(0, 4)
        self._table.setHorizontalHeaderLabels(["Handle", "Kind", "Weight", "Off by"])
        self._table.verticalHeader().hide()
        self._table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self._table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        header = self._table.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self._table.itemSelectionChanged.connect(self._select)
        self._kinds, row = QButtonGroup(self), QHBoxLayout()
        tips = ("Close to its target", "Exactly on its target", "Stays where it is")
        for kind, tip in zip(KINDS, tips, strict=True):
            button = QPushButton(kind.capitalize())
            button.setCheckable(True)
            button.setToolTip(tip)
            button.clicked.connect(lambda _, k=kind: editor.set_kind(cast(Kind, k)))
            self._kinds.addButton(button, KINDS.index(kind))
            row.addWidget(button)
        self._weight = _slider(self._weigh, lambda: editor.commit("Weight"))
        self._weight.setToolTip("How much a soft handle counts")
        self._fields = [QDoubleSpinBox() for _ in range(3)]
        numbers = QHBoxLayout()
        for axis, box in zip("xyz", self._fields, strict=True):
            box.setRange(-1e9, 1e9)
            box.setDecimals(4)
            box.setPrefix(f"{axis} ")
            box.setButtonSymbols(QDoubleSpinBox.ButtonSymbols.NoButtons)
            box.setMinimumWidth(72)
            box.setKeyboardTracking(False)
            box.valueChanged.connect(self._move)
            numbers.addWidget(box)
        layout = QVBoxLayout(self)
        layout.addWidget(self._table, 1)
        layout.addLayout(row)
        form = QFormLayout()
        form.addRow("Weight", self._weight)
        form.addRow("At", numbers)
        layout.addLayout(form)
        buttons = QGridLayout()
        for n, (title, run) in enumerate(
            (("Mirror", editor.mirror), ("Suggest next", editor.suggest),
             ("Delete", editor.delete), ("Clear all", editor.clear))
        ):  # fmt: skip
            button = QPushButton(title)
            button.clicked.connect(lambda _, f=run: f())
            buttons.addWidget(button, n // 2, n % 2)
        layout.addLayout(buttons)

    def _select(self) -> None:
        ids = [h.id for h in self._editor.edit.handles]
        rows = {index.row() for index in self._table.selectionModel().selectedRows()}
        self._editor.select([ids[row] for row in sorted(rows) if row < len(ids)])

    def _weigh(self, position: int) -> None:
        self._editor.set_weight(_geometric(position, *_WEIGHTS))
        if not self._weight.isSliderDown():
            self._editor.commit("Weight")

    def _move(self) -> None:
        self._editor.set_centre([box.value() for box in self._fields])

    def refresh(self) -> None:
        """Show the present state."""
        editor = self._editor
        handles, answer = editor.edit.handles, editor.answer
        residual = np.zeros(0) if answer is None else answer.pose.residual
        spans, start = [], 0
        for handle in handles:
            spans.append(residual[start : start + len(handle.vertices)])
            start += len(handle.vertices)
        diagonal = editor.model.reference.bounding_diagonal
        rows = []
        for handle, span in zip(handles, spans, strict=True):
            name = f"region {len(handle.patch)}" if handle.is_region else f"{handle.vertices[0]}"
            off = f"{100 * float(span.max()) / diagonal:.2f} %" if len(span) else ""
            weight = f"{handle.weight:.3g}" if handle.kind == "soft" else "–"
            rows.append((name, handle.kind, weight, off))
        with QSignalBlocker(self._table):
            self._table.setRowCount(len(rows))
            for n, row in enumerate(rows):
                for column, text in enumerate(row):
                    item = self._table.item(n, column)
                    if item is None:
                        self._table.setItem(n, column, QTableWidgetItem(text))
                    elif item.text() != text:
                        item.setText(text)
            wanted = [n for n, handle in enumerate(handles) if handle.id in editor.selected]
            shown = {index.row() for index in self._table.selectionModel().selectedRows()}
            if shown != set(wanted):
                self._table.clearSelection()
                mode = QAbstractItemView.SelectionMode
                self._table.setSelectionMode(mode.MultiSelection)
                for n in wanted:
                    self._table.selectRow(n)
                self._table.setSelectionMode(mode.ExtendedSelection)
        held = [handle for handle in handles if handle.id in editor.selected]
        for widget in (*self._fields, *self._kinds.buttons(), self._weight):
            widget.setEnabled(bool(held))
        kinds = {handle.kind for handle in held}
        self._kinds.setExclusive(False)
        for n, kind in enumerate(KINDS):
            self._kinds.button(n).setChecked(kinds == {kind})
        if not held:
            return
        _set(self._weight, _place(held[0].weight, *_WEIGHTS))
        self._weight.setEnabled("soft" in kinds)
        centre = np.mean([handle.centre for handle in held], axis=0)
        for box, value in zip(self._fields, centre, strict=True):
            box.setSingleStep(0.002 * diagonal)
            if editor.dragging or not box.hasFocus():  # else the user is typing
                with QSignalBlocker(box):
                    box.setValue(float(value))


class ComponentPanel(QScrollArea):
    """A slider for every component, the strongest first; its support shows on hover."""

    def __init__(self, editor: Editor) -> None:
        """Begin empty; the strengths arrive a moment after the model."""
        super().__init__()
        self._editor = editor
        self._rows: dict[int, tuple[QSlider, QLabel]] = {}
        self._names: dict[int, QToolButton] = {}
        self._filled_for: object = None
        self.setWidgetResizable(True)
        self.setWidget(_waiting())

    def model_changed(self) -> None:
        """Another model is open."""
        self._rows, self._names, self._filled_for = {}, {}, None
        self.setWidget(_waiting())

    def _fill(self) -> None:
        known = self._editor.activations
        if known is None or known is self._filled_for:
            return
        self._filled_for = known
        body = QWidget()
        grid = QGridLayout(body)
        grid.setVerticalSpacing(2)
        strongest = float(known.strength.max()) or 1.0
        for n, k in enumerate(known.order.tolist()):
            bar = QProgressBar()
            bar.setTextVisible(False)
            bar.setFixedSize(36, 6)
            bar.setValue(round(100 * float(known.strength[k]) / strongest))
            bar.setToolTip("Strength: how far its extreme among the examples changes the reference")
            slider = _slider(
                lambda position, k=k: self._slide(k, position),
                lambda k=k: self._editor.commit(self._title(k)),
            )
            slider.setProperty("component", k)
            slider.installEventFilter(self)
            value, reset = QLabel("0"), QToolButton()
            value.setFixedWidth(44)
            reset.setText("↺")
            reset.setToolTip("Back to the reference's value")
            reset.clicked.connect(lambda _, k=k: self._reset(k))
            model = self._editor.model
            name = QToolButton()
            name.setText(model.component_names.get(k, str(k)))
            name.setToolTip(f"{model.label(k).capitalize()}: click to keep it coloured")
            name.setAutoRaise(True)
            name.setCheckable(True)
            name.setMaximumWidth(96)
            name.clicked.connect(lambda on, k=k: self._colour(k, on))
            self._names[k] = name
            for widget in (name, bar):
                widget.setProperty("component", k)
                widget.installEventFilter(self)
            for column, widget in enumerate((name, bar, slider, value, reset)):
                grid.addWidget(widget, n, column)
            self._rows[k] = slider, value
        grid.setRowStretch(len(self._rows), 1)
        self.setWidget(body)

    def _colour(self, k: int, on: bool) -> None:
        self._editor.change_look(colour=f"component:{k}" if on else "plain")

    def _title(self, k: int) -> str:
        label = self._editor.model.label(k)
        return label[0].upper() + label[1:]

    def _limits(self, k: int) -> tuple[float, float]:
        known = self._filled_for
        low, high = float(known.low[k]), float(known.high[k])  # pyright: ignore
        return low, max(high, low + 1e-9)

    def _slide(self, k: int, position: int) -> None:
        low, high = self._limits(k)
        self._editor.slide(k, low + (high - low) * position / _STEPS)
        if not self._rows[k][0].isSliderDown():
            self._editor.commit(self._title(k))

    def _reset(self, k: int) -> None:
        self._editor.slide(k, float(self._editor.start_codes()["Reference"][k]))
        self._editor.commit(f"Reset {self._editor.model.label(k)}")

    def refresh(self) -> None:
        """Show the present code."""
        self._fill()
        code = self._editor.code
        for k, (slider, value) in self._rows.items():
            low, high = self._limits(k)
            _set(slider, _STEPS * (float(code[k]) - low) / (high - low))
            value.setText(f"{code[k]:z.2f}")
            self._names[k].setChecked(self._editor.look.colour == f"component:{k}")

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Show a component's support while the mouse is over its row."""
        component = watched.property("component")
        if component is not None and event.type() == QEvent.Type.Enter:
            self._editor.preview(int(component))
        elif component is not None and event.type() == QEvent.Type.Leave:
            self._editor.preview(None)
        return super().eventFilter(watched, event)
