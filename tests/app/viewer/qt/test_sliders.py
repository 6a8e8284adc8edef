"""Sliders under a real mouse and real keys."""

import pytest

from person import place, rest
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


def strength(window):
    from deformer_app.viewer.qt.model_panel import ModelPanel

    return window.docks.panel(ModelPanel).prior


def component(window):
    from deformer_app.viewer.qt.component_panel import ComponentPanel

    sliders = window.docks.panel(ComponentPanel).sliders.values()
    return next(s for s in sliders if not s.visibleRegion().isEmpty())


def weight(window):
    from deformer_app.viewer.qt.handle_panel import HandlePanel

    return window.docks.panel(HandlePanel)._weight


def opacity(window):
    from deformer_app.viewer.qt.picture_panel import PicturePanel

    return window.docks.panel(PicturePanel).opacity


@pytest.fixture
def at_work(app, window):
    """The window with a selected handle."""
    place(window, 0)
    rest(app, window)
    return window


def at(slider, share, above=0):
    """Words for xdotool: the mouse to a share of a slider's width, some pixels above its middle."""
    point = slider.rect().center()
    point.setX(round(share * (slider.width() - 1)))
    point.setY(point.y() - above)
    point = slider.mapToGlobal(point)
    return "mousemove", str(point.x()), str(point.y())


def labels(window):
    return [entry.label for entry in window.editor.session.entries]


@pytest.mark.parametrize("slider_of", [strength, component, weight])
@pytest.mark.parametrize("above", [0, 8])
def test_a_press_beside_the_handle_brings_it_to_the_mouse_and_a_drag_goes_on(
    app, at_work, hand, slider_of, above
):
    slider, editor, before = slider_of(at_work), at_work.editor, labels(at_work)
    start = editor.edit
    hand(*at(slider, 0.8, above), "mousedown", "1")
    rest(app, at_work)

    def off(share):
        middle = slider.handle_area().center().x()
        return abs(middle - round(share * (slider.width() - 1)))

    assert off(0.8) <= 1 and editor.session.under_way and editor.edit != start
    hand(*at(slider, 0.75), *at(slider, 0.3))
    rest(app, at_work)
    assert off(0.3) <= 1 and labels(at_work) == before
    hand("mouseup", "1")
    rest(app, at_work)
    assert len(labels(at_work)) == len(before) + 1 and not editor.session.under_way
    at_work.act("undo")
    assert editor.edit == start


@pytest.mark.parametrize("slider_of", [strength, component, weight])
def test_esc_gives_up_a_slide_whatever_the_mouse_does_then(app, at_work, hand, slider_of):
    slider, editor, before = slider_of(at_work), at_work.editor, labels(at_work)
    start, value = editor.edit, slider.value()
    hand(*at(slider, 0.8), "mousedown", "1", *at(slider, 0.7))
    assert editor.edit != start
    hand("key", "Escape")
    rest(app, at_work)
    assert editor.edit == start and slider.value() == value
    hand(*at(slider, 0.2), "mouseup", "1")
    rest(app, at_work)
    assert editor.edit == start and labels(at_work) == before and slider.value() == value
    hand("click", "1")
    rest(app, at_work)
    assert len(labels(at_work)) == len(before) + 1


def test_esc_brings_back_a_slider_that_makes_no_steps(app, at_work, hand, tmp_path):
    from PIL import Image
    from PySide6.QtWidgets import QDockWidget

    Image.new("RGB", (20, 30), "red").save(tmp_path / "red.png")
    at_work.editor.picture.open_reference(tmp_path / "red.png")
    for dock in at_work.findChildren(QDockWidget):
        dock.show()
        if "Reference" in dock.windowTitle():
            dock.raise_()
    rest(app, at_work)
    app.processEvents()
    slider, reference = opacity(at_work), at_work.editor.state.reference_picture
    before = reference.placement.opacity
    hand(*at(slider, 0.1), "mousedown", "1")
    assert reference.placement.opacity == pytest.approx(0.1, abs=0.05) != before
    hand("key", "Escape", "mouseup", "1")
    rest(app, at_work)
    assert reference.placement.opacity == pytest.approx(before, abs=1e-3)


def test_a_press_on_the_handle_moves_nothing(app, at_work, hand):
    slider, before = strength(at_work), labels(at_work)
    value, area = slider.value(), slider.handle_area()
    point = slider.mapToGlobal(area.center())
    where = "mousemove", str(point.x() + 4), str(point.y() + 3)
    hand(*where, "click", "1")
    rest(app, at_work)
    assert slider.value() == value and labels(at_work) == before


def test_the_right_button_takes_hold_of_nothing(app, at_work, hand):
    slider, value = strength(at_work), strength(at_work).value()
    hand(*at(slider, 0.8), "mousedown", "3", *at(slider, 0.7))
    at_work.editor.prior.set_noise(0.5 * at_work.editor.edit.noise)
    at_work.editor.commit("Strength of the prior")
    rest(app, at_work)
    assert slider.value() < value, "it shows what is changed elsewhere"
    hand("mouseup", "3")


def test_the_middle_button_brings_the_handle_to_the_mouse_in_one_step(app, at_work, hand):
    slider, before = strength(at_work), labels(at_work)
    hand(*at(slider, 0.8), "mousedown", "2", *at(slider, 0.7), "mouseup", "2")
    rest(app, at_work)
    wait_for(lambda: len(labels(at_work)) > len(before), app.processEvents)
    assert labels(at_work) == [*before, "Strength of the prior"]
    assert 700 <= slider.value() < 760
