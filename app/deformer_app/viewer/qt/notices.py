"""Lines of text with buttons: messages over the picture, and the tour below it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QPushButton, QVBoxLayout, QWidget

from deformer_app.rendering.palette import NOTICE, NOTICE_INK

_PREPARING = (
    "Preparing the solver. The first time after an installation this takes some ten seconds. "
    "You can look around already."
)


class Strip(QWidget):
    """A coloured line of text with buttons, hidden at first.

    Args:
        kind: names its colour, see `NOTICE`.
        buttons: title of each button, and what it does.
    """

    def __init__(self, kind: str, *buttons: tuple[str, Callable[[], Any]]) -> None:
        """Lay out."""
        super().__init__()
        self._label = QLabel()
        self._label.setWordWrap(True)
        # A subclass of QWidget paints its style sheet's background only with this attribute.
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self.setStyleSheet(f"background: {NOTICE[kind]}; color: {NOTICE_INK};")
        self.row = QHBoxLayout(self)
        self.row.addWidget(self._label, 1)
        for title, run in buttons:
            button = QPushButton(title)
            button.clicked.connect(lambda _, f=run: f())
            self.row.addWidget(button)
        self.hide()

    @property
    def text(self) -> str:
        """The text of the line."""
        return self._label.text()

    def say(self, text: str) -> None:
        """Change the text of the line."""
        self._label.setText(text)


class Notices(QWidget):
    """The strips that lie upon the top of the picture.

    If the picture gave way to them, what is being dragged would jump.

    Args:
        picture: what they lie upon; a sibling.
        stop_recording: what the button of the recording does.
    """

    def __init__(self, picture: QWidget, stop_recording: Callable[[], Any]) -> None:
        """Lay out; nothing is shown."""
        super().__init__(picture.parentWidget())
        self._picture = picture
        self.mistake = Strip("mistake", ("Close", self.hide_mistake))
        self.recording = Strip("recording", ("Stop", stop_recording))
        self.recording.say("<b>●</b>&nbsp; Recording what the picture shows")
        self.preparing = Strip("waiting")
        self.preparing.say(_PREPARING)
        bar = QProgressBar()
        bar.setRange(0, 0)
        bar.setFixedSize(120, 8)
        self.preparing.row.addWidget(bar)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        for strip in self._strips:
            column.addWidget(strip)
        self.hide()
        picture.installEventFilter(self)

    @property
    def _strips(self) -> tuple[Strip, ...]:
        return self.mistake, self.recording, self.preparing

    def show_mistake(self, text: str) -> None:
        """Tell the user of a mistake, until it is closed."""
        self.mistake.say(text)
        self.show_strip(self.mistake)

    def hide_mistake(self) -> None:
        """Hide the message of a mistake."""
        self.show_strip(self.mistake, False)

    def show_strip(self, strip: Strip, shown: bool = True) -> None:
        """Show or hide one of the strips."""
        strip.setVisible(shown)
        self._arrange()

    def _arrange(self) -> None:
        layout, frame = cast(QVBoxLayout, self.layout()), self._picture.geometry()
        self.setVisible(any(not strip.isHidden() for strip in self._strips))
        layout.activate()
        height = layout.totalHeightForWidth(frame.width())
        self.setGeometry(frame.x(), frame.y(), frame.width(), max(height, 1))
        self.raise_()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Keep the strips as wide as the picture."""
        if watched is self._picture and event.type() == QEvent.Type.Resize:
            self._arrange()
        return super().eventFilter(watched, event)
