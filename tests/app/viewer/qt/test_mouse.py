"""Mouse and keys in the Qt window: what Qt, X and a person do between press and release."""

import numpy as np
import pytest

from deformer_app.viewer.actions import ACTIONS
from deformer_app.viewer.model_files import start_codes
from deformer_app.viewer.stage import Hover
from off_screen_editor import seen
from person import rest
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


def middle(window):
    """A pixel of the picture where the middle of the tube is seen."""
    return np.floor(seen(window.editor, 0.5)[1]).astype(int)


def labels(window):
    return [entry.label for entry in window.editor.session.entries]


def test_a_person_turns_the_view_during_a_drag_and_releases_in_any_order(app, window, hand):
    rest(app, window)
    editor, at = window.editor, middle(window)
    hand(at, "mousedown", "1", np.add(at, (10, -10)), np.add(at, (20, -20)))
    wait_for(lambda: editor.edit.handles, app.processEvents)
    camera = editor.state.camera
    hand("mousedown", "3", np.add(at, (40, -10)), np.add(at, (60, 0)))
    wait_for(lambda: editor.state.camera != camera, app.processEvents)
    hand("click", "4")
    hand("mouseup", "1")
    wait_for(lambda: labels(window) == ["Start", "Place and drag"], app.processEvents)
    target = editor.edit.handles[0].centre
    hand(np.add(at, (80, 10)), "mouseup", "3", np.add(at, (100, 40)))
    wait_for(lambda: not editor.dragging, app.processEvents)
    rest(app, window)
    assert editor.edit.handles[0].centre == target and len(labels(window)) == 2


def test_a_release_in_another_window_ends_the_drag(app, window, hand):
    """A dialog that opens during a drag gets the release; the next move tells of it."""
    from PySide6.QtWidgets import QMessageBox

    rest(app, window)
    editor, at = window.editor, middle(window)
    hand(at, "mousedown", "1", np.add(at, (15, -15)), np.add(at, (30, -25)))
    wait_for(lambda: editor.edit.handles, app.processEvents)
    dialog = QMessageBox(window)
    dialog.open()
    wait_for(dialog.isVisible, app.processEvents)
    hand("mouseup", "1")
    dialog.close()
    target = editor.edit.handles[0].centre
    hand(np.add(at, (60, 30)), np.add(at, (64, 34)))
    wait_for(lambda: not editor.dragging, app.processEvents)
    rest(app, window)
    assert labels(window) == ["Start", "Place and drag"]
    assert editor.edit.handles[0].centre == target


def placed_arrow(app, window, hand):
    """Place a handle; the pixel of the tip of its manipulator's y axis."""
    rest(app, window)
    editor = window.editor
    hand(middle(window), "click", "1")
    wait_for(lambda: editor.edit.handles, app.processEvents)
    rest(app, window)
    gizmo, camera, size = editor.stage.gizmo, editor.state.camera, editor.stage.size
    tip = np.floor(camera.project(gizmo.outline("y", camera, size), size)[-1]).astype(int)
    return tip


def test_the_status_bar_says_what_is_under_a_mouse_that_is_still(app, window, hand):
    editor, tip = window.editor, placed_arrow(app, window, hand)
    hand(tip)
    wait_for(lambda: "Drag along this part" in window._hint.text(), app.processEvents)
    hand("key", "Delete")
    wait_for(lambda: not editor.edit.handles, app.processEvents)
    rest(app, window)
    assert "Drag along this part" not in window._hint.text()
    hand("key", "ctrl+z")
    wait_for(lambda: editor.edit.handles, app.processEvents)
    rest(app, window)
    assert "Drag along this part" in window._hint.text(), "the manipulator is there again"
    hand("key", "2")
    wait_for(lambda: editor.state.manipulator.mode == "rotate", app.processEvents)
    rest(app, window)
    assert editor.state.hovered.part != "y", "a part of the manipulator that moves"


def test_what_is_under_a_still_mouse_is_found_again_after_keys_of_the_view_and_the_pose(
    app, window, hand
):
    rest(app, window)
    editor, at = window.editor, middle(window)
    hand(at)

    def under():
        """The vertex under the mouse, as the picture says, once it is highlighted."""
        rest(app, window)
        vertex = editor.stage.vertex_at(np.add(at, 0.5))  # the middle of the pixel
        assert editor.state.hovered.vertex == vertex and f"Vertex {vertex}:" in window._hint.text()
        return vertex

    front = under()
    hand("key", "ctrl+3")  # from the back
    back = under()
    assert back != front
    editor.prior.start_from("Shape 4", start_codes(editor.model)["Shape 4"])
    bent = under()
    hand("key", "ctrl+z")
    assert under() == back != bent


