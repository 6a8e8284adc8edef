"""The dock of the components on a virtual display."""

import numpy as np
import pytest

from deformer_app.viewer.settings import Settings
from person import rest
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


@pytest.fixture
def panel(app, window):
    from deformer_app.viewer.qt.component_panel import ComponentPanel

    panel = window.docks.panel(ComponentPanel)
    wait_for(lambda: panel.rows and window.idle, app.processEvents)
    return panel


def shown(panel):
    return [k for k, slider in panel.sliders.items() if slider.isVisibleTo(panel)]


def test_signs_on_buttons_are_drawn_whole(app, window, panel):
    from PySide6.QtGui import QImage
    from PySide6.QtWidgets import QToolButton

    def ink(button):
        """Width in pixels of what is drawn on a button."""
        image = button.grab().toImage().convertToFormat(QImage.Format.Format_Grayscale8)
        rows, columns = range(image.height()), range(image.width())
        ground = image.pixel(0, 0)
        return sum(any(image.pixel(x, y) != ground for y in rows) for x in columns)

    row = next(iter(panel.rows.values()))
    for button in row.findChildren(QToolButton):
        here = ink(button)
        button.setFixedWidth(60)
        assert here == ink(button), button.text()


def test_zero_is_in_the_middle_of_a_slider_and_typed_numbers_are_weights(app, window, panel):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    known = window.editor.activations
    k = int(known.order[0])
    row = panel.rows[k]
    window.editor.prior.reset()
    rest(app, window)
    assert row.slider.value() == (row.slider.maximum() + row.slider.minimum()) / 2
    row.value.setFocus()
    row.value.selectAll()
    QTest.keyClicks(row.value, "0.5")
    window.docks.refresh()  # which leaves alone what is being typed
    QTest.keyClick(row.value, Qt.Key.Key_Return)
    rest(app, window)
    wanted = known.reference[k] + 0.5 * (known.extreme[k] - known.reference[k])
    assert window.editor.code[k] == pytest.approx(wanted)
    assert window.editor.session.entry.label == f"Component {k}"
    row.value.setValue(1.0)
    rest(app, window)
    assert window.editor.code[k] == pytest.approx(known.extreme[k])


def test_tab_goes_from_a_slider_to_its_number_to_the_next_slider(app, window, panel):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    first, second = list(panel.sliders)[:2]
    way = [panel.rows[first].value, panel.rows[second].slider, panel.rows[second].value]
    panel.rows[first].slider.setFocus()
    for widget in way:
        QTest.keyClick(window.focusWidget(), Qt.Key.Key_Tab)
        assert window.focusWidget() in (widget, *widget.children())


def test_both_extremes_are_drawn_and_a_click_goes_there(app, window, panel):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    k = next(iter(panel.sliders))
    row = panel.rows[k]
    found = wait_for(lambda: window.thumbnails.pictures(row.subject), app.processEvents)
    assert len(found) == 2 and (found[0] != found[1]).any()
    rest(app, window)
    assert not window.editor.busy, "the window rests once they are drawn"
    QTest.mouseClick(row.extremes[1], Qt.MouseButton.LeftButton)
    rest(app, window)
    assert row.scale.weight(window.editor.code[k]) == pytest.approx(row.scale.high)


def test_search_finds_names_numbers_and_regions(app, window, panel):
    window.editor.name_components({3: "left arm up"})
    rest(app, window)
    panel.search.setText("ARM left")
    assert shown(panel) == [3]
    panel.search.setText("component 5")
    assert shown(panel) == [5]
    title = panel.sections[-1].title
    panel.search.setText(title)
    assert {row.component for row in panel.sections[-1].rows} <= set(shown(panel))
    panel.search.setText("no such thing")
    assert shown(panel) == []
    panel.search.clear()
    assert sorted(shown(panel)) == list(range(6))


def test_parts_of_the_body_are_found_by_their_names(app, window, panel):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    window.editor.open_model("humanoid")
    wait_for(lambda: panel.rows and window.idle, app.processEvents)
    parts = {"leg": {"Left lower leg", "Upper legs"}, "arm": {"Right arm", "Left forearm"}}
    parts |= {"upper ARM": {"Left upper arm"}, "hand": {"Left hand"}, "head": {"Head"}}
    for typed, some in parts.items():
        QTest.keyClicks(panel.search, typed)
        found = {panel.rows[k].name.text() for k in shown(panel)}
        assert some <= found
        assert all(word in name.lower() for name in found for word in typed.lower().split())
        QTest.keyClick(panel.search, Qt.Key.Key_A, Qt.KeyboardModifier.ControlModifier)
        QTest.keyClick(panel.search, Qt.Key.Key_Delete)


def test_a_name_that_looks_like_html_is_shown_as_it_is(app, window, panel):
    from PySide6.QtCore import Qt

    row = panel.rows[2]
    row.name.show_text("nod <b>", "nod <b>")
    wide = row.name.sizeHint().width()
    row.name.show_text("nod", "nod")
    assert row.name.sizeHint().width() < wide
    assert row.name.textFormat() == Qt.TextFormat.PlainText


