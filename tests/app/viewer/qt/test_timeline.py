"""The timeline's dock with a real mouse and real keys."""

from functools import partial

import numpy as np
import pytest

from person import place, rest
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


def test_a_press_on_a_key_selects_it_and_a_drag_moves_it(app, window, panel, keyed, mouse):
    rows, first = panel.rows, window.editor.edit.handles[0].id
    start = rows.position((first, 20))
    mouse.click(rows, start)
    assert keyed.selected == {(first, 20)}
    end = rows.position((first, 20))
    end.setX(end.x() + 7 * panel.scale.width)
    mouse.drag(rows, start, end)
    assert (first, 27) in keyed.clip.names and (first, 20) not in keyed.clip.names
    rest(app, window)
    assert keyed.fitted is not None
    window.menus.items["undo"].trigger()
    assert (first, 20) in keyed.clip.names


def test_a_box_selects_keys_and_the_key_of_the_menu_deletes_them(app, window, panel, keyed, mouse):
    from PySide6.QtCore import QPointF

    rows = panel.rows
    handles = [handle.id for handle in window.editor.edit.handles]
    low = rows.position((handles[0], 0)) - QPointF(9, 9)
    high = rows.position((handles[1], 0)) + QPointF(9, 9)
    mouse.drag(rows, low, high)
    assert keyed.selected == {(handles[0], 0), (handles[1], 0)}
    window.menus.items["delete-key"].trigger()
    assert keyed.clip.names == [(handles[0], 20)]
    mouse.click(rows, high + QPointF(60, 0))
    assert keyed.selected == frozenset()


def test_a_name_selects_its_handle(window, panel, keyed, mouse):
    from PySide6.QtCore import QPointF

    second = window.editor.edit.handles[1].id
    at = panel.rows.position((second, 0))
    mouse.click(panel.rows, QPointF(20, at.y()))
    assert window.editor.handles.selected == {second}


def test_the_row_of_a_handle_that_is_selected_comes_into_sight(app, window, panel):
    from PySide6.QtCore import QPoint

    place(window, *range(0, 120, 8))
    window.editor.handles.select_all()
    window.editor.timeline.keys.set()
    rest(app, window)
    handles = [handle.id for handle in window.editor.edit.handles]

    def in_sight(handle):
        middle = QPoint(10, round(panel.rows.middle(handle)))
        return panel.rows.visibleRegion().contains(middle)

    for handle in (handles[-1], handles[0]):
        assert not all(in_sight(h) for h in handles)
        window.editor.handles.select([handle])
        wait_for(partial(in_sight, handle), app.processEvents)


def test_the_ruler_scrubs_and_the_window_shows_the_fitted_frame(app, window, panel, keyed, mouse):
    from PySide6.QtCore import QPointF

    ruler = panel.ruler
    mouse.drag(ruler, QPointF(ruler.pixel(20), 8), QPointF(ruler.pixel(10), 8))
    assert keyed.frame == 10 and panel.frame.value() == 10
    np.testing.assert_array_equal(window.editor.vertices, keyed.fitted.vertices[10])
    shown = window.editor.edit.handles[0].targets
    assert shown == keyed.clip.at(window.editor.edit, 10).handles[0].targets
    rest(app, window)  # the pose of that frame, relaxed to its end
    diagonal = window.editor.model.reference.bounding_diagonal
    assert np.abs(window.editor.vertices - keyed.fitted.vertices[10]).max() < 2e-2 * diagonal


def test_keys_of_the_keyboard_step_key_and_play(app, window, panel, keyed):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    window.activateWindow()
    window.plotter.setFocus()
    wait_for(lambda: window.isActiveWindow(), app.processEvents)
    key, control = Qt.Key, Qt.KeyboardModifier.ControlModifier

    def press(name, modifier=Qt.KeyboardModifier.NoModifier):
        QTest.keyClick(window, name, modifier)
        app.processEvents()

    press(key.Key_Right)
    assert keyed.frame == 21
    press(key.Key_Left)
    press(key.Key_Left)
    assert keyed.frame == 19
    press(key.Key_Right, control)
    assert keyed.frame == 20
    press(key.Key_Left, control)
    assert keyed.frame == 0
    press(key.Key_Right)
    press(key.Key_K)
    assert {name for name in keyed.clip.names if name[1] == 1}
    press(key.Key_Space)
    assert keyed.playing
    wait_for(lambda: keyed.frame > 4, app.processEvents)
    press(key.Key_Space)
    assert not keyed.playing


