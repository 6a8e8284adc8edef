"""The dock of poses on a virtual display."""

import numpy as np
import pytest

import deformer
from deformer_app.viewer.pose_commands import save_pose
from person import place, rest
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


@pytest.fixture
def strip(app, window):
    from deformer_app.viewer.qt.pose_strip import PoseStrip

    rest(app, window)
    panel = window.docks.panel(PoseStrip)
    panel.parentWidget().raise_()  # before the timeline, which has the same place
    wait_for(lambda: not panel.examples.visibleRegion().isEmpty(), app.processEvents)
    rest(app, window)
    return panel


def names(shown):
    return [shown.item(row).text() for row in range(shown.count())]


def click(shown, row, double=False):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    at = shown.visualItemRect(shown.item(row)).center()
    QTest.mouseClick(shown.viewport(), Qt.MouseButton.LeftButton, pos=at)
    if double:
        QTest.mouseDClick(shown.viewport(), Qt.MouseButton.LeftButton, pos=at)


def test_examples_have_pictures_and_a_double_click_starts_from_one(app, window, strip):
    from deformer_app.viewer.shape_thumbnails import Subject

    found = names(strip.examples)
    assert found[:2] == ["Reference", "Mean"] and "Shape 3" in found
    first, other = (strip.examples.poses[n].code for n in (0, 3))
    pictures = [
        wait_for(lambda c=c: window.thumbnails.pictures(Subject((c,))), app.processEvents)[0]
        for c in (first, other)
    ]
    assert (pictures[0] != pictures[1]).any()
    rest(app, window)
    row = found.index("Shape 3")
    click(strip.examples, row)
    rest(app, window)
    assert window.editor.session.entry.label == "Start", "a click selects"
    click(strip.examples, row, double=True)
    rest(app, window)
    assert window.editor.session.entry.label == "Start from Shape 3"
    np.testing.assert_allclose(window.editor.code, strip.examples.poses[row].code)
    window.menus.items["undo"].trigger()
    rest(app, window)
    np.testing.assert_allclose(window.editor.code, first)


