"""The dock of the timeline: playback, keys, onion skins, the ruler and the rows of keys."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QSignalBlocker
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QSizePolicy,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from deformer_app.viewer.qt.horizontal_scroll import HorizontalScroll
from deformer_app.viewer.qt.icons import put_icon
from deformer_app.viewer.qt.number_field import NumberField
from deformer_app.viewer.qt.onion_button import OnionButton
from deformer_app.viewer.qt.surroundings import Surroundings
from deformer_app.viewer.qt.timeline_buttons import TimelineButtons, tool_button
from deformer_app.viewer.qt.timeline_rows import ROW, TimelineRows, WholeRows
from deformer_app.viewer.qt.timeline_ruler import TimelineRuler
from deformer_app.viewer.qt.timeline_summary import TimelineSummary
from deformer_app.viewer.qt.timeline_view import LABELS
from deformer_app.viewer.timeline.keys import LONGEST, RATES
from deformer_app.viewer.timeline.scale import Scale

_NUMBER = 58  # width of a field, in pixels
_BESIDE = 14  # pixels between the progress and frame 0, for the playhead's number


class TimelinePanel(QWidget):
    """Playback, keys and the playhead.

    Args:
        of: parts of the window that the panel uses.

    Attributes:
        ruler: numbers of frames.
        summary: the keys of each frame as one.
        rows: the keys.
        buttons: previous key, play, next key, and key.
        frame, length: fields of the playhead and of the number of frames.
        onion: button of the onion skins.
        progress: bar of the fit.
    """

    def __init__(self, of: Surroundings) -> None:
        """Lay out; `refresh` fills it."""
        super().__init__()
        self._editor, self._seen = of.editor, frozenset[int]()
        self._timeline, self._view = of.editor.timeline, of.time
        self.ruler = TimelineRuler(of.time)
        self.summary = TimelineSummary(of.time)
        self.rows = TimelineRows(of.editor, of.time)
        column = QVBoxLayout(self)
        column.setContentsMargins(4, 2, 4, 2)
        column.setSpacing(2)
        self.onion = OnionButton(self._timeline)
        column.addWidget(self._controls())
        column.addWidget(self.ruler)
        self._add_progress()
        column.addWidget(self.summary)
        self._area = WholeRows(self.rows)
        column.addWidget(self._area, 1)
        self._timeline.on_change.append(self.refresh)

    def _controls(self) -> QWidget:
        timeline, body = self._timeline, QWidget()
        row = QHBoxLayout(body)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(4)
        self.buttons = TimelineButtons(timeline)
        for button in self.buttons.playback:
            row.addWidget(button)
        self.loop = self._check(row, "Loop", "Play again and again", timeline.set_loop)
        self.frame = self._spin(row, "Frame", 0, LONGEST - 1, timeline.seek)
        self.length = self._spin(row, "of", 1, LONGEST, lambda n: timeline.set_clip(length=n))
        self.rate = QComboBox()
        self.rate.addItems([f"{rate} fps" for rate in RATES])
        self.rate.setToolTip("Frames a second")
        self.rate.activated.connect(lambda n: timeline.set_clip(fps=RATES[n]))
        row.addWidget(self.rate)
        row.addSpacing(8)
        row.addWidget(self.buttons.key)
        row.addWidget(tool_button("Delete", "Delete the selected keys, or those at the playhead  "
                                  "Shift+K", timeline.keys.delete))  # fmt: skip
        self.auto = self._check(row, "Auto-key", "Once there are keys, every change of a handle or "
                                "slider sets one at the playhead", self._set_auto)  # fmt: skip
        self.smoothness = NumberField(0.0, 1000.0, 0)
        self.smoothness.setFixedWidth(_NUMBER)
        self.smoothness.setToolTip("Smoothness of the fit: 0 keeps every key's pose; 10 and more "
                                   "lessens the jitter of markers")  # fmt: skip
        self.smoothness.valueChanged.connect(lambda v: timeline.set_clip(smoothness=float(v)))
        row.addWidget(QLabel("Smooth"))
        row.addWidget(self.smoothness)
        row.addWidget(self.onion)
        row.addStretch(1)
        area = HorizontalScroll(body)
        area.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed)
        return area

    def _add_progress(self) -> None:
        """Add the progress of the fit beside the ruler's numbers, where nothing else is."""
        place = QWidget(self.ruler)
        place.setGeometry(0, 0, LABELS - _BESIDE, self.ruler.height())
        row = QHBoxLayout(place)
        row.setContentsMargins(0, 1, 0, 1)
        row.setSpacing(2)
        self.progress = QProgressBar()
        self.progress.setToolTip("Frames whose poses have been fitted to the keys")
        row.addWidget(self.progress, 1)
        self.cancel = tool_button("", "Stop the fit", self._timeline.cancel_fit)
        row.addWidget(self.cancel)
        put_icon(self.cancel, "x")

    def _check(
        self, row: QHBoxLayout, text: str, tip: str, run: Callable[[bool], Any]
    ) -> QCheckBox:
        box = QCheckBox(text)
        box.setToolTip(tip)
        box.toggled.connect(run)
        row.addWidget(box)
        row.addSpacing(6)
        return box

    def _spin(
        self, row: QHBoxLayout, label: str, low: int, high: int, run: Callable[[int], Any]
    ) -> QSpinBox:
        box = QSpinBox()
        box.setRange(low, high)
        box.setFixedWidth(_NUMBER)
        box.setKeyboardTracking(False)
        box.valueChanged.connect(run)
        row.addWidget(QLabel(label))
        row.addWidget(box)
        return box

    def _set_auto(self, on: bool) -> None:
        self._timeline.auto_key = on

    @property
    def scale(self) -> Scale:
        """Where frames are."""
        return self._view.scale

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Zoom about the mouse; with Shift, or sideways, scroll."""
        self._view.turn(event, event.position().x() - self.ruler.x() - LABELS)

    # What is shown.

    def model_changed(self) -> None:
        """Another model is open."""
        self.refresh()

    def refresh(self) -> None:
        """Show the keys, the playhead and the progress."""
        timeline, clip = self._timeline, self._timeline.clip
        self.onion.refresh()
        for box, value in ((self.frame, timeline.frame), (self.length, clip.length)):
            if box.value() != value:
                with QSignalBlocker(box):
                    box.setValue(value)
        if not self.smoothness.being_typed:
            self.smoothness.show_value(clip.smoothness)
        self.rate.setCurrentIndex(RATES.index(clip.fps))
        for check, on in ((self.loop, timeline.loop), (self.auto, timeline.auto_key)):
            with QSignalBlocker(check):
                check.setChecked(on)
        progress = timeline.progress
        self.progress.setVisible(progress is not None)
        self.cancel.setVisible(progress is not None)
        if progress is not None:
            done, total = progress
            # Hundreds of frames are fitted together and counted when all of them are done.
            self.progress.setFormat("%v of %m" if done else "Fitting …")
            self.progress.setRange(0, total)
            self.progress.setValue(done)
        self.rows.updateGeometry()
        self._show_selected()

    def _show_selected(self) -> None:
        """Scroll to the handles that have been selected since the last time."""
        selected = self._editor.handles.selected
        if selected != self._seen:
            for owner in sorted(selected - self._seen or selected, reverse=True):
                y = self.rows.middle(owner)
                if y is not None:
                    self._area.ensureVisible(0, round(y), 0, ROW // 2)
        self._seen = selected