def test_a_slider_with_the_focus_keeps_the_arrows(app, window, panel, keyed):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    from deformer_app.viewer.qt.component_panel import ComponentPanel

    slider = next(iter(window.docks.panel(ComponentPanel).sliders.values()))
    frame, value = keyed.frame, slider.value()
    window.activateWindow()
    slider.setFocus()
    wait_for(slider.hasFocus, app.processEvents)
    QTest.keyClick(slider, Qt.Key.Key_Right)
    # A slider shows the pose, so it is back at its old value until the new pose is there.
    wait_for(lambda: slider.value() != value, app.processEvents)
    assert keyed.frame == frame


def test_the_play_button_plays_in_real_time(app, window, panel, keyed, mouse):
    from PySide6.QtCore import QPointF

    keyed.seek(0)
    mouse.click(panel.buttons.play, QPointF(5, 5))
    assert keyed.playing
    seen = set()
    wait_for(lambda: seen.add(keyed.frame) or len(seen) > 3, app.processEvents)
    mouse.click(panel.buttons.play, QPointF(5, 5))
    assert not keyed.playing
    rest(app, window)


def test_a_click_on_the_ruler_or_the_rows_takes_the_focus_from_a_field(
    app, window, panel, keyed, hand
):
    from PySide6.QtCore import QPoint

    for widget in (panel.ruler, panel.rows):
        panel.frame.setFocus()
        wait_for(panel.frame.hasFocus, app.processEvents)
        at = widget.mapToGlobal(QPoint(round(panel.ruler.pixel(10)), 6)).toTuple()
        hand("mousemove", *map(str, at), "click", "1")
        wait_for(lambda: not panel.frame.hasFocus(), app.processEvents)
        frame = keyed.frame
        hand("key", "Right")
        assert keyed.frame == frame + 1, "the arrow is the timeline's"


def test_fields_change_the_clip_as_steps(app, window, panel, keyed):
    panel.length.setValue(60)
    panel.rate.setCurrentIndex(0)
    panel.rate.activated.emit(0)
    assert (keyed.clip.length, keyed.clip.fps) == (60, 12)
    panel.length.setValue(5)
    assert keyed.clip.length == 21  # not shorter than the keys
    panel.frame.setValue(3)
    assert keyed.frame == 3
    rest(app, window)
    assert panel.length.value() == 21


def test_onion_skins_are_ghosts_of_neighbouring_frames(app, window, panel, keyed):
    ghosts = window.editor.state.view.ghosts
    panel.onion.before.setValue(2)
    panel.onion.after.setValue(1)
    rest(app, window)
    assert ghosts.names == {"onion-1", "onion-2", "onion+1"}
    keyed.seek(40)
    assert ghosts.names == {"onion-1", "onion-2"}
    keyed.play()
    app.processEvents()
    assert ghosts.names == set()
    keyed.stop()
    panel.onion.before.setValue(0)
    panel.onion.after.setValue(0)
    assert ghosts.names == set()


def test_the_progress_shows_while_the_clip_is_fitted_and_can_be_stopped(
    app, window, panel, keyed, mouse, monkeypatch
):
    from PySide6.QtCore import QPointF

    panel.length.setValue(4000)
    wait_for(lambda: keyed.progress is not None, app.processEvents)
    assert not panel.progress.isHidden()
    for done, text in ((0, "Fitting …"), (512, "512 of 4000")):
        with monkeypatch.context() as patch:
            patch.setattr(type(keyed), "progress", property(lambda _, n=done: (n, 4000)))
            panel.refresh()
        assert panel.progress.text() == text, "no number while none is counted"
    mouse.click(panel.cancel, QPointF(4, 4))
    wait_for(lambda: keyed.progress is None, app.processEvents)
    assert panel.progress.isHidden() and keyed.fitted is None


