"""The dock of the handles: a table, and numbers of the selected ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import (
    QAbstractItemView,
    QButtonGroup,
    QDoubleSpinBox,
    QFormLayout,
    QGridLayout,
    QHBoxLayout,
    QHeaderView,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from deformer_app.viewer.edit import KINDS, Handle, Kind
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.slider import Slider, geometric, geometric_position

_WEIGHTS = (0.05, 50.0)


class HandlePanel(QWidget):
    """All handles, and exact numbers for the selected ones.

    Attributes:
        table: a row for each handle.
        coordinates: x, y and z of the selected handles' common centre.
    """

    def __init__(self, editor: Editor) -> None:
        """Lay out; `refresh` fills it."""
        super().__init__()
        self._editor = editor
        self.table = QTableWidget(0, 4)
        self.table.setHorizontalHeaderLabels(["Handle", "Kind", "Weight", "Off by"])
        self.table.verticalHeader().hide()
        self.table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        header = self.table.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.table.itemSelectionChanged.connect(self._select)
        self._kinds, row = QButtonGroup(self), QHBoxLayout()
        tips = ("Close to its target", "Exactly on its target", "Stays where it is")
        for kind, tip in zip(KINDS, tips, strict=True):
            button = QPushButton(kind.capitalize())
            button.setCheckable(True)
            button.setToolTip(tip)
            button.clicked.connect(lambda _, k=kind: editor.set_kind(cast(Kind, k)))
            self._kinds.addButton(button, KINDS.index(kind))
            row.addWidget(button)
        self._weight = Slider(self._set_weight, lambda: editor.commit("Weight"))
        self._weight.setToolTip("How much a soft handle counts")
        self.coordinates = [QDoubleSpinBox() for _ in range(3)]
        numbers = QHBoxLayout()
        for axis, box in zip("xyz", self.coordinates, strict=True):
            box.setRange(-1e9, 1e9)
            box.setDecimals(4)
            box.setPrefix(f"{axis} ")
            box.setButtonSymbols(QDoubleSpinBox.ButtonSymbols.NoButtons)
            box.setMinimumWidth(72)
            box.setKeyboardTracking(False)
            box.valueChanged.connect(self._move)
            numbers.addWidget(box)
        layout = QVBoxLayout(self)
        layout.addWidget(self.table, 1)
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
        rows = {index.row() for index in self.table.selectionModel().selectedRows()}
        self._editor.select([ids[row] for row in sorted(rows) if row < len(ids)])

    def _set_weight(self, position: int) -> None:
        self._editor.set_weight(geometric(position, *_WEIGHTS))

    def _move(self) -> None:
        self._editor.set_centre([box.value() for box in self.coordinates])

    def refresh(self) -> None:
        """Show the current state."""
        editor = self._editor
        handles = editor.edit.handles
        diagonal = editor.model.reference.bounding_diagonal
        with QSignalBlocker(self.table):
            self._fill_table(handles, diagonal)
            self._mark_selected(handles)
        chosen = editor.state.selection(handles)
        for widget in (*self.coordinates, *self._kinds.buttons(), self._weight):
            widget.setEnabled(bool(chosen))
        kinds = {handle.kind for handle in chosen}
        self._kinds.setExclusive(False)
        for n, kind in enumerate(KINDS):
            self._kinds.button(n).setChecked(kinds == {kind})
        if not chosen:
            return
        self._weight.show_position(geometric_position(chosen[0].weight, *_WEIGHTS))
        self._weight.setEnabled("soft" in kinds)
        centre = np.mean([handle.centre for handle in chosen], axis=0)
        for box, value in zip(self.coordinates, centre, strict=True):
            box.setSingleStep(0.002 * diagonal)
            if editor.dragging or not box.hasFocus():  # else the user is typing
                with QSignalBlocker(box):
                    box.setValue(float(value))

    def _fill_table(self, handles: Sequence[Handle], diagonal: float) -> None:
        answer = self._editor.answer
        residual = np.zeros(0) if answer is None else answer.pose.residual
        angles = np.zeros(0) if answer is None else answer.pose.orientation_residual
        start = 0
        self.table.setRowCount(len(handles))
        for n, handle in enumerate(handles):
            distances = residual[start : start + len(handle.vertices)]
            turned = angles[start : start + len(handle.vertices)]
            off = f"{100 * float(distances.max()) / diagonal:.2f} %" if len(distances) else ""
            if len(turned) and not np.isnan(turned[0]):
                off += f", {np.degrees(turned[0]):.1f}°"
            start += len(handle.vertices)
            texts = (
                f"region {len(handle.patch)}" if handle.is_region else f"{handle.vertices[0]}",
                handle.kind,
                f"{handle.weight:.3g}" if handle.kind == "soft" else "–",
                off,
            )
            for column, text in enumerate(texts):
                item = self.table.item(n, column)
                if item is None:
                    self.table.setItem(n, column, QTableWidgetItem(text))
                elif item.text() != text:
                    item.setText(text)

    def _mark_selected(self, handles: Sequence[Handle]) -> None:
        selected = self._editor.selected
        wanted = [n for n, handle in enumerate(handles) if handle.id in selected]
        shown = {index.row() for index in self.table.selectionModel().selectedRows()}
        if shown == set(wanted):
            return
        self.table.clearSelection()
        mode = QAbstractItemView.SelectionMode
        self.table.setSelectionMode(mode.MultiSelection)
        for n in wanted:
            self.table.selectRow(n)
        self.table.setSelectionMode(mode.ExtendedSelection)
