"""The tour of the first start, by the mouse and the keys."""

import numpy as np
import pytest

from off_screen_editor import seen
from person import rest
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


@pytest.fixture
def tour(app, window):
    """The tour on its first step, without the pause after each step."""
    from PySide6.QtWidgets import QPushButton

    tour = window.tour
    tour._pause.setInterval(0)
    tour.begin()
    wait_for(lambda: tour_step(window) == 1, app.processEvents)
    tour.titles = lambda: [b.text() for b in tour.findChildren(QPushButton) if b.isVisible()]
    return tour


def tour_step(window):
    """Number of the step that the tour shows."""
    return int(window.tour.text.removeprefix("<b>")[0])


def tour_buttons(window):
    from PySide6.QtWidgets import QPushButton

    return {b.text(): b for b in window.tour.findChildren(QPushButton)}


def spot(window, share):
    """A pixel of the picture where the tube is seen at a share of its length."""
    return seen(window.editor, share)[1]


def beside(window):
    """A pixel of the picture beside the surface and the tour."""
    return np.array([30.0, window.plotter.height() - 150.0])


def test_the_tour_goes_on_by_what_it_asks_for(app, window, hand, tour):
    """By the mouse and the keys, as its texts say; other steps of the session do not count."""
    start, corner = spot(window, 0.7), beside(window)
    assert "pull" in tour.text and tour.titles() == ["Next", "End tour"]
    window.editor.prior.start_at("Mean", window.editor.model.latent_mean)
    rest(app, window)
    assert tour_step(window) == 1
    hand(start, "mousedown", "1", np.add(start, (0, -20)), np.add(start, (0, -40)), "mouseup", "1")
    wait_for(lambda: tour_step(window) == 2, app.processEvents)
    rest(app, window)
    assert "turn the view" in tour.text
    hand("key", "ctrl+z")
    rest(app, window)
    assert tour_step(window) == 2
    hand(
        corner, "mousedown", "1", np.add(corner, (30, 0)), np.add(corner, (60, -10)), "mouseup", "1"
    )
    wait_for(lambda: tour_step(window) == 3, app.processEvents)
    assert "press P" in tour.text
    rest(app, window)
    at = spot(window, 0.4)
    hand(
        at, "mousedown", "1", np.add(at, (10, -20)), np.add(at, (10, -40)), "mouseup", "1"
    )  # no pin
    rest(app, window)
    hand("key", "ctrl+z")
    rest(app, window)
    assert tour_step(window) == 3
    hand(spot(window, 0.4), "key", "p")
    wait_for(lambda: tour_step(window) == 4, app.processEvents)
    assert "Ctrl+Z" in tour.text and tour.titles() == ["Done"]
    tour_buttons(window)["Done"].click()
    assert tour.isHidden() and not tour.running


def test_the_tour_leaves_out_what_was_done_before_its_turn(app, window, hand, tour):
    hand(spot(window, 0.4), "key", "p")
    rest(app, window)
    assert [h.kind for h in window.editor.edit.handles] == ["pin"]
    assert tour_step(window) == 1
    tour.go_on()
    assert tour_step(window) == 2
    window.editor.state.viewpoint.set_camera(window.editor.stage.camera.panned(9, 0, (100, 100)))
    wait_for(lambda: tour_step(window) == 4, app.processEvents)
    assert tour.titles() == ["Done"]


def test_the_tour_does_not_go_on_amid_a_drag(app, window, hand, tour):
    start = spot(window, 0.7)
    hand(start, "mousedown", "1", np.add(start, (0, -20)), np.add(start, (0, -40)))
    wait_for(lambda: 0 in tour._done, app.processEvents)
    for _ in range(20):  # longer than the pause
        app.processEvents()
    assert window.editor.dragging and tour_step(window) == 1
    hand("mouseup", "1")
    wait_for(lambda: tour_step(window) == 2, app.processEvents)


def test_the_tour_goes_through_all_steps_by_its_button(app, window, tour):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    for step in (1, 2, 3):
        assert tour_step(window) == step and "Done" not in tour.titles()
        QTest.mouseClick(tour_buttons(window)["Next"], Qt.MouseButton.LeftButton)
    assert tour_step(window) == 4
    QTest.mouseClick(tour_buttons(window)["Done"], Qt.MouseButton.LeftButton)
    assert tour.isHidden() and not tour.running


@pytest.mark.parametrize("size", [(800, 560), (1280, 700)])
def test_the_body_stays_under_the_cursor_whatever_the_tour_shows(app, window, size):
    """Also where the tour's line is drawn: upon the picture, at its lower edge."""
    from PySide6.QtCore import QPoint, QRect

    def settled():
        rest(app, window)
        app.sendPostedEvents()  # what a layout has to do
        rest(app, window)
        corner = window.plotter.mapTo(window, QPoint(0, 0))
        return QRect(corner, window.plotter.size()), spot(window, 0.5).tolist()

    tour = window.tour
    window.resize(*size)
    before = settled()
    tour._show(-1)
    picture, _ = before
    while tour.running:
        assert settled() == before, tour.text
        at = QRect(tour.mapTo(window, QPoint(0, 0)), tour.size())
        assert picture.contains(at) and at.bottom() > picture.center().y()
        assert abs(at.center().x() - picture.center().x()) <= 1
        beneath = window.childAt(at.center())
        assert beneath is tour or tour.isAncestorOf(beneath), "nothing lies upon it"
        tour.go_on()
    assert tour.isHidden() and settled() == before


def test_the_tour_follows_the_picture(app, window, tour):
    from PySide6.QtCore import QPoint

    def gap():
        """Pixels below the tour and the picture's lower edge."""
        low = tour.mapTo(window, QPoint(0, tour.height())).y()
        return window.plotter.mapTo(window, QPoint(0, window.plotter.height())).y() - low

    before, height = gap(), window.plotter.height()
    window.resize(window.width(), window.height() - 80)
    wait_for(lambda: window.plotter.height() < height, app.processEvents)
    assert 0 <= gap() == before
