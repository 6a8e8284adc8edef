"""The row of one component: its name, slider, number, and pictures of both extremes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from PySide6.QtCore import QEvent, QSize, Qt
from PySide6.QtGui import QKeyEvent, QMouseEvent, QPainter, QPaintEvent
from PySide6.QtWidgets import (
    QGridLayout,
    QHBoxLayout,
    QProgressBar,
    QToolButton,
    QWidget,
)

from deformer_app.rendering.offscreen import Picture
from deformer_app.viewer.component_names import component_title, rename_component
from deformer_app.viewer.component_scale import ComponentScale
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.component_slider import ComponentSlider
from deformer_app.viewer.qt.editable_label import EditableLabel
from deformer_app.viewer.qt.number_field import NumberField
from deformer_app.viewer.qt.pixmaps import pixmap_of
from deformer_app.viewer.shape_thumbnails import Subject, Thumbnails

_PICTURE = 44  # pixels
_NOTHING = np.zeros((1, 1, 4), dtype=np.uint8)


class ComponentRow(QWidget):
    """Everything about one component; its support shows while the mouse is over it.

    Args:
        editor: the model and its pose.
        thumbnails: pictures of the extremes.
        component: index k.
        scale: of the component.
        strength: share of the strongest component's, 0 to 1.
        favourite: called with True when the user makes the row a favourite, else with False.
        attempt: runs a function and shows the user's mistakes.

    Attributes:
        component: index k.
        name: its name; editable after a double click or F2.
        slider: of its weight.
        value: its weight as a number.
        star: button that keeps the row at the top.
        extremes: pictures of the shapes at both ends of the examples.
    """

    def __init__(
        self,
        editor: Editor,
        thumbnails: Thumbnails,
        component: int,
        scale: ComponentScale,
        strength: float,
        favourite: Callable[[bool], Any],
        attempt: Callable[[Callable[[], Any]], Any],
    ) -> None:
        """Lay out; `refresh` fills it."""
        super().__init__()
        self._editor, self._attempt = editor, attempt
        self.component, self.scale = component, scale
        self._asked = 0.0
        self.name = EditableLabel(
            lambda text: attempt(lambda: rename_component(editor, component, text))
        )
        self.star = _button("☆", "Favourite: keep it at the top", checkable=True)
        self.star.toggled.connect(lambda on: self.star.setText("★" if on else "☆"))
        self.star.clicked.connect(favourite)
        self._colour = _button("◐", "Keep coloured where it acts", checkable=True)
        self._colour.clicked.connect(
            lambda on: editor.picture.change_look(
                colour=f"component:{component}" if on else "plain"
            )
        )
        bar = QProgressBar()
        bar.setTextVisible(False)
        bar.setFixedSize(30, 5)
        bar.setValue(round(100 * strength))
        bar.setToolTip("Strength: how far its extreme among the examples changes the reference")
        self.slider = ComponentSlider(scale, self._slide, self._commit)
        self.slider.setToolTip("0 is the reference; double click goes there")
        self.value = _Number()
        self.value.setToolTip("0 is the reference, 1 the extreme among the examples")
        self.value.valueChanged.connect(self._slide)
        self.value.settled.connect(lambda: self._commit())
        reset = _button("↺", "Back to the reference's value")
        reset.clicked.connect(self.reset)
        self.extremes = tuple(
            _Extreme(self._pictures, n, lambda w=weight: self._go_to(w))
            for n, weight in enumerate((scale.low, scale.high))
        )
        top = QHBoxLayout()
        top.setSpacing(2)
        for widget in (self.star, self.name, bar, self._colour, self.value, reset):
            top.addWidget(widget, 1 if widget is self.name else 0)
        grid = QGridLayout(self)
        grid.setContentsMargins(4, 2, 4, 4)
        grid.setVerticalSpacing(1)
        grid.addLayout(top, 0, 0, 1, 3)
        grid.addWidget(self.extremes[0], 1, 0)
        grid.addWidget(self.slider, 1, 1)
        grid.addWidget(self.extremes[1], 1, 2)
        grid.setColumnStretch(1, 1)
        QWidget.setTabOrder(self.slider, self.value)
        self._subject = Subject(self._codes(), component)
        self._thumbnails = thumbnails
        self.show_name()

    @property
    def subject(self) -> Subject:
        """What the pictures show."""
        return self._subject

    def show_name(self) -> None:
        """Show the name that the model has for the component."""
        model, k = self._editor.model, self.component
        shown = component_title(model, k)
        self.name.show_text(shown, model.component_names.get(k, ""), f"component {k}")
        self.name.setToolTip(f"{shown}: double click or F2 to rename")

    def refresh(self) -> None:
        """Show the weight in the present pose."""
        editor, k = self._editor, self.component
        weight = self.scale.weight(float(editor.code[k]))
        self.slider.show_weight(weight, self.scale.weight(float(editor.edit.base[k])))
        if not self.value.being_typed:
            self.value.show_value(weight)
        self._colour.setChecked(editor.state.look.colour == f"component:{k}")

    def reset(self) -> None:
        """Go back to the reference's value."""
        self._slide(0.0)
        self._commit(f"Reset {self._editor.model.label(self.component)}")

    def _slide(self, weight: float) -> None:
        self._asked = weight
        self._editor.prior.slide(self.component, self.scale.activation(weight))

    def _commit(self, label: str = "") -> None:
        """Make the slide a step, and say how far it came if handles pull the pose elsewhere."""
        editor, k = self._editor, self.component
        editor.commit(label or component_title(editor.model, k))
        editor.prior.tell_of_pull(k, self.scale, self._asked)

    def _go_to(self, weight: float) -> None:
        self._slide(weight)
        self._commit()

    def _codes(self) -> tuple[tuple[float, ...], ...]:
        """Codes of the reference with this component at both ends of the examples."""
        known = self._editor.activations
        assert known is not None
        codes = []
        for weight in (self.scale.low, self.scale.high):
            code = known.reference.tolist()
            code[self.component] = self.scale.activation(weight)
            codes.append(tuple(code))
        return tuple(codes)

    def _pictures(self) -> tuple[Picture, ...] | None:
        return self._thumbnails.pictures(self._subject)

    def enterEvent(self, event: QEvent) -> None:
        """Show the component's support while the mouse is over its row."""
        self._editor.picture.preview(self.component)

    def leaveEvent(self, event: QEvent) -> None:
        """Show the colours of before."""
        self._editor.picture.preview(None)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Rename with F2."""
        if event.key() == Qt.Key.Key_F2:
            self.name.begin()
        else:
            super().keyPressEvent(event)


class _Number(NumberField):
    """A weight that can be typed."""

    def __init__(self) -> None:
        super().__init__(-100.0, 100.0, 2)
        self.setSingleStep(0.05)
        self.setProperty("bare", True)  # no arrows
        self.setFixedWidth(58)
        self.setAlignment(Qt.AlignmentFlag.AlignRight)


class _Extreme(QWidget):
    """The picture of a component's extreme; a click goes there."""

    def __init__(
        self,
        pictures: Callable[[], tuple[Picture, ...] | None],
        number: int,
        clicked: Callable[[], Any],
    ) -> None:
        super().__init__()
        self._pictures, self._number, self._clicked = pictures, number, clicked
        self._shown: Picture | None = None
        self._pixmap = pixmap_of(_NOTHING)
        self.setFixedSize(QSize(_PICTURE, _PICTURE))
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.setToolTip(("Smallest", "Largest")[number] + " among the examples: click to go there")

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the picture, which is asked for when it is first seen."""
        found = self._pictures()
        if found is None:
            return
        if found[self._number] is not self._shown:
            self._shown = found[self._number]
            self._pixmap = pixmap_of(self._shown)
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawPixmap(self.rect(), self._pixmap)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Go to the extreme."""
        if event.button() == Qt.MouseButton.LeftButton:
            self._clicked()


def _button(text: str, about: str, checkable: bool = False) -> QToolButton:
    button = QToolButton()
    button.setText(text)
    button.setToolTip(about)
    button.setAutoRaise(True)
    button.setCheckable(checkable)
    button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    button.setProperty("narrow", True)
    button.setFixedSize(22, 22)
    return button
