"""The table of the handles, whose names keep their room."""

from __future__ import annotations

from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget

_ROW = 23  # pixels of a row
_COLUMNS = ("Handle", "Kind", "Weight", "Off by")
_NAME, _WEIGHT, _OFF = 0, 2, 3  # columns
_WIDE = "88.88 %"  # of the last column
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
        names = min(self.sizeHintForColumn(_NAME) + _MARGIN, _LONGEST)
        self.setColumnHidden(_WEIGHT, False)  # a hidden column has no size
        header = self.horizontalHeader()
        needed = {
            n: max(self.sizeHintForColumn(n) + self._spare(n), header.sectionSizeHint(n))
            for n in range(len(_COLUMNS))
            if n != _NAME
        }
        others = sum(needed.values())
        self.setColumnHidden(_WEIGHT, self.viewport().width() < names + others)

    def _spare(self, column: int) -> int:
        """Pixels kept for digits, so that weights do not come and go while a clip plays."""
        if column != _OFF or not self.rowCount():
            return 0
        width = self.fontMetrics().horizontalAdvance
        items = [self.item(row, column) for row in range(self.rowCount())]
        return max(width(_WIDE) - max(width(item.text()) for item in items if item), 0)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the columns into the new width."""
        super().resizeEvent(event)
        self.fit()