def test_a_name_is_edited_in_its_place(app, window, panel):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    row = panel.rows[2]
    QTest.mouseDClick(row.name, Qt.MouseButton.LeftButton)
    QTest.keyClicks(row.name.field, "nod")
    QTest.keyClick(row.name.field, Qt.Key.Key_Return)
    rest(app, window)
    assert row.name.field is None and row.name.text() == "nod"
    assert window.editor.session.component_names == {2: "nod"}
    QTest.keyClick(row.slider, Qt.Key.Key_F2)
    assert row.name.field.text() == "nod"
    QTest.keyClicks(row.name.field, "bow")
    QTest.keyClick(row.name.field, Qt.Key.Key_Escape)
    rest(app, window)
    assert row.name.field is None and window.editor.model.label(2) == "nod"
    # A name that is taken is one line in the window.
    other = panel.rows[1]
    QTest.mouseDClick(other.name, Qt.MouseButton.LeftButton)
    QTest.keyClicks(other.name.field, "nod")
    QTest.keyClick(other.name.field, Qt.Key.Key_Return)
    rest(app, window)
    assert "given twice" in window.notices.mistake.text
    assert other.name.text() == "Component 1"


def test_a_favourite_component_is_first_and_is_so_in_the_next_window(
    app, window, panel, model_path
):
    k = list(panel.sliders)[-1]
    panel.rows[k].star.click()
    assert next(iter(panel.sliders)) == k and panel.sections[0].title == "Favourites"
    assert sorted(panel.sliders) == list(range(6)), "each component has one row"
    assert Settings(window.settings.folder).favourites(window.editor.model.fingerprint) == [k]
    window.editor.open_model(model_path)
    wait_for(lambda: panel.rows and window.idle, app.processEvents)
    assert next(iter(panel.sliders)) == k and panel.rows[k].star.isChecked()
    panel.rows[k].star.click()
    assert panel.sections[0].title != "Favourites" and panel.favourites == []


def test_a_name_is_shown_as_it_was_typed_and_sections_tell_their_numbers(app, window, panel):
    k = next(iter(panel.sliders))
    assert panel.rows[k].name.text() == f"Component {k}"
    window.editor.name_components({k: "wave"})
    rest(app, window)
    assert panel.rows[k].name.text() == "wave"
    for section in panel.sections:
        assert section.header.text() == f"{section.title} ({len(section.rows)})"


@pytest.mark.parametrize("dark", [False, True])
def test_only_the_focus_draws_a_ring(app, window, panel, hand, dark):
    from PySide6.QtCore import Qt
    from PySide6.QtGui import QColor

    def edges(button):
        """Sides of a button in whose middle there is the colour of the focus."""
        image, (x, y) = button.grab().toImage(), button.rect().center().toTuple()
        right, bottom = image.width() - 1, image.height() - 1
        sides = {"left": (0, y), "top": (x, 0), "right": (right, y), "bottom": (x, bottom)}
        accent = QColor(window.editor.state.view.theme.accent)
        return {side for side, at in sides.items() if image.pixelColor(*at) == accent}

    window.choose_theme(dark)
    rest(app, window)
    star = panel.rows[int(window.editor.activations.order[0])].star
    at = window.plotter.mapFromGlobal(star.mapToGlobal(star.rect().center())).toTuple()
    hand(at, "click", "1")
    wait_for(star.isChecked, app.processEvents)
    tool = window.menus.items["gizmo-move"]
    bar = next(w for w in tool.associatedObjects() if w.objectName() == "Tools")
    button = bar.widgetForAction(tool)
    assert button.isChecked()
    assert [edges(one) for one in (star, button)] == [{"bottom"}, {"bottom"}]
    button.setFocus(Qt.FocusReason.TabFocusReason)
    wait_for(button.hasFocus, app.processEvents)
    assert edges(button) == {"left", "top", "right", "bottom"} and edges(star) == {"bottom"}


def test_a_search_that_finds_nothing_says_so(app, window, panel):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QLabel

    def told():
        labels = panel.findChildren(QLabel)
        return [label.text() for label in labels if "matches" in label.text() and label.isVisible()]

    width = panel.width()
    QTest.keyClicks(panel.search, "e")
    assert shown(panel) and not told()
    QTest.keyClicks(panel.search, "lephant's trunk <b>")
    assert not shown(panel) and told() == ["No component matches “elephant's trunk <b>”."]
    QTest.keyClicks(panel.search, "x" * 100)
    rest(app, window)
    assert panel.width() == width
    QTest.keyClick(panel.search, Qt.Key.Key_A, Qt.KeyboardModifier.ControlModifier)
    QTest.keyClick(panel.search, Qt.Key.Key_Delete)
    assert shown(panel) and not told()


def test_sections_fold_and_the_order_is_by_strength_if_asked_for(app, window, panel):
    order = window.editor.activations.order.tolist()
    regions = [region.components for region in window.editor.regions]
    assert list(panel.sliders) == [k for region in regions for k in region]
    first = panel.sections[0]
    first.header.click()
    assert not set(shown(panel)) & {row.component for row in first.rows}
    first.header.click()
    assert sorted(shown(panel)) == sorted(order)
    panel.order.setCurrentIndex(panel.order.findData("strength"))
    panel.order.activated.emit(panel.order.currentIndex())
    assert list(panel.sliders) == order
    assert Settings(window.settings.folder).component_order == "strength"


def test_a_slider_goes_to_zero_on_a_double_click(app, window, panel):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    k = next(iter(panel.sliders))
    row = panel.rows[k]
    row.value.setValue(0.7)
    rest(app, window)
    assert row.slider.value() > row.slider.maximum() / 2
    QTest.mouseDClick(row.slider, Qt.MouseButton.LeftButton)
    rest(app, window)
    reference = window.editor.activations.reference[k]
    np.testing.assert_allclose(window.editor.code[k], reference, atol=1e-9)
