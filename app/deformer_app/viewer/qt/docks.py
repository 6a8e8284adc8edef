"""The docks: panels around the picture, listed in one table."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, Protocol, TypeVar, cast

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QDockWidget, QMainWindow, QWidget

from deformer_app.viewer.qt.component_panel import ComponentPanel
from deformer_app.viewer.qt.handle_panel import HandlePanel
from deformer_app.viewer.qt.model_panel import ModelPanel
from deformer_app.viewer.qt.picture_panel import PicturePanel
from deformer_app.viewer.qt.pose_strip import PoseStrip
from deformer_app.viewer.qt.surroundings import Surroundings
from deformer_app.viewer.qt.timeline_panel import TimelinePanel
from deformer_app.viewer.qt.vertical_scroll import VerticalScroll

_AREAS = {
    "left": Qt.DockWidgetArea.LeftDockWidgetArea,
    "right": Qt.DockWidgetArea.RightDockWidgetArea,
    "bottom": Qt.DockWidgetArea.BottomDockWidgetArea,
}
_P = TypeVar("_P", bound=QWidget)


class Panel(Protocol):
    """What a dock's widget does beside being a widget."""

    def model_changed(self) -> None:
        """Prepare for another model, which is open now."""
        ...

    def refresh(self) -> None:
        """Show the editor's current state; called soon after every change, with a model open."""
        ...


@dataclass(frozen=True)
class Dock:
    """One dock.

    Args:
        title: of the dock, and its name in the stored layout.
        panel: makes its widget, a `Panel`, from the parts of the window that it uses.
        area: side of the picture at first.
        size: width (of docks at the left and right) and height at first, in pixels; a dock is
            wider where its panel needs more.
        shown: False for a dock that the user opens from the menu View.
        scrolls: True for a panel that scrolls by itself.
    """

    title: str
    panel: Callable[[Surroundings], QWidget]
    area: Literal["left", "right", "bottom"]
    size: tuple[int, int]
    shown: bool = True
    scrolls: bool = False


_BELOW = 236  # height at first of the docks below the picture: five rows of keys and that of all

# In this order from the top of each side. A new dock is one line here.
DOCKS = (
    Dock("Model", lambda of: ModelPanel(of.editor), "left", (250, 400)),
    Dock("Handles", lambda of: HandlePanel(of.editor), "right", (310, 330)),
    Dock("Components", ComponentPanel, "right", (310, 370), scrolls=True),
    Dock("Reference", lambda of: PicturePanel(of.editor), "left", (250, 260), shown=False),
    Dock("Poses", PoseStrip, "bottom", (900, _BELOW), scrolls=True),
    Dock("Timeline", TimelinePanel, "bottom", (900, _BELOW), shown=False, scrolls=True),
)


class Docks:
    """The docks of a window; their contents scroll where they do not fit.

    Args:
        window: gets the docks.
        of: parts of the window that the panels use.
        picture: gets the focus from a dock that another one covers.
    """

    def __init__(self, window: QMainWindow, of: Surroundings, picture: QWidget) -> None:
        """Add all of `DOCKS`."""
        self._window, self._picture = window, picture
        self._docks: list[QDockWidget] = []
        self._timeline = of.editor.timeline
        self._reference = of.editor.state.reference_picture
        self._had_keys = self._played = False
        self._footage = self._reference.footage
        self._put_away = False  # the dock of the reference picture, until there is one
        self._panels: list[QWidget] = []
        # The long list of components has the height of the window.
        window.setCorner(Qt.Corner.BottomRightCorner, _AREAS["right"])
        for entry in DOCKS:
            panel, dock = entry.panel(of), QDockWidget(entry.title, window)
            dock.setObjectName(entry.title)
            dock.setWidget(panel if entry.scrolls else _scrolling(panel))
            window.addDockWidget(_AREAS[entry.area], dock)
            dock.setVisible(entry.shown)
            dock.visibilityChanged.connect(lambda seen, d=dock: seen or self._leave_covered(d))
            self._docks.append(dock)
            self._panels.append(panel)
        # Docks below the picture share its width, so only one of them is seen at a time.
        below = [d for d, e in zip(self._docks, DOCKS, strict=True) if e.area == "bottom"]
        for dock, after in pairwise(below):
            window.tabifyDockWidget(dock, after)
        for way, axis in ((Qt.Orientation.Horizontal, 0), (Qt.Orientation.Vertical, 1)):
            window.resizeDocks(self._docks, [entry.size[axis] for entry in DOCKS], way)
        timeline = self._dock("Timeline")
        timeline.visibilityChanged.connect(
            lambda _: self.panel(PoseStrip).follow_timeline(not timeline.isHidden())
        )
        self._timeline.on_change.append(self._open_timeline)
        self._dock("Reference").toggleViewAction().triggered.connect(self._decided)

    @property
    def toggles(self) -> Iterator[QAction]:
        """Actions that show and hide each dock."""
        return (dock.toggleViewAction() for dock in self._docks)

    def panel(self, kind: type[_P]) -> _P:
        """Return the panel of a class."""
        return next(panel for panel in self._panels if isinstance(panel, kind))

    def _leave_covered(self, dock: QDockWidget) -> None:
        """Take the focus from a dock whose tab is not the one that is shown.

        Its keys would change what the user does not see.
        """
        focus = self._window.focusWidget()
        if dock.isVisible() and focus is not None and dock.isAncestorOf(focus):
            self._picture.setFocus()

    def _open_timeline(self) -> None:
        """Open the dock of the timeline with the first key, or when the clip plays.

        Where the dock of poses shows the playhead, it stays in front.
        """
        has_keys, playing = bool(self._timeline.clip.tracks), self._timeline.playing
        first, plays = has_keys and not self._had_keys, playing and not self._played
        self._had_keys, self._played = has_keys, playing
        seen = self.panel(PoseStrip).shows_time
        if (first and self._dock("Timeline").isHidden()) or ((first or plays) and not seen):
            self._open("Timeline")

    def _open_reference(self) -> None:
        """Open the dock of the reference picture with every picture that the user loads."""
        before, self._footage = self._footage, self._reference.footage
        if self._footage not in (None, before):
            self._decided()
            self._open("Reference")

    def _dock(self, title: str) -> QDockWidget:
        return self._docks[[entry.title for entry in DOCKS].index(title)]

    def _open(self, title: str) -> None:
        dock = self._dock(title)
        dock.show()
        dock.raise_()

    def _put_reference_away(self) -> None:
        """Hide the dock of the reference picture while the session has none."""
        dock = self._dock("Reference")
        if self._footage is not None:
            self.bring_back()
        elif not dock.isHidden():
            dock.hide()
            self._put_away = True

    def _decided(self) -> None:
        """Leave the dock of the reference picture as the user wants it."""
        self._put_away = False

    def bring_back(self) -> None:
        """Show what `model_changed` has put away, such as before the layout is stored."""
        if self._put_away:
            self._dock("Reference").show()
        self._put_away = False

    def model_changed(self) -> None:
        """Prepare all panels for another model, whose session may have keys and a picture.

        A dock of the reference picture that has none to show is put away until there is one.
        """
        self._had_keys, self._footage = False, self._reference.footage
        self._open_timeline()
        self._put_reference_away()
        for panel in self._panels:
            cast(Panel, panel).model_changed()

    def refresh(self) -> None:
        """Show the editor's state in all panels."""
        self._open_reference()
        for panel in self._panels:
            cast(Panel, panel).refresh()


def _scrolling(panel: QWidget) -> QWidget:
    """Return the panel in an area that scrolls vertically."""
    area = VerticalScroll()
    area.setWidget(panel)
    return area
