"""The dock of the handles: a table, and numbers of the selected ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtWidgets import (
    QAbstractItemView,
    QButtonGroup,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QStackedWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from deformer import InputError, vertex_errors
from deformer_app.viewer.changes import MistakeMade
from deformer_app.viewer.edit import KINDS, Handle, Kind
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.handle_table import HandleTable
from deformer_app.viewer.qt.number_field import NumberField
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
        self.table = HandleTable()
        self.table.itemChanged.connect(self._rename)
        self.table.itemSelectionChanged.connect(self._select)
        self._kinds, row = QButtonGroup(self), QHBoxLayout()
        tips = ("Close to its target", "Exactly on its target", "Stays where it is")
        for kind, tip, key in zip(KINDS, tips, "SEP", strict=True):
            button = QPushButton(kind.capitalize())
            button.setCheckable(True)
            button.setToolTip(f"{tip}  {key}")
            button.clicked.connect(lambda _, k=kind: editor.handles.set_kind(cast(Kind, k)))
            self._kinds.addButton(button, KINDS.index(kind))
            row.addWidget(button)
        self._weight = Slider(self._set_weight, lambda: editor.commit("Weight"))
        self._weight.setToolTip("How much a soft handle counts")
        self.coordinates = [NumberField(-1e9, 1e9) for _ in range(3)]
        numbers = QHBoxLayout()
        for n, box in enumerate(self.coordinates):
            box.setPrefix(f"{'xyz'[n]} ")
            box.setSpecialValueText(" ")
            box.setProperty("bare", True)  # no arrows
            box.setMinimumWidth(64)
            box.valueChanged.connect(lambda value, axis=n: self._move(axis, value))
            box.settled.connect(lambda: editor.commit("Move"))
            numbers.addWidget(box)
        layout = QVBoxLayout(self)
        layout.addWidget(self.table, 1)
        layout.addLayout(row)
        form = QFormLayout()
        # A pin has a size in place of a weight.
        self._strength_name, self._strength = QLabel("Weight"), QStackedWidget()
        self._strength.addWidget(self._weight)
        self._strength.addWidget(self._pin_sizes())
        form.addRow(self._strength_name, self._strength)
        form.addRow("At", numbers)
        layout.addLayout(form)
        buttons = QHBoxLayout()
        buttons.setSpacing(4)
        for title, tip, run in (
            ("Mirror", "Copy the handles to the body's other side  M",
              editor.mirror.mirror_handles),
            ("Suggest", "Where one more handle would tell most  N", editor.handles.suggest),
            ("Delete", "The selected handles  Del", editor.handles.delete),
            ("Clear", "All handles  Ctrl+Del", editor.handles.clear),
        ):  # fmt: skip
            button = QPushButton(title)
            button.setToolTip(tip)
            button.clicked.connect(lambda _, f=run: f())
            button.setProperty("narrow", True)
            buttons.addWidget(button, 1)
        layout.addLayout(buttons)

    def _pin_sizes(self) -> QWidget:
        """Buttons that make the selected pins smaller and larger, with their size between."""
        sizes = QWidget()
        row = QHBoxLayout(sizes)
        row.setContentsMargins(0, 0, 0, 0)
        self._pin_size = QLabel()
        self._pin_size.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._pin_buttons = QPushButton("−"), QPushButton("+")
        for button, steps, tip in zip(
            self._pin_buttons, (-1.0, 1.0), ("Smaller", "Larger"), strict=True
        ):
            button.setToolTip(f"{tip} patch; also Shift and the wheel over the pin")
            button.setProperty("narrow", True)
            button.clicked.connect(lambda _, n=steps: self._editor.pins.resize_selected(n))
        smaller, larger = self._pin_buttons
        for widget in (smaller, self._pin_size, larger):
            row.addWidget(widget)
        return sizes

    def _select(self) -> None:
        ids = [h.id for h in self._editor.edit.handles]
        rows = {index.row() for index in self.table.selectionModel().selectedRows()}
        self._editor.handles.select([ids[row] for row in sorted(rows) if row < len(ids)])

    def _rename(self, item: QTableWidgetItem) -> None:
        """Give a handle the name that has been typed, or show the old one again."""
        editor, handle = self._editor, self._editor.edit.handles[item.row()]
        try:
            editor.handles.names.rename(handle.id, item.text())
        except InputError as error:
            editor.announce(MistakeMade.of(error))
        self.refresh()

    def _set_weight(self, position: int) -> None:
        self._editor.handles.set_weight(geometric(position, *_WEIGHTS))

    def _move(self, axis: int, value: float) -> None:
        """Move the selected handles along one axis; the other coordinates are not rounded."""
        centre = self._centre()
        centre[axis] = value
        self._editor.handles.slide_centre(centre)

    def _centre(self) -> NDArray[np.float64]:
        """Common centre (3,) of the selected handles."""
        chosen = self._editor.state.selection(self._editor.edit.handles)
        return np.mean([handle.centre for handle in chosen], axis=0)

    def model_changed(self) -> None:
        """Another model is open: its handles are shown by the next `refresh`."""
        self.table.setRowCount(0)
        for box in self.coordinates:
            box.fit_size(self._editor.model.reference.bounding_diagonal)

    def refresh(self) -> None:
        """Show the current state."""
        editor = self._editor
        handles = editor.edit.handles
        diagonal = editor.model.reference.bounding_diagonal
        with QSignalBlocker(self.table):
            self._fill_table(handles, diagonal)
            self._mark_selected(handles)
        chosen = editor.state.selection(handles)
        for widget in (*self._kinds.buttons(), self._weight):
            widget.setEnabled(bool(chosen))
        for box in self.coordinates:
            box.setEnabled(bool(editor.state.movable(handles)))
            box.setToolTip("" if box.isEnabled() or not chosen else "Pinned: S makes it movable")
        pins = [handle for handle in chosen if handle.radius]
        self._strength.setCurrentIndex(1 if pins else 0)
        self._strength_name.setText("Pin size" if pins else "Weight")
        if pins:
            self._pin_size.setText(f"{100 * pins[0].radius:.1f} % of the body")
        kinds = {handle.kind for handle in chosen}
        self._kinds.setExclusive(False)
        for n, kind in enumerate(KINDS):
            self._kinds.button(n).setChecked(kinds == {kind})
        if not chosen:
            for box in self.coordinates:
                box.show_value(box.minimum())  # is shown as nothing
            return
        self._weight.show_position(geometric_position(chosen[0].weight, *_WEIGHTS))
        self._weight.setEnabled("soft" in kinds)
        for box, value in zip(self.coordinates, self._centre(), strict=True):
            if editor.dragging or not box.being_typed:
                box.show_value(float(value))

    def _fill_table(self, handles: Sequence[Handle], diagonal: float) -> None:
        editor, answer = self._editor, self._editor.answer
        solved = answer is not None and answer.request.edit == editor.edit
        angles = answer.pose.orientation_residual if answer is not None and solved else np.zeros(0)
        start = 0
        self.table.setRowCount(len(handles))
        acting = editor.state.acting(handles)  # a target under the floor is on it
        for n, handle in enumerate(acting):
            # Of the surface that is shown, which may be a frame of the clip.
            shown = editor.vertices[list(handle.vertices)]
            distances = vertex_errors(np.array(handle.targets), shown)
            turned = angles[start : start + len(handle.vertices)]
            off = f"{100 * float(distances.max()) / diagonal:.2f} %"
            if len(turned) and not np.isnan(turned[0]):
                off += f", {np.degrees(turned[0]):.0f}°"
            start += len(handle.vertices)
            texts = (
                self._editor.handles.names.of(handle),
                handle.kind,
                f"{handle.weight:.3g}" if handle.kind == "soft" else "–",
                off,
            )
            for column, text in enumerate(texts):
                item = self.table.item(n, column)
                if item is None:
                    self.table.setItem(n, column, _item(text, editable=column == 0))
                elif item.text() != text:
                    item.setText(text)
        self.table.fit()

    def _mark_selected(self, handles: Sequence[Handle]) -> None:
        selected = self._editor.handles.selected
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


def _item(text: str, editable: bool) -> QTableWidgetItem:
    item = QTableWidgetItem(text)
    if editable:
        item.setToolTip("Double click or F2 to rename; an empty name is that of the place")
    else:
        item.setFlags(item.flags() & ~Qt.ItemFlag.ItemIsEditable)
    return item
