"""The page without a model: shipped models, recent work, training, and where to drop files."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QIcon, QPixmap
from PySide6.QtWidgets import (
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from deformer_app.viewer.actions import Shell
from deformer_app.viewer.qt.icons import put_icon
from deformer_app.viewer.settings import Settings
from deformer_app.viewer.thumbnails import shipped_pictures

_PICTURE = QSize(176, 132)  # pixels
_COLUMNS = 4
_WIDTH = 840  # pixels of the page's column


class StartPage(QScrollArea):
    """What the window shows without a model.

    Args:
        shell: the window, which opens what the user chooses.
        settings: know the recent files.
    """

    def __init__(self, shell: Shell, settings: Settings) -> None:
        """Lay out; `refresh` fills in the recent files."""
        super().__init__()
        self._shell, self._settings = shell, settings
        self.setWidgetResizable(True)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        page = QWidget()
        across = QHBoxLayout(page)
        self._column = column = QVBoxLayout()
        across.addStretch(1)
        across.addLayout(column)
        across.addStretch(1)
        column.setContentsMargins(24, 28, 24, 28)
        column.setSpacing(10)
        column.addWidget(_label("Deformer", "title"))
        about = "Drag a few points of a mesh; what was learned from examples moves the rest."
        column.addWidget(_label(about, "second"))
        column.addSpacing(10)
        column.addLayout(self._buttons())
        column.addSpacing(14)
        column.addWidget(_label("Models", "heading"))
        self.models = self._shipped()
        column.addLayout(_grid(self.models))
        column.addSpacing(14)
        self._heading = _label("Recent", "heading")
        column.addWidget(self._heading)
        self._recent = QWidget()
        self.recent: list[QToolButton] = []
        column.addWidget(self._recent)
        column.addStretch(1)
        drop = "Or drop here: a model's folder, a session, or shapes to train on."
        column.addWidget(_label(drop, "second"))
        page.setMinimumWidth(_WIDTH)
        self.setWidget(page)

    def _buttons(self) -> QHBoxLayout:
        row = QHBoxLayout()
        row.setSpacing(8)
        for title, name, key, action in (
            ("Train on my shapes…", "graduation-cap", "Ctrl+T", "train"),
            ("Open a model…", "folder-open", "Ctrl+O", "open-model"),
            ("Open a session…", "file-clock", "Ctrl+Shift+O", "open-session"),
        ):
            button = QPushButton(f"\u2009{title}")  # a thin space between icon and text
            button.setToolTip(f"{title.rstrip('…')}  {key}")
            button.setAutoDefault(False)
            put_icon(button, name)
            button.clicked.connect(lambda _, a=action: self._shell.act(a))
            row.addWidget(button)
        row.addStretch(1)
        return row

    def _shipped(self) -> list[QToolButton]:
        cards = []
        for name, data in shipped_pictures().items():
            picture = QPixmap()
            if data is not None:
                picture.loadFromData(data)
            tip = f"Open the shipped model {name}"
            cards.append(_card(name, picture, tip, lambda n=name: self._shell.open_model(n)))
        return cards

    def refresh(self) -> None:
        """Show the recent models and sessions that still exist."""
        self.recent = []
        for path in self._settings.recent:
            if not Path(path).exists():
                continue
            session = path.endswith(".json")
            about = _since(Path(path).stat().st_mtime)
            model = self._settings.model_of(path)
            if session and model:
                about = f"{Path(model).name}, {about}"
            opener = self._shell.open_session if session else self._shell.open_model
            self.recent.append(
                _card(
                    f"{Path(path).name}\n{about}",
                    QPixmap(str(self._settings.thumbnail(path))),
                    path,
                    lambda p=path, f=opener: f(Path(p)),
                )
            )
        row = QWidget()
        row.setLayout(_grid(self.recent))
        self._column.replaceWidget(self._recent, row)
        self._recent.deleteLater()  # with the cards before
        self._recent = row
        self._heading.setVisible(bool(self.recent))


def _label(text: str, rank: str) -> QLabel:
    label = QLabel(text)
    label.setProperty("rank", rank)
    return label


def _card(text: str, picture: QPixmap, tip: str, run: Callable[[], Any]) -> QToolButton:
    card = QToolButton()
    card.setProperty("card", True)
    card.setText(text)
    card.setToolTip(tip)
    card.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextUnderIcon)
    card.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    card.setIconSize(_PICTURE)
    card.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)
    if picture.isNull():
        put_icon(card, "cuboid")
    else:
        card.setIcon(QIcon(picture))
    card.clicked.connect(lambda _: run())
    return card


def _grid(cards: Iterable[QWidget]) -> QGridLayout:
    grid = QGridLayout()
    grid.setContentsMargins(0, 0, 0, 0)
    grid.setSpacing(12)
    for n, card in enumerate(cards):
        grid.addWidget(card, n // _COLUMNS, n % _COLUMNS)
    grid.setColumnStretch(_COLUMNS, 1)
    return grid


def _since(then: float) -> str:
    """Return how long ago a time was, in words."""
    minutes = max(time.time() - then, 0.0) / 60
    for unit, length in (("day", 1440.0), ("hour", 60.0), ("minute", 1.0)):
        count = int(minutes / length)
        if count:
            return f"{count} {unit}{'s' if count > 1 else ''} ago"
    return "just now"


def when(then: float) -> str:
    """Return a time, in seconds since 1970, as how long ago it was and the time of day."""
    return f"{_since(then)}, {time.strftime('%d %b %Y %H:%M', time.localtime(then))}"
