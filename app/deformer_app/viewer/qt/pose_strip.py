"""The dock of poses: saved ones and examples as pictures, and blends with them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import (
    QApplication,
    QHBoxLayout,
    QLabel,
    QMenu,
    QPushButton,
    QSizePolicy,
    QSplitter,
    QVBoxLayout,
    QWidget,
)

import deformer
from deformer_app.viewer.model_files import start_codes
from deformer_app.viewer.pose_blend import PoseBlend
from deformer_app.viewer.pose_commands import change_poses, copied, save_pose, start_from
from deformer_app.viewer.poses import SavedPose
from deformer_app.viewer.qt.elided_label import ElidedLabel
from deformer_app.viewer.qt.horizontal_scroll import HorizontalScroll
from deformer_app.viewer.qt.pose_list import NamedCode, PoseList
from deformer_app.viewer.qt.slider import STEPS, Slider
from deformer_app.viewer.qt.surroundings import Surroundings
from deformer_app.viewer.qt.time_strip import TimeStrip

_FEW = 24  # examples that are shown at first
_SLIDER = 60  # pixels, at least
_FIXED = 2  # the reference and the mean, which come before the examples


class PoseStrip(QWidget):
    """Poses to start from and to blend with.

    Args:
        of: parts of the window that the strip uses.

    Attributes:
        saved: the session's saved poses.
        examples: the reference, the mean and the training shapes.
        every: button that shows all examples in place of a few that represent them.
        save: button that saves the present pose.
        blend: slider from the present pose to the selected one.
        time: playhead and keys, while there are keys or the dock of the timeline is open.
    """

    def __init__(self, of: Surroundings) -> None:
        """Start empty; `refresh` fills it."""
        super().__init__()
        self._of, self._editor = of, of.editor
        self._blend = PoseBlend(of.editor)
        self._all: list[NamedCode] = []
        self._theme: Any = None
        self.time, self._timeline_open = TimeStrip(of.time), False
        self.saved = PoseList(of.thumbnails, editable=True)
        self.examples = PoseList(of.thumbnails)
        self.save = QPushButton("Save pose")
        self.save.setToolTip("Keep the present pose with the session (Ctrl+D)")
        self.save.clicked.connect(lambda: of.attempt(lambda: save_pose(of.editor)))
        self.every = QPushButton()
        self.every.setCheckable(True)
        self.every.setToolTip("A few that represent the others, or all in their order")
        self.every.clicked.connect(self._list_examples)
        self.blend = Slider(lambda n: self._blend.move(n / STEPS), self._blend.commit)
        self.blend.setToolTip("From the present pose to the selected one")
        self.blend.setMinimumWidth(_SLIDER)
        self._blend_label = ElidedLabel()
        for shown in (self.saved, self.examples):
            shown.itemSelectionChanged.connect(lambda s=shown: self._choose(s))
            shown.started.connect(lambda row, s=shown: self._start(self._pose(s, row)))
            shown.copied.connect(lambda row, s=shown: self._copy(self._pose(s, row)))
            shown.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
            shown.customContextMenuRequested.connect(lambda at, s=shown: self._ask(s, at))
        self.saved.deleted.connect(self._delete)
        self.saved.renamed.connect(self._rename)
        self.saved.moved.connect(self._move)
        self._lay_out()

    def _lay_out(self) -> None:
        lists = QSplitter(Qt.Orientation.Horizontal)
        for shown, title, button in (
            (self.saved, "Saved poses", self.save),
            (self.examples, "Examples", self.every),
        ):
            part = QWidget()
            head = QHBoxLayout()
            head.addWidget(QLabel(title))
            head.addWidget(button)
            if shown is self.saved:
                head.addStretch(1)
            else:
                self._blend_label.setAlignment(
                    Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
                )
                # A share of the width, whatever its text: the slider stays where it is.
                self._blend_label.setSizePolicy(
                    QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred
                )
                head.addWidget(self._blend_label, 1)
                head.addWidget(self.blend, 1)
            column = QVBoxLayout(part)
            column.setContentsMargins(4, 2, 4, 4)
            column.setSpacing(3)
            column.addLayout(head)
            column.addWidget(shown, 1)
            lists.addWidget(part)
        lists.setStretchFactor(0, 1)
        lists.setStretchFactor(1, 2)
        lists.setChildrenCollapsible(False)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.time)
        column.addWidget(HorizontalScroll(lists))
        self._editor.timeline.on_change.append(self._show_time)
        self._show_time()

    def follow_timeline(self, is_open: bool) -> None:
        """Show the playhead while the dock of the timeline is open, even without keys."""
        self._timeline_open = is_open
        self._show_time()

    def _show_time(self) -> None:
        self.time.setVisible(self._timeline_open or bool(self._editor.timeline.clip.tracks))

    @property
    def shows_time(self) -> bool:
        """True while the user sees the playhead here."""
        return not self.time.visibleRegion().isEmpty()

    def model_changed(self) -> None:
        """List the examples of another model."""
        found = start_codes(self._editor.model).items()
        self._all = [NamedCode(name, tuple(code.tolist())) for name, code in found]
        few = len(self._all) <= _FIXED + _FEW
        self.every.setVisible(not few)
        self.every.setText(f"All {len(self._all) - _FIXED}")
        self.every.setChecked(False)
        self._blend.choose(None)
        self.saved.show_poses([])
        self._list_examples()

    def _list_examples(self) -> None:
        """Show the examples, or those of them that represent the others."""
        examples = self._all
        if not self.every.isChecked() and len(examples) > _FIXED + _FEW:
            codes = self._editor.model.codes
            rows = deformer.spread(codes - codes.mean(axis=0), _FEW).tolist()
            examples = examples[:_FIXED] + [examples[_FIXED + row] for row in rows]
        self.examples.show_poses(examples)

    def refresh(self) -> None:
        """Show the saved poses and the share of a blend."""
        editor = self._editor
        poses = editor.session.shelf.poses
        self.saved.show_poses([NamedCode(pose.name, pose.code) for pose in poses])
        self.blend.setEnabled(self._blend.chosen is not None)
        share = f": {int(100 * self._blend.share)} %" if self._blend.share else ""
        self._blend_label.setText(f"Blend with {self._blend.chosen or 'a selected pose'}{share}")
        self.blend.show_position(STEPS * self._blend.share)
        if editor.state.view.theme is not self._theme:
            self._theme = editor.state.view.theme
            for shown in (self.saved, self.examples):
                shown.viewport().update()

    def _choose(self, shown: PoseList) -> None:
        """Blend with the selected pose; only one is selected in both lists."""
        pose = shown.chosen
        if pose is not None:
            other = self.examples if shown is self.saved else self.saved
            other.clearSelection()
            self._blend.choose(self._pose(shown, shown.currentRow()))
        elif not (self.saved.selectedItems() or self.examples.selectedItems()):
            self._blend.choose(None)
        if self._editor.is_open:
            self.refresh()

    def _pose(self, shown: PoseList, row: int) -> SavedPose:
        """The pose of a row of a list."""
        if shown is self.saved:
            return self._editor.session.shelf.poses[row]
        return SavedPose.of_code(*shown.poses[row])

    def _start(self, pose: SavedPose) -> None:
        start_from(self._editor, pose)

    def _copy(self, pose: SavedPose) -> None:
        QApplication.clipboard().setText(copied(self._editor, pose))
        self._editor.note(f"Copied “{pose.name}”")

    def _change(self, change: Callable[[Any], Any]) -> None:
        self._of.attempt(lambda: change_poses(self._editor, change))
        self.refresh()

    def _delete(self, row: int) -> None:
        name = self.saved.poses[row].name
        self._change(lambda shelf: shelf.delete(row))
        self._editor.note(f"Deleted “{name}”; the menu of the saved poses brings it back")

    def _rename(self, row: int, name: str) -> None:
        self._change(lambda shelf: shelf.rename(row, name))

    def _move(self, row: int, to: int) -> None:
        self._change(lambda shelf: shelf.move(row, to))
        self.saved.setCurrentRow(to)

    def menu(self, shown: PoseList, row: int) -> QMenu:
        """Return the menu of a row of a list; −1 is none of its rows."""
        menu = QMenu(self)
        editor = self._editor
        shelf = editor.session.shelf
        if row >= 0:
            pose = self._pose(shown, row)
            menu.addAction("Start from it", lambda: self._start(pose))
            if pose.handles:
                menu.addAction(
                    "Start from its shape, with the present handles",
                    lambda: editor.prior.start_at(
                        f"Start from the shape of {pose.name}", pose.code
                    ),
                )
            menu.addAction("Copy", lambda: self._copy(pose))
        if shown is self.saved:
            if row >= 0:
                menu.addSeparator()
                menu.addAction("Rename", lambda: self.saved.rename(row))
                if row > 0:
                    menu.addAction("Move left", lambda: self._move(row, row - 1))
                if row + 1 < len(shown.poses):
                    menu.addAction("Move right", lambda: self._move(row, row + 1))
                menu.addAction("Delete", lambda: self._delete(row))
            if shelf.deleted is not None:
                bring = f"Bring back “{shelf.deleted.name}”"
                menu.addAction(bring, lambda: self._change(lambda s: s.restore()))
        return menu

    def _ask(self, shown: PoseList, at: QPoint) -> None:
        menu = self.menu(shown, shown.indexAt(at).row())
        if menu.actions():
            menu.exec(shown.viewport().mapToGlobal(at))
