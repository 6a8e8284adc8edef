"""Fields of numbers, lists and sliders under a real mouse and real keys."""

import pytest

from number_fields import type_centre, type_height
from person import place, rest
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


@pytest.fixture
def at_work(app, window):
    """The window with a floor, a selected handle with a key, and all docks."""
    from PySide6.QtWidgets import QDockWidget

    type_height(window.editor, -5.0)
    place(window, 0)
    window.editor.timeline.keys.set()
    for dock in window.findChildren(QDockWidget):
        dock.show()
    rest(app, window)
    return window


def over(widget):
    """Words for xdotool: the mouse to the middle of a widget."""
    at = widget.mapToGlobal(widget.rect().center())
    return "mousemove", str(at.x()), str(at.y())


def length_field(window):
    from deformer_app.viewer.qt.timeline_panel import TimelinePanel

    return window.docks.panel(TimelinePanel).length


def weight_field(window):
    from deformer_app.viewer.qt.component_panel import ComponentPanel
    from deformer_app.viewer.qt.number_field import NumberField

    panel = window.docks.panel(ComponentPanel)
    return next(f for f in panel.findChildren(NumberField) if not f.visibleRegion().isEmpty())


def height_field(window):
    from PySide6.QtWidgets import QDoubleSpinBox

    from deformer_app.viewer.qt.model_panel import ModelPanel

    return window.docks.panel(ModelPanel).findChild(QDoubleSpinBox)


def place_field(window):
    from deformer_app.viewer.qt.handle_panel import HandlePanel

    return window.docks.panel(HandlePanel).coordinates[1]


def within_reach(window):
    """Fields, lists and sliders that the mouse can be over."""
    from PySide6.QtWidgets import QAbstractSpinBox, QComboBox, QSlider

    return [
        widget
        for kind in (QAbstractSpinBox, QComboBox, QSlider)
        for widget in window.findChildren(kind)
        if widget.isEnabled() and widget.visibleRegion().contains(widget.rect().center())
    ]


def value_of(widget):
    from PySide6.QtWidgets import QComboBox

    return widget.currentIndex() if isinstance(widget, QComboBox) else widget.value()


def test_the_wheel_changes_nothing_that_it_only_passes(app, at_work, hand):
    entries, widgets = len(at_work.editor.session.entries), within_reach(at_work)
    before = [value_of(widget) for widget in widgets]
    kinds = {type(widget).__name__ for widget in widgets}
    assert kinds >= {"NumberField", "QSpinBox", "QComboBox", "Slider", "ComponentSlider"}
    for widget in widgets:
        hand(*over(widget), "click", "4", "click", "5", "click", "5")
        assert not widget.hasFocus()
    rest(app, at_work)
    assert len(at_work.editor.session.entries) == entries
    assert [value_of(widget) for widget in widgets] == before


def test_the_wheel_changes_a_field_that_has_been_clicked(app, at_work, hand):
    field = height_field(at_work)
    hand(*over(field), "click", "1", "click", "4")
    rest(app, at_work)
    assert at_work.editor.floor.height > -5.0


@pytest.mark.parametrize("typed", ["-3.25", "-3,25"])
def test_a_point_and_a_comma_begin_the_fraction(app, at_work, hand, typed):
    field = height_field(at_work)
    hand(*over(field), "click", "1", "key", "ctrl+a", "type", "--", typed)
    assert field.text() == "-3.25" and at_work.editor.floor.height == -5.0
    hand("key", "Return")
    rest(app, at_work)
    assert at_work.editor.floor.height == -3.25


def test_fields_show_the_same_numbers_in_every_country(app):
    from PySide6.QtCore import QLocale

    from deformer_app.viewer.qt.number_field import NumberField

    before = QLocale()
    QLocale.setDefault(QLocale("de_DE"))
    try:
        field = NumberField(-10.0, 10.0, 2)
        field.setValue(0.5)
        assert field.text() == "0.50"
        assert field.valueFromText("0.5") == field.valueFromText("0,5") == 0.5
    finally:
        QLocale.setDefault(before)


def test_undo_reaches_the_session_from_a_field_in_which_nothing_is_typed(app, at_work, hand):
    field, floor = height_field(at_work), at_work.editor.floor
    hand(*over(field), "click", "1", "key", "Up")
    rest(app, at_work)
    raised = floor.height
    assert field.hasFocus() and raised > -5.0
    for key, height in (("ctrl+z", -5.0), ("ctrl+shift+z", raised)):
        hand("key", key)
        rest(app, at_work)
        assert floor.height == field.value() == height


def test_undo_takes_back_what_is_being_typed(app, at_work, hand):
    field = height_field(at_work)
    hand(*over(field), "click", "1", "key", "ctrl+a", "type", "7")
    entry = at_work.editor.session.cursor
    hand("key", "ctrl+z")
    assert field.text() == "-5.0000" and at_work.editor.session.cursor == entry


@pytest.mark.parametrize("field_of", [height_field, length_field])
def test_esc_drops_the_number_that_is_being_typed(app, at_work, hand, field_of):
    field, entry = field_of(at_work), at_work.editor.session.cursor
    before = field.text()
    hand(*over(field), "click", "1", "key", "ctrl+a", "type", "7")
    assert field.text() == "7"
    hand("key", "Escape")
    rest(app, at_work)
    assert at_work.plotter.hasFocus()
    assert field.text() == before and at_work.editor.session.cursor == entry


