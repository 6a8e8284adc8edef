"""The Qt window on a virtual display: docks, dialogs, and a real mouse."""

import sys

import numpy as np
import pytest

import deformer
from contrast import contrast
from deformer_app.viewer.actions import ACTIONS
from number_fields import type_centre, type_height
from person import place, rest
from shapes import sequence
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


def test_what_cannot_be_done_is_disabled_and_a_recording_changes_its_title(app, window):
    items = window.menus.items
    rest(app, window)
    assert not items["undo"].isEnabled() and not items["redo"].isEnabled()
    assert items["open-model"].isEnabled() and items["delete"].isEnabled()
    place(window, 100)
    rest(app, window)
    assert items["undo"].isEnabled()
    items["undo"].trigger()
    assert items["redo"].isEnabled() and not items["undo"].isEnabled()
    items["record"].trigger()
    assert items["record"].text() == "Stop recording" and window.recording


def test_every_action_has_a_menu_entry_and_no_key_is_given_twice(window):
    items = window.menus.items
    assert list(items) == [action.id for action in ACTIONS]
    keys = [key.toString() for item in items.values() for key in item.shortcuts()]
    assert len(keys) == len(set(keys)) > 20
    assert all(item.text() for item in items.values())


@pytest.mark.parametrize("key", ["ctrl+shift+z", "ctrl+y"])
def test_both_usual_keys_redo(app, window, hand, key):
    rest(app, window)
    place(window, 100)
    window.editor.undo()
    rest(app, window)
    hand("key", key, "w")  # the second key comes after the first one has been served
    wait_for(window.menus.items["wireframe"].isChecked, app.processEvents)
    assert [handle.vertices for handle in window.editor.edit.handles] == [(100,)]
    assert window.menus.items["redo"].shortcut().toString() == "Ctrl+Shift+Z"


def test_names_of_handles_keep_their_room(app, window):
    from PySide6.QtWidgets import QTableWidgetItem

    from deformer_app.viewer.qt.handle_table import HandleTable

    table = HandleTable()
    table.setRowCount(1)
    for column, text in enumerate(("Bottom 2234", "soft", "1", "0.83 %, 12°")):
        table.setItem(0, column, QTableWidgetItem(text))
    table.show()
    table.resize(600, 100)
    app.processEvents()
    assert not table.isColumnHidden(2)
    name = table.sizeHintForColumn(0)
    needed = [max(table.sizeHintForColumn(n), table.horizontalHeader().sectionSizeHint(n))
              for n in range(4)]  # fmt: skip
    assert table.columnWidth(1) == needed[1] and table.columnWidth(0) > 2 * name
    frame = table.width() - table.viewport().width()
    table.resize(sum(needed) - needed[2] + frame + 8, 100)
    app.processEvents()
    assert table.isColumnHidden(2) and table.columnWidth(0) >= name
    table.resize(sum(needed) + frame + 8, 100)
    app.processEvents()
    assert not table.isColumnHidden(2) and table.columnWidth(0) >= name
    # Digits that come and go while a clip plays take no column along.
    for width in range(180, 320, 4):
        table.resize(width, 100)
        hidden = []
        for off in ("0.03 %", "0.83 %", "11.11 %", "24.88 %"):
            table.item(0, 3).setText(off)
            table.fit()
            hidden.append(table.isColumnHidden(2))
        assert len(set(hidden)) == 1
    table.close()


def test_escape_gives_up_an_animation_and_the_window_tells_its_progress(app, window, tmp_path):
    from deformer_app.viewer.recording import save_turntable

    window.editor.run(save_turntable(window.editor, tmp_path / "turn.gif"))
    wait = window.notices.wait
    wait_for(lambda: "turn.gif: frame 2 of" in wait.text, app.processEvents)
    assert not wait.isHidden()
    window.escape()
    rest(app, window)
    assert not window.editor.filming.running and wait.isHidden()
    assert not (tmp_path / "turn.gif").exists() and "given up" in window.notices.note.text


def test_without_a_selected_handle_there_are_no_coordinates(app, window):
    from deformer_app.viewer.qt.handle_panel import HandlePanel

    place(window, 100)
    rest(app, window)
    boxes = window.docks.panel(HandlePanel).coordinates
    assert all(box.text().strip() for box in boxes)
    window.editor.handles.select([])
    rest(app, window)
    assert not any(box.text().strip() for box in boxes)
    window.editor.handles.select_all()
    rest(app, window)
    centre = window.editor.edit.handles[0].centre
    assert [box.value() for box in boxes] == pytest.approx(centre, abs=1e-4)


