"""Lists of poses as pictures in a row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from PySide6.QtCore import (
    QEvent,
    QModelIndex,
    QPersistentModelIndex,
    QPoint,
    QSignalBlocker,
    QSize,
    Qt,
    Signal,
)
from PySide6.QtGui import QDropEvent, QIcon, QKeyEvent, QKeySequence
from PySide6.QtWidgets import (
    QAbstractItemView,
    QListWidget,
    QListWidgetItem,
    QStyledItemDelegate,
    QStyleOptionViewItem,
)

from deformer_app.rendering.offscreen import Picture
from deformer_app.viewer.qt.pixmaps import pixmap_of
from deformer_app.viewer.shape_thumbnails import Code, Subject, Thumbnails

_PICTURE, _ITEM = QSize(72, 72), QSize(88, 96)  # pixels


class NamedCode(NamedTuple):
    """A pose of a list.

    Args:
        name: shown below its picture.
        code: latent code (K,).
    """

    name: str
    code: Code


class PoseList(QListWidget):
    """Poses as pictures in a row; pictures are asked for when they are first seen.

    Args:
        thumbnails: pictures of the poses.

    Attributes:
        started: emitted with the row of a double click or Return.
        copied: emitted with the row that is selected at Ctrl+C.
        deleted: emitted with the row that is selected at Delete.
        renamed: emitted with a row and the text that the user has entered.
        moved: emitted with a row and the one that it shall be.
    """

    started = Signal(int)
    copied = Signal(int)
    deleted = Signal(int)
    renamed = Signal(int, str)
    moved = Signal(int, int)

    def __init__(self, thumbnails: Thumbnails, editable: bool = False) -> None:
        """Start without poses."""
        super().__init__()
        self.poses: list[NamedCode] = []
        self._editable = editable
        self.setFlow(QListWidget.Flow.LeftToRight)
        self.setWrapping(False)
        self.setIconSize(_PICTURE)
        self.setUniformItemSizes(True)
        self.setTextElideMode(Qt.TextElideMode.ElideRight)
        self.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setHorizontalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.setMinimumHeight(_ITEM.height() + 20)
        self.setItemDelegate(_Delegate(self, thumbnails))
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setDragDropMode(
            QAbstractItemView.DragDropMode.InternalMove
            if editable
            else QAbstractItemView.DragDropMode.NoDragDrop
        )
        self.doubleClicked.connect(lambda index: self.started.emit(index.row()))
        self.itemChanged.connect(self._edited)
        thumbnails.on_drawn.append(self._show_picture)

    def show_poses(self, poses: Sequence[NamedCode]) -> None:
        """Show other poses; the selection stays at the pose, also under another name."""
        if self.poses == list(poses):
            return
        chosen, row, count = self.chosen, self.currentRow(), len(self.poses)
        # Clearing selects other rows, one by one; listeners hear of the selection once, at the end.
        with QSignalBlocker(self):
            self.clear()
            self.poses = list(poses)
            for pose in self.poses:
                item = QListWidgetItem(pose.name)
                item.setSizeHint(_ITEM)
                item.setToolTip(f"{pose.name}: double click to start from it")
                if self._editable:
                    item.setFlags(item.flags() | Qt.ItemFlag.ItemIsEditable)
                self.addItem(item)
            names = [pose.name for pose in self.poses]
            if chosen is not None and chosen.name in names:
                self.setCurrentRow(names.index(chosen.name))
            elif chosen is not None and count == len(names):
                self.setCurrentRow(row)
        if self.chosen != chosen:
            self.itemSelectionChanged.emit()

    @property
    def chosen(self) -> NamedCode | None:
        """The selected pose, if there is one."""
        row = self.currentRow()
        return self.poses[row] if 0 <= row < len(self.poses) and self.selectedItems() else None

    def rename(self, row: int) -> None:
        """Let the user edit the name of a pose."""
        self.editItem(self.item(row))

    def _edited(self, item: QListWidgetItem) -> None:
        row = self.row(item)
        if 0 <= row < len(self.poses) and item.text() != self.poses[row].name:
            text, before = item.text(), self.poses[row].name
            with QSignalBlocker(self):
                item.setText(before)  # the name stays if another pose has the new one
            self.renamed.emit(row, text)

    def _show_picture(self, subject: Subject) -> None:
        if subject.component is None:
            self.viewport().update()

    def _key(self, event: QKeyEvent) -> Callable[[], Any] | None:
        """Return what a key does here, in place of what it does in the window.

        Tab may lead to a list that another dock covers: its keys are the window's.
        """
        row, covered = self.currentRow(), self.visibleRegion().isEmpty()
        if row < 0 or covered or self.state() == QAbstractItemView.State.EditingState:
            return None
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            return lambda: self.started.emit(row)
        if event.matches(QKeySequence.StandardKey.Copy):
            return lambda: self.copied.emit(row)
        if not self._editable:
            return None
        if event.key() == Qt.Key.Key_Delete:
            return lambda: self.deleted.emit(row)
        if event.key() == Qt.Key.Key_F2:
            return lambda: self.rename(row)
        if event.modifiers() & Qt.KeyboardModifier.AltModifier:
            step = {Qt.Key.Key_Left: -1, Qt.Key.Key_Right: 1}.get(Qt.Key(event.key()), 0)
            if step and 0 <= row + step < len(self.poses):
                return lambda: self.moved.emit(row, row + step)
        return None

    def event(self, event: QEvent) -> bool:
        """Keep keys of the list from the window's shortcuts."""
        override = event.type() == QEvent.Type.ShortcutOverride
        if override and isinstance(event, QKeyEvent) and self._key(event) is not None:
            event.accept()
            return True
        return super().event(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Run a key of the list."""
        run = self._key(event)
        if run is None:
            super().keyPressEvent(event)
        else:
            run()

    def dropEvent(self, event: QDropEvent) -> None:
        """Move the dragged pose to where it is dropped."""
        row, to = self.currentRow(), self._row_at(event.position().toPoint())
        # Qt would remove the row after a move; the shelf moves it.
        event.setDropAction(Qt.DropAction.CopyAction)
        event.accept()
        if to not in (row, row + 1):
            self.moved.emit(row, to - (to > row))

    def _row_at(self, at: QPoint) -> int:
        """Return the row before which something is dropped."""
        index = self.indexAt(at)
        if not index.isValid():
            return len(self.poses)
        return index.row() + (at.x() > self.visualRect(index).center().x())


class _Delegate(QStyledItemDelegate):
    """Draws a pose: its picture, and its name below."""

    def __init__(self, shown: PoseList, thumbnails: Thumbnails) -> None:
        super().__init__(shown)
        self._list, self._thumbnails = shown, thumbnails
        self._icons: dict[Code, tuple[Picture, QIcon]] = {}

    def initStyleOption(
        self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        """Add the picture; only what is seen is drawn, so only that is asked for."""
        super().initStyleOption(option, index)
        found: Any = option  # PySide6's stubs lack the fields
        found.decorationPosition = QStyleOptionViewItem.Position.Top
        found.decorationAlignment = Qt.AlignmentFlag.AlignCenter
        found.displayAlignment = Qt.AlignmentFlag.AlignCenter
        found.decorationSize = _PICTURE
        found.features |= QStyleOptionViewItem.ViewItemFeature.HasDecoration
        if index.row() < len(self._list.poses):
            found.icon = self._icon(self._list.poses[index.row()].code)

    def _icon(self, code: Code) -> QIcon:
        pictures = self._thumbnails.pictures(Subject((code,)))
        if pictures is None:
            return QIcon()
        known = self._icons.get(code)
        if known is None or known[0] is not pictures[0]:
            if len(self._icons) > 500:
                self._icons.clear()
            known = self._icons[code] = pictures[0], QIcon(pixmap_of(pictures[0]))
        return known[1]
