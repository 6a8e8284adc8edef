"""The choice of the axis that points up, with a picture of the first shape that stands so."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QHideEvent, QPixmap, QShowEvent
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from deformer import InputError, Mesh, load_document
from deformer_app.mistakes import mistake
from deformer_app.rendering.camera import aim
from deformer_app.rendering.palette import Theme
from deformer_app.viewer.qt.pixmaps import pixmap_of
from deformer_app.viewer.shape_drawing import SUPERSAMPLING, ShapeDrawing, hidden_plotter
from deformer_app.viewer.up_axis import first_shape, up_axis_of
from deformer_app.viewer.worker import Jobs, in_background

_SIDE = 132  # pixels of the picture
_POLL = 30  # milliseconds between two looks whether a shape is loaded
_BEFORE = "A picture shows how the shapes will stand."
_ABOUT = "The first shape. If it does not stand, choose another axis."


class UpAxisField(QWidget):
    """A list of axes; the first entry leaves the choice to what the shapes tell.

    Args:
        theme: gives the colours of the picture.

    Attributes:
        axis: the list.
        picture: the first shape, upright along the axis.
    """

    def __init__(self, theme: Callable[[], Theme]) -> None:
        """Lay out, without a picture."""
        super().__init__()
        self._theme = theme
        self._source: Path | None = None
        self._without = _BEFORE  # text without a picture
        self._mesh: Mesh | None = None
        self._drawing: ShapeDrawing | None = None
        self._jobs = Jobs()
        self.axis, self.picture = QComboBox(), QLabel()
        self.axis.addItem("as the shapes stand", None)
        for name in ("y", "z", "x", "-x", "-y", "-z"):
            self.axis.addItem(name, name)
        self._about = QLabel(_BEFORE)
        self._about.setWordWrap(True)
        self._about.setTextFormat(Qt.TextFormat.PlainText)
        self.picture.setFixedSize(_SIDE, _SIDE)
        self.picture.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.picture.setFrameShape(QLabel.Shape.StyledPanel)
        column = QVBoxLayout()
        column.addWidget(self.axis)
        column.addWidget(self._about)
        column.addStretch(1)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addLayout(column, 1)
        row.addWidget(self.picture)
        self.axis.currentIndexChanged.connect(lambda _: self._draw())
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._step)

    @property
    def chosen(self) -> str | None:
        """The axis as of `deformer.train`; None while nobody has chosen and nothing is known."""
        return self.axis.currentData()

    @property
    def looking(self) -> bool:
        """True while the first shape is being loaded."""
        return bool(self._jobs)

    def look_at(self, source: Path) -> None:
        """Load the first shape of a path in the background, and choose its most likely axis."""
        if source == self._source:
            return
        self._source, self._mesh, self._without = source, None, _BEFORE
        self.axis.setCurrentIndex(0)
        self._draw()
        self._jobs.add(self._load(source))
        self._timer.start(_POLL)

    def showEvent(self, event: QShowEvent) -> None:
        """Draw what was chosen while the field was hidden."""
        super().showEvent(event)
        self._draw()

    def hideEvent(self, event: QHideEvent) -> None:
        """Free what draws the picture, which stays; it is made again for the next one."""
        self._close_drawing()
        super().hideEvent(event)

    def _close_drawing(self) -> None:
        if self._drawing is not None:
            self._drawing.close()
            self._drawing = None

    def _step(self) -> None:
        self._jobs.step()
        if not self._jobs:
            self._timer.stop()

    def _load(self, source: Path) -> Iterator[None]:
        def load() -> tuple[Mesh, str]:
            mesh = first_shape(source)
            return mesh, up_axis_of(mesh, load_document(source))

        try:
            mesh, up = yield from in_background(load)
        except (InputError, OSError) as error:
            if source == self._source:
                reason = mistake(error).removeprefix(f"{source}: ")  # the path is in its field
                self._without = reason[:1].upper() + reason[1:]
                self._source = None  # to be looked at again: it may be mended
                self._draw()
            return
        if source != self._source:
            return
        self._mesh = mesh
        if self.chosen is None:
            self.axis.setCurrentIndex(self.axis.findData(up))
        else:
            self._draw()

    def _draw(self) -> None:
        mesh, up = self._mesh, self.chosen
        if mesh is None or up is None:
            self.picture.setPixmap(QPixmap())
            self._about.setText(self._without)
            return
        if not self.isVisible():
            return  # drawn once it is shown: nobody would free what draws it
        density = self.devicePixelRatioF()
        if self._drawing is None:
            side = SUPERSAMPLING * round(density * (_SIDE - 4))
            self._drawing = ShapeDrawing(hidden_plotter((side, side)))
        camera = aim(mesh.vertices, up=up, azimuth=25, elevation=8, margin=0.06)
        drawn = self._drawing.picture(mesh, mesh.vertices, camera, self._theme())
        self.picture.setPixmap(pixmap_of(drawn, density))
        self._about.setText(_ABOUT)
