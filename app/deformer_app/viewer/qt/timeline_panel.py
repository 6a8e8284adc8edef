"""The dock of the timeline: playback, keys, onion skins, the ruler and the rows of keys."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtGui import QResizeEvent, QWheelEvent
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QScrollArea,
    QSpinBox,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.onion_button import OnionButton
from deformer_app.viewer.qt.timeline_rows import TimelineRows
from deformer_app.viewer.qt.timeline_ruler import LABELS, TimelineRuler
from deformer_app.viewer.timeline.keys import LONGEST, RATES
from deformer_app.viewer.timeline.scale import Scale

_ZOOM = 1.2  # a notch of the wheel
_NOTCH = 120  # Qt's units of a notch
_NUMBER = 58  # width of a field, in pixels


class TimelinePanel(QWidget):
    """Playback, keys and the playhead.

    Args:
        editor: whose handles are keyed.

    Attributes:
        ruler: numbers of frames.
        rows: the keys.
        play: the button that plays or stops.
        frame, length: fields of the playhead and of the number of frames.
        onion: button of the onion skins.
        progress: bar of the fit.
    """

    def __init__(self, editor: Editor) -> None:
        """Lay out; `refresh` fills it."""
        super().__init__()
        self._editor, self._seen = editor, frozenset[int]()
        self._timeline = timeline = editor.timeline
        self._scale, self._fitted_to = Scale(), (0, 0)
        self.ruler = TimelineRuler(timeline, lambda: self._scale)
        self.rows = TimelineRows(editor, lambda: self._scale)
        column = QVBoxLayout(self)
        column.setContentsMargins(4, 2, 4, 2)
        column.setSpacing(2)
        self.onion = OnionButton(timeline)
        top = QHBoxLayout()
        top.addWidget(_narrow(self._playback_row()), 1)
        top.addLayout(self._fit_row())  # always in sight
        column.addLayout(top)
        column.addWidget(self.ruler)
        self._area = area = QScrollArea()
        area.setWidgetResizable(True)
        area.setFrameShape(QScrollArea.Shape.NoFrame)
        area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        area.setWidget(self.rows)
        area.setMinimumHeight(72)
        column.addWidget(area, 1)
        timeline.on_change.append(self.refresh)

    def _playback_row(self) -> QHBoxLayout:
        timeline, row = self._timeline, QHBoxLayout()
        row.setSpacing(4)
        self.previous = self._button(row, "◂◆", "Previous key  Ctrl+Left",
                                     lambda: timeline.go_to_key(-1))  # fmt: skip
        self.play = self._button(row, "▶", "Play or stop  Space", timeline.play_or_stop)
        self.next = self._button(row, "◆▸", "Next key  Ctrl+Right", lambda: timeline.go_to_key(1))
        self.loop = self._check(row, "Loop", "Play again and again", timeline.set_loop)
        self.frame = self._spin(row, "Frame", 0, LONGEST - 1, timeline.seek)
        self.length = self._spin(row, "of", 1, LONGEST, lambda n: timeline.set_clip(length=n))
        self.rate = QComboBox()
        self.rate.addItems([f"{rate} fps" for rate in RATES])
        self.rate.setToolTip("Frames a second")
        self.rate.activated.connect(lambda n: timeline.set_clip(fps=RATES[n]))
        row.addWidget(self.rate)
        row.addSpacing(8)
        self.key = self._button(
            row, "◆ Key", "Key the selected handles, or all  K", timeline.keys.set
        )
        self.delete = self._button(row, "Delete", "Delete the selected keys, or those at the "
                                   "playhead  Shift+K", timeline.keys.delete)  # fmt: skip
        self.auto = self._check(row, "Auto-key", "Once there are keys, every change of a handle or "
                                "slider sets one at the playhead", self._set_auto)  # fmt: skip
        self.smoothness = QDoubleSpinBox()
        self.smoothness.setRange(0.0, 1000.0)
        self.smoothness.setDecimals(0)
        self.smoothness.setFixedWidth(_NUMBER)
        self.smoothness.setKeyboardTracking(False)
        self.smoothness.setToolTip("Smoothness of the fit: 0 keeps every key's pose; 10 and more "
                                   "lessens the jitter of markers")  # fmt: skip
        self.smoothness.valueChanged.connect(lambda v: timeline.set_clip(smoothness=float(v)))
        row.addWidget(QLabel("Smooth"))
        row.addWidget(self.smoothness)
        row.addWidget(self.onion)
        row.addStretch(1)
        return row

    def _fit_row(self) -> QHBoxLayout:
        row = QHBoxLayout()
        row.setSpacing(4)
        self.progress = QProgressBar()
        self.progress.setFixedWidth(110)
        row.addWidget(self.progress)
        self.cancel = self._button(row, "✕", "Stop the fit", self._timeline.cancel_fit)
        return row

    def _button(self, row: QHBoxLayout, text: str, tip: str, run: Callable[[], Any]) -> QToolButton:
        button = QToolButton()
        button.setText(text)
        button.setToolTip(tip)
        button.setProperty("narrow", True)
        button.clicked.connect(lambda _=False: run())
        row.addWidget(button)
        return button

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

    # The scale.

    @property
    def scale(self) -> Scale:
        """Where frames are."""
        return self._scale

    def _fit_scale(self) -> None:
        """Show the whole clip once its length or the panel's width changes."""
        wanted = (self._timeline.clip.length, self.rows.width())
        if wanted != self._fitted_to:
            self._fitted_to = wanted
            self._scale = Scale.of(wanted[0], wanted[1] - LABELS)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Show the whole clip."""
        super().resizeEvent(event)
        self._fit_scale()

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Zoom about the mouse; with Shift, or sideways, scroll."""
        delta = event.angleDelta()
        sideways = delta.x() or (
            delta.y() if event.modifiers() & Qt.KeyboardModifier.ShiftModifier else 0
        )
        if sideways:
            self._scale = self._scale.scrolled(-sideways, self._timeline.clip.length)
        else:
            x = event.position().x() - self.ruler.x() - LABELS
            self._scale = self._scale.zoomed(_ZOOM ** (delta.y() / _NOTCH), x)
        self.ruler.update()
        self.rows.update()
        event.accept()

    # What is shown.

    def model_changed(self) -> None:
        """Another model is open."""
        self.refresh()

    def refresh(self) -> None:
        """Show the keys, the playhead and the progress."""
        timeline, clip = self._timeline, self._timeline.clip
        self._fit_scale()
        self.onion.refresh()
        for box, value in ((self.frame, timeline.frame), (self.length, clip.length)):
            if box.value() != value:
                with QSignalBlocker(box):
                    box.setValue(value)
        with QSignalBlocker(self.smoothness):
            self.smoothness.setValue(clip.smoothness)
        self.rate.setCurrentIndex(RATES.index(clip.fps))
        for check, on in ((self.loop, timeline.loop), (self.auto, timeline.auto_key)):
            with QSignalBlocker(check):
                check.setChecked(on)
        self.play.setText("■" if timeline.playing else "▶")
        progress = timeline.progress
        self.progress.setVisible(progress is not None)
        self.cancel.setVisible(progress is not None)
        if progress is not None:
            done, total = progress
            # Hundreds of frames are fitted together and counted when all of them are done.
            self.progress.setFormat("Fitting %v of %m" if done else "Fitting …")
            self.progress.setRange(0, total)
            self.progress.setValue(done)
        self.rows.updateGeometry()
        self._show_selected()
        self.ruler.update()
        self.rows.update()

    def _show_selected(self) -> None:
        """Scroll to the handles that have been selected since the last time."""
        selected = self._editor.handles.selected
        if selected != self._seen:
            for owner in sorted(selected - self._seen or selected, reverse=True):
                y = self.rows.middle(owner)
                if y is not None:
                    self._area.ensureVisible(0, round(y), 0, 16)
        self._seen = selected


def _narrow(row: QHBoxLayout) -> QScrollArea:
    """A row in an area that scrolls sideways where it is wider than the window."""
    body, area = QWidget(), QScrollArea()
    row.setContentsMargins(0, 0, 0, 0)
    body.setLayout(row)
    area.setWidgetResizable(True)
    area.setFrameShape(QScrollArea.Shape.NoFrame)
    area.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    area.setWidget(body)
    area.setFixedHeight(body.sizeHint().height() + 2)
    return area