def test_the_pictures_of_one_theme_are_shown_until_those_of_the_other_are_there(
    app, window, strip, monkeypatch
):
    from PySide6.QtGui import QColor

    from deformer_app.rendering.palette import DARK, LIGHT
    from deformer_app.viewer.shape_drawing import ShapeDrawing

    def squares():
        """Colours in the middle of the pictures in sight."""
        view, found = strip.examples.viewport(), []
        image = view.grab().toImage()
        for row in range(strip.examples.count()):
            at = strip.examples.visualItemRect(strip.examples.item(row))
            if view.rect().contains(at):
                found.append(image.pixelColor(at.center().x(), at.top() + at.height() // 3).name())
        return found

    def square(drawing, mesh, vertices, camera, theme):
        """A picture of one colour, to tell the themes apart whatever draws the shapes."""
        colour = np.array(QColor(theme.clay).getRgb(), dtype=np.uint8)
        return np.broadcast_to(colour, (96, 96, 4))

    window.thumbnails._cache.clear()
    monkeypatch.setattr(ShapeDrawing, "picture", square)
    strip.examples.viewport().update()
    wait_for(lambda: set(squares()) == {LIGHT.clay}, app.processEvents)
    rest(app, window)
    window.act("dark")
    assert set(squares()) == {LIGHT.clay} and window.thumbnails.waiting
    rest(app, window)
    assert set(squares()) == {DARK.clay} and not window.thumbnails.waiting


def test_a_pose_is_saved_renamed_deleted_and_brought_back_by_keys(app, window, strip):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    place(window, 100)
    rest(app, window)
    window.menus.items["save-pose"].trigger()
    strip.save.click()
    rest(app, window)
    shelf = window.editor.session.shelf
    assert names(strip.saved) == ["Pose 1", "Pose 2"]
    click(strip.saved, 0)
    QTest.keyClick(strip.saved, Qt.Key.Key_F2)
    from PySide6.QtWidgets import QLineEdit

    field = strip.saved.viewport().findChild(QLineEdit)
    QTest.keyClicks(field, "reach")
    QTest.keyClick(field, Qt.Key.Key_Return)
    wait_for(lambda: shelf.poses[0].name == "reach", app.processEvents)
    rest(app, window)
    wait_for(lambda: names(strip.saved) == ["reach", "Pose 2"], app.processEvents)
    QTest.keyClick(strip.saved, Qt.Key.Key_Right, Qt.KeyboardModifier.AltModifier)
    rest(app, window)
    assert names(strip.saved) == ["Pose 2", "reach"] and strip.saved.chosen.name == "reach"
    QTest.keyClick(strip.saved, Qt.Key.Key_Delete)
    rest(app, window)
    assert names(strip.saved) == ["Pose 2"]
    assert len(window.editor.edit.handles) == 1, "the key deletes no handle"
    bring = strip.menu(strip.saved, -1).actions()[-1]
    assert "reach" in bring.text()
    bring.trigger()
    rest(app, window)
    assert names(strip.saved) == ["Pose 2", "reach"]


def test_a_saved_pose_is_started_from_and_copied_with_its_handles_or_its_shape_alone(
    app, window, strip
):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    place(window, 100)
    rest(app, window)
    window.menus.items["save-pose"].trigger()
    rest(app, window)
    shown, handles = window.editor.vertices.copy(), window.editor.edit.handles

    def clear():
        window.editor.prior.reset()
        place(window, 60)
        rest(app, window)

    clear()
    click(strip.saved, 0)
    click(strip.saved, 0, double=True)
    rest(app, window)
    assert window.editor.session.entry.label == "Start from Pose 1"
    np.testing.assert_allclose(window.editor.vertices, shown, atol=1e-12)
    assert [h.targets for h in window.editor.edit.handles] == [h.targets for h in handles]
    assert "replace the one that was there" in window.notices.note.text
    clear()
    click(strip.saved, 0)
    QTest.keyClick(strip.saved, Qt.Key.Key_C, Qt.KeyboardModifier.ControlModifier)
    window.menus.items["paste-pose"].trigger()
    rest(app, window)
    np.testing.assert_allclose(window.editor.vertices, shown, atol=1e-12)
    clear()
    menu = strip.menu(strip.saved, 0)
    (shape,) = (a for a in menu.actions() if "with the present handles" in a.text())
    shape.trigger()
    rest(app, window)
    assert window.editor.session.entry.label == "Start from the shape of Pose 1"
    assert [h.vertices for h in window.editor.edit.handles] == [(60,)]


def test_a_name_that_is_taken_is_told_and_changes_nothing(app, window, strip):
    for _ in range(2):
        save_pose(window.editor)
    rest(app, window)
    strip.saved.item(0).setText("Pose 2")
    rest(app, window)
    assert "another pose has this name" in window.notices.mistake.text
    assert names(strip.saved) == ["Pose 1", "Pose 2"]


def test_the_slider_blends_with_the_selected_pose(app, window, strip):
    from PySide6.QtCore import QPoint, Qt
    from PySide6.QtTest import QTest

    assert not strip.blend.isEnabled()
    start = window.editor.code.copy()
    row = names(strip.examples).index("Shape 4")
    click(strip.examples, row)
    rest(app, window)
    assert strip.blend.isEnabled()
    handle = strip.blend.handle_area().center()
    QTest.mousePress(strip.blend, Qt.MouseButton.LeftButton, pos=handle)
    assert strip.blend.value() == 0
    strip.blend.setValue(500)
    wanted = deformer.interpolate_codes([start, strip.examples.poses[row].code], 0.5)
    wait_for(lambda: np.allclose(window.editor.code, wanted), app.processEvents)
    assert window.editor.session.under_way
    QTest.mouseRelease(strip.blend, Qt.MouseButton.LeftButton, pos=QPoint(1, 1))
    rest(app, window)
    assert window.editor.session.entry.label == "Blend with Shape 4"
    assert strip.blend.value() == 500
    window.menus.items["undo"].trigger()
    rest(app, window)
    assert strip.blend.value() == 0


def test_the_label_of_a_blend_tells_its_share(app, window, strip, hand):
    from PySide6.QtWidgets import QLabel

    def told():
        rest(app, window)
        (label,) = (x for x in strip.findChildren(QLabel) if x.text().startswith("Blend"))
        return label.text()

    assert told() == "Blend with a selected pose"
    click(strip.examples, names(strip.examples).index("Shape 4"))
    assert told() == "Blend with Shape 4"
    strip.blend.setFocus()
    wait_for(strip.blend.hasFocus, app.processEvents)
    hand("key", "End")
    assert told() == "Blend with Shape 4: 100 %"
    for _ in range(10):
        hand("key", "Left")
    assert told() == f"Blend with Shape 4: {strip.blend.value() / 10:.0f} %"
    assert 0 < strip.blend.value() < 1000
    hand("key", "Home")
    assert told() == "Blend with Shape 4"


def test_copy_and_paste_go_through_the_clipboard(app, window, strip):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    row = names(strip.examples).index("Shape 2")
    click(strip.examples, row)
    QTest.keyClick(strip.examples, Qt.Key.Key_C, Qt.KeyboardModifier.ControlModifier)
    assert "Shape 2" in app.clipboard().text()
    window.menus.items["paste-pose"].trigger()
    rest(app, window)
    np.testing.assert_allclose(window.editor.code, strip.examples.poses[row].code)
    app.clipboard().setText("something else")
    window.menus.items["paste-pose"].trigger()
    assert "holds no pose" in window.notices.mistake.text
    window.menus.items["copy-pose"].trigger()
    window.editor.prior.reset()
    rest(app, window)
    window.menus.items["paste-pose"].trigger()
    rest(app, window)
    np.testing.assert_allclose(window.editor.code, strip.examples.poses[row].code)


def raise_by_tab(app, window, hand, title):
    """Click the tab of a dock below the picture."""
    from PySide6.QtWidgets import QDockWidget, QTabBar

    bars = [bar for bar in window.findChildren(QTabBar) if bar.parent() is window]
    bar, n = next((b, k) for b in bars for k in range(b.count()) if b.tabText(k) == title)
    hand(*over(bar, bar.tabRect(n).center()), "click", "1")
    dock = window.findChild(QDockWidget, title)
    wait_for(lambda: not dock.visibleRegion().isEmpty(), app.processEvents)


def over(widget, at):
    """Words for xdotool: the mouse to a point of a widget."""
    x, y = widget.mapToGlobal(at).toTuple()
    return "mousemove", str(x), str(y)


def test_a_list_that_another_dock_covers_takes_no_key(app, window, strip, hand):
    from PySide6.QtCore import Qt

    place(window, 100)
    save_pose(window.editor)
    window.editor.timeline.keys.set()  # the timeline comes before the strip
    rest(app, window)
    for back_by_tab_key in (False, True):
        raise_by_tab(app, window, hand, "Poses")
        at = strip.saved.visualItemRect(strip.saved.item(0)).center()
        hand(*over(strip.saved.viewport(), at), "click", "1")
        wait_for(strip.saved.hasFocus, app.processEvents)
        raise_by_tab(app, window, hand, "Timeline")
        if back_by_tab_key:
            strip.saved.setFocus(Qt.FocusReason.TabFocusReason)
        else:
            assert window.plotter.hasFocus()
        hand("key", "ctrl+c")
        rest(app, window)
        assert window.notices.note.text.startswith("Copied the pose")
        hand("key", "Delete")
        rest(app, window)
        assert not window.editor.edit.handles and names(strip.saved) == ["Pose 1"]
        window.act("undo")
        rest(app, window)


def test_of_many_examples_a_few_are_shown_first(app, window, strip, tmp_path):
    from dataclasses import replace

    model = window.editor.model
    rng = np.random.default_rng(0)
    codes = np.concatenate([model.codes] * 20)[:200] + 0.01 * rng.normal(size=(200, 6))
    many = replace(model, codes=codes, split={"train": list(range(200)), "test": []})
    many.save(tmp_path / "many")
    window.editor.open_model(tmp_path / "many")
    wait_for(lambda: window.editor.activations is not None and window.idle, app.processEvents)
    assert strip.examples.count() == 26 and strip.every.isVisibleTo(strip)
    few = {pose.code for pose in strip.examples.poses[2:]}
    spread = np.array(list(few))
    gaps = np.linalg.norm(codes[:, None] - spread, axis=2).min(axis=1)
    assert gaps.max() < np.linalg.norm(codes - codes.mean(axis=0), axis=1).max()
    strip.every.click()
    assert strip.examples.count() == 202
    rest(app, window)
    assert len(window.thumbnails._cache) < 150, "only what is seen has been drawn"
    strip.every.click()
    assert strip.examples.count() == 26


def test_a_press_on_the_groove_blends_in_one_step(app, window, strip, hand):
    click(strip.examples, names(strip.examples).index("Shape 4"))
    rest(app, window)
    steps = len(window.editor.session.entries)
    inside = strip.blend.rect().center()
    inside.setX(strip.blend.width() - 4)
    at = window.plotter.mapFromGlobal(strip.blend.mapToGlobal(inside)).toTuple()
    hand(at, "mousedown", "1")
    rest(app, window)
    assert len(window.editor.session.entries) == steps
    hand("mouseup", "1")
    rest(app, window)
    assert [entry.label for entry in window.editor.session.entries[steps:]] == [
        "Blend with Shape 4"
    ]
    assert strip.blend.value() > 900
    hand("click", "3", "key", "Left")  # the right button takes hold of nothing
    wait_for(lambda: len(window.editor.session.entries) == steps + 2, app.processEvents)
    window.act("undo")
    window.act("undo")
    rest(app, window)
    assert strip.blend.value() == 0 and window.editor.session.entry.label == "Start"


@pytest.mark.parametrize("size", [(1280, 800), (800, 560)])
def test_the_slider_of_a_blend_stays_where_it_is(app, window, strip, size):
    from PySide6.QtCore import QPoint

    def place():
        rest(app, window)
        app.processEvents()  # the layout follows
        return strip.blend.mapTo(window, QPoint()), strip.blend.size()

    window.resize(*size)
    before = place()
    save_pose(window.editor, "the arms far above the head, as before a leap")
    for shown, row in ((strip.examples, 0), (strip.examples, 3), (strip.saved, 0)):
        rest(app, window)
        click(shown, row)
        assert place() == before
        strip.blend.setValue(350)  # its label has a number then
        assert place() == before


def test_saved_poses_are_found_again_in_the_session(app, window, strip, tmp_path):
    save_pose(window.editor, "reach")
    rest(app, window)
    assert window.isWindowModified()
    window.editor.save_session(tmp_path / "s.json")
    window.open_session(tmp_path / "s.json")
    wait_for(lambda: window.editor.activations is not None and window.idle, app.processEvents)
    assert names(strip.saved) == ["reach"]
