"""The dock of the components: a row for each, by region or by strength."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from deformer import Activations
from deformer_app.viewer.component_scale import ComponentScale
from deformer_app.viewer.qt.component_row import ComponentRow
from deformer_app.viewer.qt.component_slider import ComponentSlider
from deformer_app.viewer.qt.elided_label import ElidedLabel
from deformer_app.viewer.qt.surroundings import Surroundings
from deformer_app.viewer.qt.vertical_scroll import VerticalScroll
from deformer_app.viewer.region_names import region_names
from deformer_app.viewer.shape_thumbnails import Subject

_AT_ONCE = 4  # rows that are made in one step
_ORDERS = {"region": "By region", "strength": "By strength"}


class ComponentPanel(QWidget):
    """A row for every component: favourites first, then by region or by strength.

    Args:
        of: parts of the window that the panel uses.

    Attributes:
        search: field that filters the rows by name, number or region.
        order: choice of the order, "region" or "strength".
        rows: component → row, once they are made.
        sections: groups of the rows, in the order in which they are shown.
    """

    def __init__(self, of: Surroundings) -> None:
        """Start empty; the components follow once they are measured."""
        super().__init__()
        self._of, self._editor, self._settings = of, of.editor, of.settings
        self.rows: dict[int, ComponentRow] = {}
        self.sections: list[_Section] = []
        self._shown: Activations | None = None
        self._names: dict[int, str] = {}
        self.search = QLineEdit()
        self.search.setPlaceholderText("Search by name or region")
        self.search.setClearButtonEnabled(True)
        self.search.textChanged.connect(self._filter)
        self.order = QComboBox()
        for key, title in _ORDERS.items():
            self.order.addItem(title, key)
        self.order.setCurrentIndex(max(self.order.findData(of.settings.component_order), 0))
        self.order.activated.connect(self._reorder)
        self._none = ElidedLabel()  # what is searched for may be long
        self._none.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._none.setContentsMargins(8, 8, 8, 8)
        self._none.hide()
        self._area = VerticalScroll()
        self._area.verticalScrollBar().valueChanged.connect(self._refresh_seen)
        head = QHBoxLayout()
        head.setContentsMargins(4, 4, 4, 0)
        head.addWidget(self.search, 1)
        head.addWidget(self.order)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(4)
        column.addLayout(head)
        column.addWidget(self._none)
        column.addWidget(self._area, 1)
        of.thumbnails.on_drawn.append(self._show_pictures)
        self._wait()

    @property
    def sliders(self) -> dict[int, ComponentSlider]:
        """Slider of each component, in the order in which they are shown."""
        return {row.component: row.slider for section in self.sections for row in section.rows}

    @property
    def favourites(self) -> list[int]:
        """Favourite components of the model, in the order of choosing."""
        editor = self._editor
        stored = self._settings.favourites(editor.model.fingerprint)
        return [k for k in stored if k < editor.model.components]

    def model_changed(self) -> None:
        """Another model is open."""
        self._shown = None
        self.rows, self.sections = {}, []
        self._filter()
        self._wait()

    def _wait(self) -> None:
        label = QLabel("Measuring the components …")
        label.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._area.setWidget(label)

    def _fill(self) -> None:
        """Have the rows made, once the components are measured."""
        known = self._editor.activations
        if known is not None and known is not self._shown:
            self._shown = known
            self._editor.run(self._make_rows(known))

    def _make_rows(self, known: Activations) -> Iterator[None]:
        """Make the rows, a few in each step, so that the window stays responsive."""
        editor, rows = self._editor, {}
        strongest = float(known.strength.max()) or 1.0
        for n, k in enumerate(known.order.tolist()):
            rows[k] = ComponentRow(
                editor,
                self._of.thumbnails,
                k,
                ComponentScale.of(known, k),
                float(known.strength[k]) / strongest,
                lambda on, k=k: self._set_favourite(k, on),
                self._of.attempt,
            )
            if n % _AT_ONCE == 0:
                yield
            if self._shown is not known:
                return  # another model is open
        self.rows = rows
        self._names = dict(editor.model.component_names)
        self._arrange()

    def _arrange(self) -> None:
        """Put the rows into sections."""
        favourites = self.favourites
        for k, row in self.rows.items():
            row.setParent(None)
            row.star.setChecked(k in favourites)
        folded = {section.title for section in self.sections if section.folded}
        self.sections = []
        body = QWidget()
        column = QVBoxLayout(body)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        for title, components in self._groups(favourites):
            section = _Section(title, [self.rows[k] for k in components])
            section.fold(title in folded)
            self.sections.append(section)
            column.addWidget(section)
        column.addStretch(1)
        self._area.setWidget(body)
        self._filter()
        self.refresh()

    def _groups(self, favourites: list[int]) -> Iterable[tuple[str, list[int]]]:
        """Titles and components of the sections; a component is in one of them."""
        editor = self._editor
        if favourites:
            yield "Favourites", favourites
        others = [k for k in self.rows if k not in favourites]
        if self.order.currentData() == "strength":
            yield "All" if not favourites else "Others", others
            return
        regions = editor.regions
        names = region_names(
            [region.centre for region in regions],
            editor.model.reference.vertices,
            editor.state.viewpoint.up,
        )
        for name, region in zip(names, regions, strict=True):
            inside = [k for k in region.components if k not in favourites]
            if inside:
                yield name, inside

    def _reorder(self) -> None:
        self._settings.note_component_order(self.order.currentData())
        if self._shown is not None:
            self._arrange()

    def _set_favourite(self, component: int, on: bool) -> None:
        favourites = [k for k in self.favourites if k != component] + [component] * on
        self._settings.note_favourites(self._editor.model.fingerprint, favourites)
        self._arrange()

    def _filter(self) -> None:
        words = self.search.text().lower().split()
        found = [section.show_matching(words) for section in self.sections]
        self._none.setText(f"No component matches “{self.search.text().strip()}”.")
        self._none.setVisible(bool(found) and not any(found))

    def refresh(self) -> None:
        """Show the current code and names."""
        self._fill()
        names = self._editor.model.component_names
        if names != self._names:
            self._names = dict(names)
            for row in self.rows.values():
                row.show_name()
            self._filter()
        self._refresh_seen()

    def _refresh_seen(self) -> None:
        for row in self.rows.values():
            if not row.visibleRegion().isEmpty():
                row.refresh()

    def _show_pictures(self, subject: Subject) -> None:
        if subject.component is not None and subject.component in self.rows:
            for picture in self.rows[subject.component].extremes:
                picture.update()


class _Section(QWidget):
    """Rows under a header that folds them away."""

    def __init__(self, title: str, rows: list[ComponentRow]) -> None:
        super().__init__()
        self.title, self.rows = title, rows
        self._header = QToolButton()
        self._header.setCheckable(True)
        self._header.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        self._header.setAutoRaise(True)
        self._header.clicked.connect(self.fold)
        self._body = QWidget()
        inner = QVBoxLayout(self._body)
        inner.setContentsMargins(0, 0, 0, 4)
        inner.setSpacing(0)
        for row in rows:
            inner.addWidget(row)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self._header)
        column.addWidget(self._body)
        self.fold(False)

    @property
    def header(self) -> QToolButton:
        """The button that folds the rows away."""
        return self._header

    @property
    def folded(self) -> bool:
        """True while the rows are folded away."""
        return self._header.isChecked()

    def fold(self, folded: bool) -> None:
        """Fold the rows away, or show them."""
        self._header.setChecked(folded)
        arrow = Qt.ArrowType.RightArrow if folded else Qt.ArrowType.DownArrow
        self._header.setArrowType(arrow)
        self._body.setVisible(not folded)

    def show_matching(self, words: list[str]) -> int:
        """Show the rows whose name, number or region has all of some words (lower case).

        Returns:
            Number of these rows.
        """
        shown = 0
        for row in self.rows:
            text = f"{row.name.text()} component {row.component} {self.title}".lower()
            matches = all(word in text for word in words)
            row.setVisible(matches)
            shown += matches
        self._header.setText(f"{self.title} ({shown})")
        self.setVisible(shown > 0)
        if words:
            self._body.setVisible(shown > 0)
        else:
            self.fold(self.folded)
        return shown