def test_what_is_under_a_still_mouse_is_found_again_after_the_wheel(app, window, hand):
    rest(app, window)
    editor, at = window.editor, middle(window)
    while editor.stage.vertex_at(at) is not None:
        at = np.add(at, (0, -2))
    at = np.add(at, (0, -12))  # above the tube, of which nothing is near
    hand(at)
    rest(app, window)
    assert editor.state.hovered == Hover()
    hand(*["click", "5"] * 20)  # away
    rest(app, window)
    vertex = editor.stage.vertex_at(np.add(at, 0.5))
    assert vertex is not None and editor.state.hovered.vertex == vertex


def test_a_person_types_a_distance_and_the_keys_do_nothing_else(app, window, hand):
    editor, tip = window.editor, placed_arrow(app, window, hand)
    before = editor.edit.handles[0].centre
    hand(tip, "mousedown", "1", np.add(tip, (0, -12)), np.add(tip, (0, -20)))
    wait_for(lambda: editor.controller.takes_numbers, app.processEvents)
    hand("key", "4", "key", "BackSpace", "key", "minus", "key", "period", "key", "5")
    goal = np.add(before, (0.0, -0.5, 0.0))
    wait_for(lambda: np.allclose(editor.edit.handles[0].centre, goal), app.processEvents)
    hand("key", "Return")
    wait_for(lambda: not editor.dragging, app.processEvents)
    hand(np.add(tip, (0, 30)), "mouseup", "1")
    rest(app, window)
    assert labels(window) == ["Start", "Place handle", "Move"]
    np.testing.assert_allclose(editor.edit.handles[0].centre, goal, atol=1e-12)
    assert editor.state.manipulator.axes == "world", "4 and 5 would have changed them"
    hand("key", "5")
    wait_for(lambda: editor.state.manipulator.axes == "surface", app.processEvents)


def test_buttons_end_their_own_drags_whatever_qt_reports_last(app, window):
    from PySide6.QtCore import QPoint, Qt
    from PySide6.QtTest import QTest

    rest(app, window)
    at, left, right = middle(window), Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton

    def send(what, button, offset):
        pixel = QPoint(*(int(c) for c in np.add(at, offset)))
        what(window.plotter, button, Qt.KeyboardModifier.NoModifier, pixel)

    send(QTest.mousePress, left, (0, 0))
    send(QTest.mousePress, right, (0, 0))
    send(QTest.mouseRelease, left, (0, 0))
    send(QTest.mouseRelease, right, (0, 0))
    assert not window.editor.dragging and labels(window) == ["Start", "Place handle"]


def test_only_keys_of_the_actions_do_anything(app, window):
    """Every key of a keyboard, alone, with Shift and with Ctrl, over the picture."""
    from PySide6.QtCore import Qt
    from PySide6.QtGui import QKeySequence
    from PySide6.QtTest import QTest

    rest(app, window)
    window.editor.handles.place(60)
    window.editor.commit("Place handle")
    rest(app, window)
    known = {QKeySequence(action.key).toString() for action in ACTIONS if action.key}
    # Other keys of other menus; and those that Qt itself moves the focus with.
    leave = {Qt.Key.Key_Escape, Qt.Key.Key_Tab, Qt.Key.Key_Backtab, Qt.Key.Key_Alt,
             Qt.Key.Key_Menu, Qt.Key.Key_F10}  # fmt: skip
    keys = [Qt.Key(code) for code in (*range(0x20, 0x7F), *range(0x01000000, 0x01000040))
            if code in Qt.Key._value2member_map_]  # fmt: skip
    none, plotter = Qt.KeyboardModifier.NoModifier, window.plotter
    modifiers = (none, Qt.KeyboardModifier.ShiftModifier, Qt.KeyboardModifier.ControlModifier)

    def state():
        editor, lens = window.editor, plotter.renderer.GetActiveCamera()
        look = editor.state.view.surface.actor.GetProperty()
        return (
            editor.edit, editor.handles.selected, editor.state.look, editor.state.camera,
            editor.state.tool, editor.state.manipulator.mode, editor.state.manipulator.axes,
            editor.stage.brush.radius, labels(window), window.isVisible(), plotter.isVisible(),
            lens.GetPosition(), lens.GetFocalPoint(), lens.GetViewUp(), lens.GetViewAngle(),
            look.GetRepresentation(), look.GetPointSize(), look.GetLineWidth(),
        )  # fmt: skip

    before, pressed = state(), 0
    for key in keys:
        for modifier in modifiers:
            if key in leave or QKeySequence(modifier.value | key.value).toString() in known:
                continue
            QTest.keyClick(plotter, key, modifier)
            pressed += 1
            assert state() == before, f"{key.name} with {modifier}"
    assert pressed > 150
