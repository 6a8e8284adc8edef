"""The dock of the components: a slider for each."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtWidgets import (
    QGridLayout,
    QLabel,
    QProgressBar,
    QScrollArea,
    QToolButton,
    QWidget,
)

from deformer import Activations
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.model_files import start_codes
from deformer_app.viewer.qt.slider import STEPS, Slider


class ComponentPanel(QScrollArea):
    """A slider for every component, the strongest first; its support shows on hover."""

    def __init__(self, editor: Editor) -> None:
        """Start empty; the components follow once they are measured."""
        super().__init__()
        self._editor = editor
        self._rows: dict[int, tuple[Slider, QLabel]] = {}
        self._names: dict[int, QToolButton] = {}
        self._shown: Activations | None = None
        self.setWidgetResizable(True)
        self.setWidget(_waiting())

    @property
    def sliders(self) -> dict[int, Slider]:
        """Slider of each component, in the order in which they are shown."""
        return {k: slider for k, (slider, _) in self._rows.items()}

    def model_changed(self) -> None:
        """Another model is open."""
        self._rows, self._names, self._shown = {}, {}, None
        self.setWidget(_waiting())

    def _fill(self) -> None:
        known = self._editor.activations
        if known is None or known is self._shown:
            return
        self._shown = known
        body = QWidget()
        grid = QGridLayout(body)
        grid.setVerticalSpacing(2)
        strongest = float(known.strength.max()) or 1.0
        for n, k in enumerate(known.order.tolist()):
            bar = QProgressBar()
            bar.setTextVisible(False)
            bar.setFixedSize(36, 6)
            bar.setValue(round(100 * float(known.strength[k]) / strongest))
            bar.setToolTip("Strength: how far its extreme among the examples changes the reference")
            slider = Slider(
                lambda position, k=k: self._slide(k, position),
                lambda k=k: self._editor.commit(self._title(k)),
            )
            slider.setProperty("component", k)
            slider.installEventFilter(self)
            value, reset = QLabel("0"), QToolButton()
            value.setFixedWidth(44)
            reset.setText("↺")
            reset.setToolTip("Back to the reference's value")
            reset.clicked.connect(lambda _, k=k: self._reset(k))
            model = self._editor.model
            name = QToolButton()
            name.setText(model.component_names.get(k, str(k)))
            name.setToolTip(f"{model.label(k).capitalize()}: click to keep it coloured")
            name.setAutoRaise(True)
            name.setCheckable(True)
            name.setMaximumWidth(96)
            name.clicked.connect(lambda on, k=k: self._colour(k, on))
            self._names[k] = name
            for widget in (name, bar):
                widget.setProperty("component", k)
                widget.installEventFilter(self)
            for column, widget in enumerate((name, bar, slider, value, reset)):
                grid.addWidget(widget, n, column)
            self._rows[k] = slider, value
        grid.setRowStretch(len(self._rows), 1)
        self.setWidget(body)

    def _colour(self, k: int, on: bool) -> None:
        self._editor.change_look(colour=f"component:{k}" if on else "plain")

    def _title(self, k: int) -> str:
        label = self._editor.model.label(k)
        return label[0].upper() + label[1:]

    def _limits(self, k: int) -> tuple[float, float]:
        assert self._shown is not None
        low, high = float(self._shown.low[k]), float(self._shown.high[k])
        return low, max(high, low + 1e-9)

    def _slide(self, k: int, position: int) -> None:
        low, high = self._limits(k)
        self._editor.slide(k, low + (high - low) * position / STEPS)

    def _reset(self, k: int) -> None:
        self._editor.slide(k, float(start_codes(self._editor.model)["Reference"][k]))
        self._editor.commit(f"Reset {self._editor.model.label(k)}")

    def refresh(self) -> None:
        """Show the current code."""
        self._fill()
        code = self._editor.code
        for k, (slider, value) in self._rows.items():
            low, high = self._limits(k)
            slider.show_position(STEPS * (float(code[k]) - low) / (high - low))
            value.setText(f"{code[k]:z.2f}")
            self._names[k].setChecked(self._editor.state.look.colour == f"component:{k}")

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Show a component's support while the mouse is over its row."""
        component = watched.property("component")
        if component is not None and event.type() == QEvent.Type.Enter:
            self._editor.preview(int(component))
        elif component is not None and event.type() == QEvent.Type.Leave:
            self._editor.preview(None)
        return super().eventFilter(watched, event)


def _waiting() -> QLabel:
    label = QLabel("Measuring the components …")
    label.setAlignment(Qt.AlignmentFlag.AlignCenter)
    return label
