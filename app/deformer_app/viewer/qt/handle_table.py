"""The table of the handles, whose names keep their room."""

from __future__ import annotations

from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget

_ROW = 23  # pixels of a row
_COLUMNS = ("Handle", "Kind", "Weight", "Off by")
_NAME, _WEIGHT = 0, 2  # columns
_LONGEST = 140  # pixels of a name that is shown in full if need be
_MARGIN = 4  # pixels beside a name that Qt needs to show it in full


class HandleTable(QTableWidget):
    """A row for each handle: name, kind, weight, and how far it is off its target.

    Names take the room that the other columns leave. Where that is too little for them, the column
    of the weights disappears: the weight of a selected handle is shown below the table, too.
    """

    def __init__(self) -> None:
        """Start without rows."""
        super().__init__(0, len(_COLUMNS))
        self.setHorizontalHeaderLabels(_COLUMNS)
        self.verticalHeader().hide()
        self.verticalHeader().setMinimumSectionSize(_ROW)
        self.verticalHeader().setDefaultSectionSize(_ROW)
        self.setTabKeyNavigation(False)  # Tab goes on to the next widget
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        triggers = QAbstractItemView.EditTrigger
        self.setEditTriggers(triggers.DoubleClicked | triggers.EditKeyPressed)
        header = self.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(_NAME, QHeaderView.ResizeMode.Stretch)

    def fit(self) -> None:
        """Show the weights if there is room for them beside the names."""
        header = self.horizontalHeader()
        names = min(self.sizeHintForColumn(_NAME) + _MARGIN, _LONGEST)
        self.setColumnHidden(_WEIGHT, False)  # a hidden column has no size
        others = sum(
            max(self.sizeHintForColumn(n), header.sectionSizeHint(n))
            for n in range(len(_COLUMNS))
            if n != _NAME
        )
        self.setColumnHidden(_WEIGHT, self.viewport().width() < names + others)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the columns into the new width."""
        super().resizeEvent(event)
        self.fit()