class Held:
    """A key that is held on a widget. X would repeat it as the machine's load allows."""

    def __init__(self, app, widget, key, times=5):
        from PySide6.QtCore import QEvent

        self._app, self._widget, self._key = app, widget, key
        widget.setFocus()
        for n in range(times):
            if n:
                self._send(QEvent.Type.KeyRelease, True)
            self._send(QEvent.Type.KeyPress, n > 0)

    def _send(self, kind, repeated):
        from PySide6.QtCore import Qt
        from PySide6.QtGui import QKeyEvent

        none = Qt.KeyboardModifier.NoModifier
        self._app.sendEvent(self._widget, QKeyEvent(kind, self._key, none, "", repeated))
        self._app.processEvents()

    def let_go(self):
        from PySide6.QtCore import QEvent

        self._send(QEvent.Type.KeyRelease, False)


@pytest.mark.parametrize("field_of", [height_field, weight_field, place_field])
def test_a_key_that_is_held_makes_one_step_of_the_history(app, at_work, hand, field_of):
    from PySide6.QtCore import Qt

    field, editor = field_of(at_work), at_work.editor
    entries, start = len(editor.session.entries), field.value()
    held = Held(app, field, Qt.Key.Key_Up)
    # What a component's field shows is the pose's weight, which a handle may pull elsewhere.
    assert len(editor.session.entries) == entries and editor.session.under_way
    held.let_go()
    rest(app, at_work)
    assert len(editor.session.entries) == entries + 1
    hand("key", "ctrl+z")
    rest(app, at_work)
    assert field.value() == start


def test_an_arrow_that_is_held_makes_one_step_of_the_history(app, at_work, hand):
    field, editor = height_field(at_work), at_work.editor
    entries, start = len(editor.session.entries), field.value()
    arrow = field.mapToGlobal(field.rect().topRight())
    hand("mousemove", str(arrow.x() - 8), str(arrow.y() + 7), "mousedown", "1")
    wait_for(lambda: field.value() > start + 2.5 * field.singleStep(), app.processEvents)
    assert editor.floor.height == field.value() and len(editor.session.entries) == entries
    hand("mouseup", "1")
    rest(app, at_work)
    assert len(editor.session.entries) == entries + 1


def test_a_key_that_is_held_on_a_slider_makes_one_step_of_the_history(app, at_work, hand):
    from PySide6.QtCore import Qt

    from deformer_app.viewer.qt.model_panel import ModelPanel

    slider, editor = at_work.docks.panel(ModelPanel).prior, at_work.editor
    entries, start = len(editor.session.entries), slider.value()
    held = Held(app, slider, Qt.Key.Key_Right)
    assert slider.value() == start + 5 * slider.singleStep()
    assert len(editor.session.entries) == entries and editor.session.under_way
    held.let_go()
    rest(app, at_work)
    assert len(editor.session.entries) == entries + 1
    Held(app, slider, Qt.Key.Key_Right)
    assert slider.hasFocus()
    at_work.plotter.setFocus()  # the key's release goes to the picture
    rest(app, at_work)
    assert len(editor.session.entries) == entries + 2


def test_a_typed_coordinate_leaves_the_others_as_exact_as_they_are(app, at_work, hand):
    editor, field = at_work.editor, place_field(at_work)
    type_centre(editor, [0.123456789, 0.2, 0.987654321])
    rest(app, at_work)
    hand(*over(field), "click", "1", "key", "ctrl+a", "type", "0.25")
    hand("key", "Return")
    rest(app, at_work)
    (handle,) = editor.state.selection(editor.edit.handles)
    assert handle.centre == pytest.approx((0.123456789, 0.25, 0.987654321), abs=1e-12)


@pytest.mark.parametrize("scale", [1e-4, 1e3])
def test_places_have_digits_and_steps_for_a_body_of_any_size(app, window, tmp_path, scale):
    import deformer
    from deformer_app.viewer.qt.handle_panel import HandlePanel
    from shapes import sequence

    shapes = sequence(5)
    small = deformer.MeshSequence(scale * shapes.vertices, shapes.faces)
    deformer.train(small, components=3, epochs=2, seed=0).save(tmp_path / "small")
    window.editor.open_model(tmp_path / "small")
    place(window, 100)
    rest(app, window)
    size = window.editor.model.reference.bounding_diagonal
    (handle,) = window.editor.edit.handles
    for field, value in zip(
        window.docks.panel(HandlePanel).coordinates, handle.centre, strict=True
    ):
        assert abs(field.value() - value) <= 1e-4 * size
        assert field.singleStep() == pytest.approx(0.002 * size, rel=0.01)
        assert len(field.text()) <= 14


@pytest.mark.parametrize("kind", ["exact", "soft", None])
def test_a_weight_that_handles_pull_elsewhere_is_told(app, window, hand, kind):
    from deformer_app.viewer.component_names import component_title
    from deformer_app.viewer.qt.component_panel import ComponentPanel

    if kind is not None:
        place(window, 0, 60, 115)
        window.editor.handles.set_kind(kind)
    rest(app, window)
    window.notices.hide_note()
    panel, field = window.docks.panel(ComponentPanel), weight_field(window)
    row = next(row for row in panel.rows.values() if row.value is field)
    hand(*over(field), "click", "1", "key", "ctrl+a", "type", "1.5")
    hand("key", "Return")
    rest(app, window)
    title, note = component_title(window.editor.model, row.component), window.notices.note
    if kind is None:
        assert field.text() == "1.50" and not note.isVisible()
    else:
        assert field.text() != "1.50"
        assert note.isVisible() and note.text == (
            f"{title}: 1.50 asked for, {field.text()} reached; handles hold the shape"
        )
    if kind == "exact":
        window.notices.hide_note()
        row.extremes[1]._clicked()
        rest(app, window)
        assert f"{row.scale.high:.2f} asked for" in note.text and note.isVisible()
