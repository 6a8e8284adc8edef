"""Docks are wide enough for what they show, at the first start and whatever the user does."""

import pytest

from person import place
from waiting import wait_for

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
