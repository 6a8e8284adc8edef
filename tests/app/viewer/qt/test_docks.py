"""Docks are wide enough for what they show, at the first start and whatever the user does."""

import pytest
from PIL import Image

from contrast import contrast
from deformer_app.viewer.settings import Settings
from deformer_app.viewer.stage import Hover
from person import place, rest
from waiting import wait_for
from windows import new_window

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


def at_the_sides(window):
    """The docks beside the picture, which scroll up and down only."""
    from PySide6.QtWidgets import QDockWidget

    from deformer_app.viewer.qt.docks import DOCKS

    titles = [entry.title for entry in DOCKS if entry.area != "bottom"]
    return [window.findChild(QDockWidget, title) for title in titles]


def cut_off(window):
    """Titles of the visible docks beside the picture that are narrower than their contents."""
    from PySide6.QtWidgets import QScrollArea

    return {
        dock.windowTitle()
        for dock in at_the_sides(window)
        for area in dock.findChildren(QScrollArea)
        if dock.isVisible() and area.widget().width() > area.viewport().width()
    }


@pytest.fixture
def crowded(app, window):
    """Shows a window with all docks, handles, keys and a colour bar in a size and a theme."""
    from PySide6.QtWidgets import QDockWidget

    place(window, *range(0, 120, 8))
    window.editor.timeline.keys.set()
    window.editor.latencies.append(0.123)  # texts of the status bar are as long as they get
    first = window.editor.edit.handles[0].id
    window.editor.handles.names.rename(first, "the tip of the longest finger")
    window.editor.state.hover(Hover(handle=first))
    window.editor.picture.change_look(colour="displacement")
    for dock in window.findChildren(QDockWidget):
        dock.show()

    def show(size, dark=False):
        window.choose_theme(dark)
        window.resize(*size)
        rest(app, window)
        assert window.size().toTuple() == size, "no dock or panel needs more"
        return window

    return show


def cut_texts(window):
    """Texts of visible buttons, boxes and labels that are wider than their widgets.

    Signs such as ★ have buttons of a fixed size.
    """
    from PySide6.QtWidgets import QAbstractButton, QLabel

    found = [*window.findChildren(QAbstractButton), *window.findChildren(QLabel)]
    return [
        widget.text()
        for widget in found
        if widget.isVisible() and len(widget.text()) > 1 and widget.window() is window
        if widget.width() < widget.minimumSizeHint().width()
    ]


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [(800, 560), (1280, 800), (1920, 1080)])
def test_no_text_is_cut_and_no_dock_lies_upon_another(app, crowded, size, dark):
    from itertools import combinations

    from PySide6.QtWidgets import QDockWidget

    window = crowded(size, dark)
    docks = window.findChildren(QDockWidget)
    for title in ("Poses", "Timeline"):
        window.findChild(QDockWidget, title).raise_()
        rest(app, window)
        seen = [dock for dock in docks if not dock.visibleRegion().isEmpty()]
        assert len(seen) == 5
        areas = [dock.geometry() for dock in seen] + [window.centralWidget().geometry()]
        assert all(window.rect().contains(area) for area in areas)
        assert not any(one.intersects(other) for one, other in combinations(areas, 2))
        assert not cut_texts(window)


def test_tools_that_do_not_fit_are_reached_by_a_button_at_the_end(app, window, hand):
    from PySide6.QtWidgets import QToolBar, QToolButton

    bar = window.findChild(QToolBar, "Tools")
    more, tool = bar.findChild(QToolButton, "qt_toolbar_ext_button"), window.menus.items
    rotate = bar.widgetForAction(tool["gizmo-rotate"])

    def middle(widget):
        return window.plotter.mapFromGlobal(widget.mapToGlobal(widget.rect().center())).toTuple()

    for dark in (True, False):
        window.choose_theme(dark)
        window.resize(800, 560)
        wait_for(lambda: more.isVisible() and not rotate.isVisible(), app.processEvents)
        assert window.rect().contains(more.mapTo(window, more.rect().bottomRight()))
        image = bar.grab(more.geometry().adjusted(5, 5, -5, -5)).toImage()
        inside = [(x, y) for x in range(image.width()) for y in range(image.height())]
        pixels = [image.pixelColor(x, y).getRgb()[:3] for x, y in inside]
        assert max(contrast(one, pixels[0]) for one in pixels) > 4.5, "an icon is seen on it"
        hand(middle(more), "click", "1")
        wait_for(rotate.isVisible, app.processEvents)
        window.act("gizmo-move")
        hand(middle(rotate), "click", "1")
        wait_for(lambda: window.editor.state.manipulator.mode == "rotate", app.processEvents)
        hand((40, 60))  # away from the bar, which then folds
        wait_for(lambda: not rotate.isVisible(), app.processEvents)
    window.resize(1280, 700)
    wait_for(lambda: not more.isVisible() and rotate.isVisible(), app.processEvents)


@pytest.mark.parametrize("dark", [False, True])
def test_a_drop_down_list_shows_all_of_its_items(app, window, hand, dark):
    from PySide6.QtWidgets import QComboBox

    window.choose_theme(dark)
    rest(app, window)
    boxes = [box for box in window.findChildren(QComboBox) if not box.visibleRegion().isEmpty()]
    assert len(boxes) > 2
    for box in boxes * 2:  # a box has the keyboard's focus when it is opened again
        at = window.plotter.mapFromGlobal(box.mapToGlobal(box.rect().center()))
        hand(at.toTuple(), "click", "1")
        wait_for(box.view().isVisible, app.processEvents)
        last = box.model().index(box.count() - 1, 0)
        assert box.view().viewport().rect().contains(box.view().visualRect(last).bottomLeft())
        hand("key", "Escape")
        wait_for(lambda box=box: not box.view().isVisible(), app.processEvents)