def test_the_table_shows_where_handles_are_while_the_playhead_moves(app, window, panel, keyed):
    """Also while a field has the focus in which nothing has been typed."""
    from PySide6.QtTest import QTest

    from deformer_app.viewer.qt.handle_panel import HandlePanel

    handles, editor = window.docks.panel(HandlePanel), window.editor
    editor.handles.select([editor.edit.handles[0].id])
    rest(app, window)
    window.activateWindow()
    box = handles.coordinates[1]
    box.setFocus()
    wait_for(box.hasFocus, app.processEvents)
    wait_for(lambda: keyed.fitted is not None and editor.idle, app.processEvents)
    shown = set()
    for frame in (0, 10, 20):
        keyed.seek(frame)
        rest(app, window)
        centre = editor.edit.handles[0].centre
        assert box.value() == pytest.approx(centre[1], abs=1e-4)
        assert handles.table.item(0, 3).text().startswith("0.00 %"), "exact handles are not off"
        shown.add(box.value())
    assert len(shown) == 3
    box.selectAll()
    QTest.keyClicks(box, "7")
    keyed.seek(0)
    rest(app, window)
    assert box.value() != pytest.approx(editor.edit.handles[0].centre[1]), "it is being typed into"


def test_old_mistakes_are_gone_once_the_clip_plays(app, window, keyed):
    window.notices.show_mistake("old")
    keyed.play()
    assert window.notices.mistake.isHidden()
    keyed.stop()


def test_controls_that_do_not_fit_are_reached_by_a_bar_below_them(app, window, panel, keyed, hand):
    """The bar says that there are more; it is gone where all fit."""
    from PySide6.QtCore import QPoint
    from PySide6.QtWidgets import QScrollArea

    area = next(a for a in panel.findChildren(QScrollArea) if a.isAncestorOf(panel.buttons.play))
    bar = area.horizontalScrollBar()

    def in_sight(widget):
        return widget.visibleRegion().boundingRect().width() == widget.width()

    window.resize(800, 560)
    wait_for(bar.isVisible, app.processEvents)
    assert in_sight(panel.buttons.play) and not in_sight(panel.onion)
    assert area.viewport().height() >= panel.frame.height(), "the bar covers no control"
    start, end = (
        window.plotter.mapFromGlobal(bar.mapToGlobal(QPoint(x, bar.height() // 2))).toTuple()
        for x in (10, bar.width() - 5)
    )
    hand(start, "mousedown", "1", end, "mouseup", "1")
    wait_for(lambda: in_sight(panel.onion), app.processEvents)
    window.resize(1280, 720)
    panel.window().findChild(type(panel.parentWidget()), "Handles").close()
    wait_for(lambda: not bar.isVisible() and in_sight(panel.buttons.play), app.processEvents)
    assert in_sight(panel.onion)


def test_no_row_is_cut_and_a_bar_shows_that_there_are_more(app, window, panel):
    from PySide6.QtCore import Qt

    from deformer_app.viewer.qt.timeline_rows import ROW

    place(window, *range(0, 120, 8))
    window.editor.handles.select_all()
    window.editor.timeline.keys.set()
    rest(app, window)
    area = panel.rows.parentWidget().parentWidget()
    seen = set()
    for height in range(220, 312, 13):
        window.resizeDocks([panel.parentWidget()], [height], Qt.Orientation.Vertical)
        app.processEvents()
        rows = area.viewport().height()
        assert rows % ROW == 0 and area.height() - rows < ROW
        assert area.verticalScrollBar().isVisible()
        seen.add(rows)
    assert len(seen) > 3
    bar = area.verticalScrollBar()
    bar.setSliderDown(True)
    bar.setValue(ROW + 7)
    bar.setSliderDown(False)
    assert bar.value() == ROW


def test_the_progress_of_a_fit_covers_nothing(app, window, panel, keyed, monkeypatch):
    from PySide6.QtCore import QRect

    def place_of(widget):
        return QRect(widget.mapTo(panel, widget.rect().topLeft()), widget.size())

    rest(app, window)
    controls = (panel.buttons.play, panel.frame, panel.smoothness, panel.onion)
    before = [place_of(widget) for widget in (*controls, panel.rows)]
    monkeypatch.setattr(type(keyed), "progress", property(lambda _: (128, 4000)))
    panel.refresh()
    app.processEvents()
    assert panel.progress.isVisible() and panel.cancel.isVisible()
    assert [place_of(widget) for widget in (*controls, panel.rows)] == before
    for shown in (panel.progress, panel.cancel):
        assert not any(place_of(shown).intersects(place_of(widget)) for widget in controls)
        assert place_of(shown).right() < panel.ruler.x() + panel.ruler.pixel(0) - 8
    text = panel.progress.fontMetrics().horizontalAdvance(panel.progress.text())
    assert text < panel.progress.width()