def test_a_pin_has_coordinates_that_cannot_be_typed(app, window):
    from deformer_app.viewer.qt.handle_panel import HandlePanel

    boxes = window.docks.panel(HandlePanel).coordinates
    place(window, 100)
    rest(app, window)
    assert all(box.isEnabled() for box in boxes)
    window.editor.handles.set_kind("pin")
    rest(app, window)
    assert not any(box.isEnabled() for box in boxes)
    assert all(box.text().strip() and "S makes it movable" in box.toolTip() for box in boxes)
    window.editor.handles.set_kind("soft")
    rest(app, window)
    assert all(box.isEnabled() and not box.toolTip() for box in boxes)


def test_docks_show_what_is_selected_and_numbers_move_it(app, window):
    from deformer_app.viewer.qt.handle_panel import HandlePanel

    place(window, 100, 60)
    rest(app, window)
    panel = window.docks.panel(HandlePanel)
    assert panel.table.rowCount() == 2
    panel.table.selectRow(0)
    assert len(window.editor.handles.selected) == 1
    rest(app, window)
    before = window.editor.edit.handle(next(iter(window.editor.handles.selected))).centre
    panel.coordinates[1].setValue(before[1] + 0.3)
    rest(app, window)
    after = window.editor.edit.handle(next(iter(window.editor.handles.selected))).centre
    assert after[1] == pytest.approx(before[1] + 0.3, abs=1e-4)
    assert after[0] == pytest.approx(before[0], abs=1e-4)
    assert "%" in panel.table.item(0, 3).text()


def test_a_handle_under_the_floor_is_off_the_place_where_it_acts(app, window):
    from deformer_app.viewer.qt.handle_panel import HandlePanel

    place(window, 115)
    window.editor.handles.set_kind("exact")
    rest(app, window)
    (handle,) = window.editor.edit.handles
    size = window.editor.model.reference.bounding_diagonal
    type_height(window.editor, handle.centre[1] + 0.05 * size)
    rest(app, window)
    assert window.docks.panel(HandlePanel).table.item(0, 3).text() == "0.00 %"


def test_a_handle_is_renamed_in_the_table_and_a_taken_name_is_told(app, window):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QLineEdit

    from deformer_app.viewer.qt.handle_panel import HandlePanel

    place(window, 100, 60)
    rest(app, window)
    table = window.docks.panel(HandlePanel).table

    def rename(row, name):
        table.setFocus()
        table.setCurrentCell(row, 0)
        QTest.keyClick(table, Qt.Key.Key_F2)
        field = table.viewport().findChild(QLineEdit)
        QTest.keyClicks(field, name)
        QTest.keyClick(field, Qt.Key.Key_Return)
        wait_for(lambda: table.viewport().findChild(QLineEdit) is None, app.processEvents)
        rest(app, window)

    rename(0, "left foot")
    assert table.item(0, 0).text() == "left foot" == window.editor.edit.handles[0].name
    assert "left foot" in dict(window.editor.timeline.rows).values()
    other = table.item(1, 0).text()
    rename(1, "left foot")
    assert "another handle has this name" in window.notices.mistake.text
    assert table.item(1, 0).text() == other and not window.editor.edit.handles[1].name
    window.menus.items["undo"].trigger()
    rest(app, window)
    assert table.item(0, 0).text().endswith(" 100")


def test_a_slider_of_a_component_moves_the_mesh(app, window):
    from deformer_app.viewer.qt.component_panel import ComponentPanel

    rest(app, window)
    known = window.editor.activations
    k = int(known.order[0])
    slider = wait_for(lambda: window.docks.panel(ComponentPanel).sliders.get(k), app.processEvents)
    before = window.editor.vertices.copy()
    slider.setValue(slider.maximum())
    rest(app, window)
    assert window.editor.code[k] == pytest.approx(known.extreme[k], abs=1e-6)
    assert np.abs(window.editor.vertices - before).max() > 0.01
    window.menus.items["undo"].trigger()
    rest(app, window)
    np.testing.assert_allclose(window.editor.vertices, before, atol=1e-6)
    assert slider.value() < slider.maximum()


def test_the_dial_of_the_prior_decides_how_far_a_handle_is_followed(app, window):
    from deformer_app.viewer.qt.model_panel import ModelPanel

    place(window, 115)
    x, y, z = window.editor.edit.handles[0].centre
    type_centre(window.editor, [x + 0.2, y + 0.8, z + 0.6])
    off = []
    for position in (0, 1000):
        window.docks.panel(ModelPanel).prior.setValue(position)
        rest(app, window)
        off.append(float(window.editor.answer.pose.residual[0]))
    assert off[0] < 0.5 * off[1]


def test_how_far_a_pose_is_off_is_blank_while_another_model_is_being_prepared(
    app, window, model_path
):
    from deformer_app.viewer.qt.model_panel import ModelPanel

    panel = window.docks.panel(ModelPanel)
    rest(app, window)
    assert panel._meter.text().endswith("% of examples")
    window.editor.open_model(model_path)
    panel.refresh()
    assert window.editor.preparing and panel._meter.text() == "…" == panel._error.text()
    wait_for(lambda: not window.editor.preparing, app.processEvents)
    panel.refresh()
    assert panel._meter.text().endswith("% of examples")


