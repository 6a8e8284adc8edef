"""The dialog with all steps of the history, of which one is shown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from PySide6.QtCore import QEvent, QPoint, QSignalBlocker, QSize, Qt
from PySide6.QtGui import QAction, QKeySequence, QPalette, QShortcut
from PySide6.QtWidgets import QDialog, QListWidget, QVBoxLayout, QWidget

from deformer_app.viewer.changes import Change, HistoryChanged, ModelClosed
from deformer_app.viewer.editor import Editor

_SIZE = QSize(250, 380)


class HistoryDialog(QDialog):
    """The labels of all steps; the selected one is shown, later ones are grey.

    Args:
        parent: the window.
        editor: has the history.
        actions: of the window, whose keys the dialog has, too.

    Attributes:
        steps: the list, with a row for each step.
    """

    def __init__(self, parent: QWidget, editor: Editor, actions: Sequence[QAction]) -> None:
        """Lay out and follow the history."""
        super().__init__(parent)
        self.setWindowTitle("History")
        self.resize(_SIZE)
        self.addActions(actions)
        self._editor = editor
        self._shown = 0
        self.steps = QListWidget()
        self.steps.setUniformItemSizes(True)
        self.steps.currentRowChanged.connect(self._go_to)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.steps)
        for key in ("Return", "Enter"):
            QShortcut(QKeySequence(key), self, self.hide)
        editor.on_change.append(self._hear)

    def toggle(self, corner: QPoint) -> None:
        """Show the dialog with its upper left corner at a point of the screen, or hide it."""
        if self.isVisible():
            self.hide()
            return
        self._fill()
        self.move(corner)
        self.show()
        self.activateWindow()
        self.steps.setFocus()

    def _hear(self, change: Change) -> None:
        if isinstance(change, HistoryChanged) and self.isVisible():
            self._fill()
        elif isinstance(change, ModelClosed):
            self.hide()

    def _fill(self) -> None:
        """List the steps; rows that are there stay, so that a long history takes no time."""
        session, steps = self._editor.session, self.steps
        labels = [f"{n}  {entry.label}" for n, entry in enumerate(session.entries)]
        with QSignalBlocker(steps):
            same = 0
            while same < min(len(labels), steps.count()):
                if steps.item(same).text() != labels[same]:
                    break
                same += 1
            while steps.count() > same:
                steps.takeItem(steps.count() - 1)
            steps.addItems(labels[same:])
            low, high = sorted((self._shown, session.cursor))
            self._colour({*range(low, min(high + 1, len(labels))), *range(same, len(labels))})
            steps.setCurrentRow(session.cursor)
        self._shown = session.cursor
        steps.scrollToItem(steps.item(session.cursor))

    def _colour(self, rows: Iterable[int]) -> None:
        """Make steps that are undone grey."""
        grey = self.palette().brush(QPalette.ColorGroup.Disabled, QPalette.ColorRole.Text)
        for n in rows:
            undone = n > self._editor.session.cursor
            self.steps.item(n).setData(Qt.ItemDataRole.ForegroundRole, grey if undone else None)

    def changeEvent(self, event: QEvent) -> None:
        """Take the grey of another theme."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and self.isVisible():
            with QSignalBlocker(self.steps):
                self._colour(range(self.steps.count()))

    def _go_to(self, row: int) -> None:
        """Show a step; where one is being made, that one stays."""
        self._editor.controller.finish()
        self._editor.go_to(row)
        self._fill()