@pytest.mark.parametrize("size", [(1280, 800), (1000, 640)])
def test_docks_show_their_contents_in_full_width(app, window, size):
    from PySide6.QtCore import Qt

    window.resize(*size)
    side = at_the_sides(window)
    for dock in side:
        dock.show()
    wait_for(lambda: not cut_off(window), app.processEvents)
    window.resizeDocks(side, [20] * len(side), Qt.Orientation.Horizontal)
    app.processEvents()
    assert not cut_off(window)


def test_a_text_without_room_ends_in_dots_and_its_tool_tip_has_all_of_it(app):
    from deformer_app.viewer.qt.elided_label import ElidedLabel

    label, text = ElidedLabel(), "Blend with a selected pose"
    label.setText(text)
    label.resize(label.sizeHint())
    whole = label.grab().toImage()
    assert label.toolTip() == ""
    label.resize(label.minimumSizeHint())
    label.grab()
    assert label.width() < label.sizeHint().width() / 2 and label.toolTip() == text
    label.resize(label.sizeHint())
    assert label.grab().toImage() == whole and label.toolTip() == ""


def test_a_dock_becomes_wider_with_its_contents(app):
    from PySide6.QtWidgets import QMainWindow, QPushButton

    from deformer_app.viewer.qt.vertical_scroll import VerticalScroll

    button, area, around = QPushButton("narrow"), VerticalScroll(), QMainWindow()
    area.setWidget(button)
    around.setCentralWidget(area)
    around.show()
    around.resize(around.minimumSizeHint())
    app.processEvents()
    before = area.width()
    button.setText("a longer text than before")
    wait_for(lambda: area.width() > before, app.processEvents)
    assert area.viewport().width() >= button.minimumSizeHint().width()
    around.close()


def test_the_timeline_opens_with_the_first_key_and_stays_closed_once_closed(app, window):
    from PySide6.QtWidgets import QDockWidget

    dock, timeline = window.findChild(QDockWidget, "Timeline"), window.editor.timeline
    assert not dock.isVisible()
    place(window, 100)
    timeline.keys.set()
    assert dock.isVisible()
    dock.close()
    timeline.seek(5)
    timeline.keys.set()
    assert not dock.isVisible()


def test_the_timeline_shows_five_rows_below_that_of_all_keys_at_first(app, window):
    from deformer_app.viewer.qt.key_marks import ROW
    from deformer_app.viewer.qt.timeline_panel import TimelinePanel

    window.resize(1280, 800)
    place(window, *range(0, 120, 8))
    window.editor.timeline.keys.set()
    rest(app, window)
    panel = window.docks.panel(TimelinePanel)
    assert panel.rows.visibleRegion().boundingRect().height() >= 5 * ROW
    assert panel.summary.visibleRegion().boundingRect().height() == ROW
    assert window.plotter.height() > 440, "the picture keeps its room"


@pytest.fixture
def start(app, model_path, tmp_path):
    """Starts the program on its model or a session; returns if the dock Reference is open.

    Every start has the layout that the one before has left.
    """
    from PySide6.QtWidgets import QDockWidget

    def run(session=None, use=lambda window, dock: None):
        settings = Settings(tmp_path / "starts")
        settings.note_tour()
        with new_window(app, settings) as window:
            if session is None:
                window.begin(str(model_path), None, None)
            else:
                window.begin(None, None, None)
                window.open_session(session)
            rest(app, window)
            dock = window.findChild(QDockWidget, "Reference")
            shown = dock.isVisible()
            use(window, dock)
            return shown

    return run


@pytest.fixture
def pictured(app, start, tmp_path):
    """A session with a reference picture, saved in a first start; its dock was open at the end."""
    picture, session = tmp_path / "front.png", tmp_path / "work.json"
    Image.new("RGB", (8, 6)).save(picture)

    def work(window, dock):
        window.ask_open = lambda *_: picture
        window.act("reference-picture")
        wait_for(dock.isVisible, app.processEvents)
        rest(app, window)
        window.editor.save_session(session)

    assert not start(use=work)
    return session


@pytest.mark.parametrize("by_start_page", [False, True])
def test_the_dock_of_the_reference_picture_comes_back_with_one_only(
    app, start, pictured, by_start_page
):
    def leave(window, dock):
        if by_start_page:
            window.close_model()
            rest(app, window)

    assert not start(use=leave), "it has nothing to show"
    assert not start(use=leave)
    assert start(pictured, use=lambda window, dock: dock.close())
    assert not start(pictured), "the user has closed it"


def test_a_dock_that_the_user_closes_without_a_picture_stays_closed(start, pictured):
    def open_and_close(window, dock):
        dock.toggleViewAction().trigger()
        assert dock.isVisible()
        dock.close()

    assert not start(use=open_and_close)
    assert not start(pictured)


def test_a_click_between_fields_draws_no_ring_around_the_panel(app, window, hand):
    """The ring of a whole panel was covered by its contents, but for the edges."""
    from PySide6.QtCore import Qt
    from PySide6.QtWidgets import QScrollArea

    window.editor.timeline.keys.set()
    rest(app, window)
    areas = [area for area in window.findChildren(QScrollArea) if area.isVisible()]
    assert len(areas) > 3
    for area in areas:
        window.plotter.setFocus()
        before = area.grab().toImage()
        area.setFocus(Qt.FocusReason.MouseFocusReason)
        assert area.hasFocus() and area.grab().toImage() == before
    assert not any(area.focusPolicy() & Qt.FocusPolicy.TabFocus for area in areas)