@pytest.mark.parametrize("dark", [False, True])
def test_how_far_a_pose_is_off_is_read_on_the_red_bar(app, window, dark):
    from dataclasses import replace

    from deformer_app.rendering.palette import BAD, rgb
    from deformer_app.viewer.qt.model_panel import ModelPanel

    window.choose_theme(dark)
    rest(app, window)
    panel = window.docks.panel(ModelPanel)
    panel._show_answer(replace(window.editor.answer, off_data=440.0))
    assert panel._meter.text() == "4.4 × the farthest"
    image = panel._meter.grab().toImage()
    middle = range(image.width() // 4, 3 * image.width() // 4)
    pixels = [image.pixelColor(x, y).getRgb()[:3] for x in middle for y in range(image.height())]
    assert max(contrast(pixel, rgb(BAD)) for pixel in set(pixels)) > 4.0


def test_a_mistake_is_a_line_in_the_window_and_nothing_is_lost(app, window, tmp_path):
    window.open_session(tmp_path / "missing.json")
    told = window.notices.mistake
    assert not told.isHidden() and "missing.json" in told.text
    assert window.editor.is_open
    window.escape()
    assert told.isHidden()
    place(window, 100)
    window.attempt(lambda: window.editor.picture.load_target(tmp_path / "none.ply"))
    assert "none.ply" in told.text
    assert len(window.editor.edit.handles) == 1


def test_closing_asks_only_if_something_would_be_lost(app, window, monkeypatch, tmp_path, answers):
    assert window.may_leave() and not answers.asked
    place(window, 100)
    answers.append("Cancel")
    assert not window.may_leave() and len(answers.asked) == 1
    file = tmp_path / "work.json"
    monkeypatch.setattr(window, "ask_save", lambda *_: file)
    answers.append("Save")
    assert window.may_leave() and file.is_file()
    assert window.may_leave() and len(answers.asked) == 2
    assert window.settings.recent[0] == str(file)


def test_training_opens_its_model_and_can_be_cancelled(app, window, tmp_path):
    deformer.save_shapes(tmp_path / "shapes.npz", sequence())
    dialog = window.train()
    dialog.choose(tmp_path / "shapes.npz")
    dialog.components.setValue(3)
    dialog.epochs.setValue(100_000)
    dialog.start_button.click()
    wait_for(lambda: dialog.stage == "training", app.processEvents)
    dialog.cancel()
    wait_for(lambda: not dialog.training, app.processEvents)
    assert "Cancelled" in dialog.status.text() and not (tmp_path / "shapes-model").exists()
    dialog.epochs.setValue(3)
    dialog.start_button.click()
    wait_for(
        lambda: dialog.ended and window.editor.is_open and not window.editor.preparing,
        app.processEvents,
    )
    assert window.editor.model.components == 3
    assert window.editor.session.model.path == str((tmp_path / "shapes-model").resolve())


def test_a_folder_of_shapes_is_offered_for_training(app, window, tmp_path, answers):
    answers.append("Train…")
    folder = tmp_path / "walk"
    deformer.save_shapes(folder, sequence(3))
    window.open_model(folder)
    assert window.training.isVisible()
    assert window.training.shapes.text() == str(folder)
    assert window.training.output.text() == str(tmp_path / "walk-model")


def test_a_model_that_has_lost_a_file_is_told_and_not_offered_for_training(
    app, window, tmp_path, answers
):
    window.editor.model.save(tmp_path / "part")
    (tmp_path / "part" / "model.json").unlink()
    window.open_model(tmp_path / "part")
    assert not answers.asked
    assert "model.json" in window.notices.mistake.text


def test_training_on_nonsense_is_told_in_the_dialog(app, window, tmp_path):
    dialog = window.train()
    dialog.choose(tmp_path / "nothing.npz")
    dialog.start_button.click()
    wait_for(lambda: not dialog.training, app.processEvents)
    assert "nothing.npz" in dialog.status.text()


def test_a_long_mistake_squashes_no_field_of_the_training_dialog(app, window, tmp_path):
    dialog = window.train()
    dialog.choose(tmp_path / ("a very long name of a folder " * 7) / "nothing.npz")
    app.processEvents()
    before = dialog.shapes.height()
    dialog.start_button.click()
    wait_for(lambda: not dialog.training, app.processEvents)
    app.processEvents()
    assert dialog.status.height() >= dialog.status.heightForWidth(dialog.status.width())
    assert dialog.shapes.height() == before >= dialog.shapes.minimumSizeHint().height()
    dialog.hide()


def test_the_status_bar_shows_a_training_in_the_background(app, window, tmp_path):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    from deformer_app.viewer.qt.training_bar import TrainingBar

    bar = window.findChild(TrainingBar)
    deformer.save_shapes(tmp_path / "shapes.npz", sequence())
    dialog = window.train()
    dialog.choose(tmp_path / "shapes.npz")
    dialog.epochs.setValue(100_000)
    assert bar.isHidden()
    dialog.start_button.click()
    assert dialog.hide_button.isVisible() and not dialog.start_button.isVisible()
    dialog.hide_button.click()
    assert not dialog.isVisible()
    wait_for(lambda: bar.isVisible() and bar.percent > 0, app.processEvents)
    QTest.mouseClick(bar, Qt.MouseButton.LeftButton)
    assert dialog.isVisible()
    dialog.cancel_button.click()
    wait_for(lambda: not dialog.training, app.processEvents)
    assert bar.isHidden() and dialog.start_button.isVisible()
    dialog.hide()


def test_components_suit_the_shapes_unless_the_user_chooses(app, window, tmp_path):
    from deformer_app.viewer.training_advice import comment, suggested_components

    assert [suggested_components(n) for n in (2, 12, 200)] == [4, 24, 50]
    assert comment(24, 12) == "" and "24" in comment(50, 12)
    deformer.save_shapes(tmp_path / "shapes.npz", sequence(3))
    dialog = window.train()
    dialog.choose(tmp_path / "shapes.npz")
    dialog.epochs.setValue(2)
    dialog.start_button.click()
    wait_for(lambda: dialog.ended and not window.editor.preparing, app.processEvents)
    assert window.editor.model.components == 6


def test_qt_gives_back_what_it_takes(app):
    """PySide6 6.12.0 took a reference to None with every call, until Python 3.11 ended."""
    from PySide6.QtCore import QObject

    thing = QObject()
    before = sys.getrefcount(None)
    for _ in range(1000):
        thing.setObjectName("x")
    assert abs(sys.getrefcount(None) - before) < 100


def test_about_tells_version_licences_and_the_model(app, window):
    from importlib.metadata import version

    from PySide6.QtWidgets import QLabel, QTextBrowser

    from deformer_app.viewer.qt.about_dialog import AboutDialog

    window.menus.items["about"].trigger()
    dialog = window.findChild(AboutDialog)
    assert dialog.isVisible()
    assert any(version("deformer") in label.text() for label in dialog.findChildren(QLabel))
    pages = [page.toPlainText() for page in dialog.findChildren(QTextBrowser)]
    assert any("tube" in page and "components" in page for page in pages)
    assert any("ISC License" in page for page in pages)
    dialog.close()


def test_only_what_is_compiled_is_said_to_be_compiled(app, window, monkeypatch):
    from types import SimpleNamespace

    editor, strip = SimpleNamespace(preparing=True), window.notices.preparing
    strip.follow(editor)
    wait_for(lambda: not strip.isHidden(), app.processEvents)
    assert "Compiling" not in strip.text
    monkeypatch.setattr("deformer.compiling", lambda: True)
    wait_for(lambda: "Compiling" in strip.text, app.processEvents)
    editor.preparing = False
    wait_for(strip.isHidden, app.processEvents)


def test_shift_and_the_wheel_over_a_pin_change_its_size_without_a_move(app, window):
    from PySide6.QtCore import QPoint, QPointF, Qt
    from PySide6.QtGui import QWheelEvent

    editor = window.editor
    place(window, 100)
    editor.handles.set_kind("pin")
    rest(app, window)
    (before,) = editor.edit.handles
    at = editor.stage.camera.project(editor.vertices[[100]], editor.stage.size)[0]
    point = QPointF(*at[:2])
    assert editor.pins.at(editor.stage.vertex_at(at[:2]), editor.stage.handle_at(at[:2]))
    for keys in (Qt.KeyboardModifier.ShiftModifier, Qt.KeyboardModifier.NoModifier):
        turned = QWheelEvent(point, window.plotter.mapToGlobal(point), QPoint(0, 0), QPoint(0, 120),
                             Qt.MouseButton.NoButton, keys, Qt.ScrollPhase.NoScrollPhase,
                             False)  # fmt: skip
        app.sendEvent(window.plotter, turned)
        (after,) = editor.edit.handles
        assert after.radius > before.radius  # and the wheel alone zooms
    assert editor.session.entry.label == "Resize pin"


def test_an_answer_that_comes_as_the_window_closes_is_not_drawn(app, window):
    """The solver's thread sends it: Qt may deliver it after the picture has been freed."""
    window.close_unsaved()
    window._wake.called.emit()
    app.processEvents()
    assert not window._timer.isActive()
