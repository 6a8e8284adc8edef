"""The button of the onion skins: its menu says which of them are shown."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import (
    QCheckBox,
    QFormLayout,
    QMenu,
    QSpinBox,
    QToolButton,
    QWidget,
    QWidgetAction,
)

from deformer_app.viewer.timeline.onion import MOST
from deformer_app.viewer.timeline.timeline import Timeline


class OnionButton(QToolButton):
    """Opens a menu with the numbers of skins; it is checked while any are shown.

    Args:
        timeline: whose skins they are.

    Attributes:
        before, after: fields of the numbers of skins.
        at_keys: whether they are shapes of neighbouring keys.
    """

    def __init__(self, timeline: Timeline) -> None:
        """Lay out; `refresh` fills the fields."""
        super().__init__()
        self._timeline = timeline
        self.setText("Onion skins ▾")
        self.setToolTip("Translucent shapes of earlier and later frames")
        self.setCheckable(True)
        self.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        self.setStyleSheet("QToolButton::menu-indicator { image: none; }")  # the text has one
        page = QWidget()
        form = QFormLayout(page)
        form.setContentsMargins(14, 8, 14, 8)
        self.before = _number(lambda n: timeline.set_onion(before=n))
        self.after = _number(lambda n: timeline.set_onion(after=n))
        self.at_keys = QCheckBox("At keys")
        self.at_keys.setToolTip("Shapes at the neighbouring keys, not at neighbouring frames")
        self.at_keys.toggled.connect(lambda on: timeline.set_onion(at_keys=on))
        form.addRow("Before", self.before)
        form.addRow("After", self.after)
        form.addRow(self.at_keys)
        menu = QMenu(self)
        entry = QWidgetAction(menu)
        entry.setDefaultWidget(page)
        menu.addAction(entry)
        menu.aboutToHide.connect(self.refresh)
        self.setMenu(menu)

    def refresh(self) -> None:
        """Show what the timeline has."""
        onion = self._timeline.onion
        for box, value in ((self.before, onion.before), (self.after, onion.after)):
            if box.value() != value:
                with QSignalBlocker(box):
                    box.setValue(value)
        with QSignalBlocker(self.at_keys):
            self.at_keys.setChecked(onion.at_keys)
        self.setChecked(bool(onion.before or onion.after))


def _number(run: Callable[[int], Any]) -> QSpinBox:
    box = QSpinBox()
    box.setRange(0, MOST)
    box.valueChanged.connect(run)
    return box
