"""The row of all keys, and the slim timeline in the dock of poses, with a real mouse and keys."""

from dataclasses import replace

import pytest

from deformer_app.viewer.timeline.keys import SLIDERS, Track
from person import place, rest
from waiting import wait_for

pytestmark = pytest.mark.window
pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytest.importorskip("pyvistaqt", reason='needs pyvistaqt: pip install "deformer[app]"')


@pytest.fixture
def poses(window):
    from deformer_app.viewer.qt.pose_strip import PoseStrip

    return window.docks.panel(PoseStrip)


@pytest.fixture
def strip(app, window, keyed, poses):
    """The slim timeline in the dock of poses, which is in front of the timeline's."""
    poses.parentWidget().raise_()
    wait_for(lambda: poses.shows_time, app.processEvents)
    return poses.time


def keys_at(window, frame):
    return {name for name in window.editor.timeline.clip.names if name[1] == frame}


def dock(window, title):
    from PySide6.QtWidgets import QDockWidget

    return window.findChild(QDockWidget, title)


def in_front(window, title):
    return not dock(window, title).visibleRegion().isEmpty()


def after(at, frames, scale):
    """A point some frames later."""
    from PySide6.QtCore import QPointF

    return at + QPointF(frames * scale.width, 0)


@pytest.mark.parametrize("where", ["panel", "strip"])
def test_a_drag_on_all_keys_moves_those_of_the_frame(
    app, window, panel, keyed, mouse, request, where
):
    summary, before = request.getfixturevalue(where).summary, keyed.clip
    assert len(keys_at(window, 0)) == 2 and len(keys_at(window, 20)) == 1
    mouse.click(summary, summary.position(0))
    assert keyed.selected == keys_at(window, 0)
    mouse.drag(summary, summary.position(0), after(summary.position(0), 5, panel.scale))
    assert len(keys_at(window, 5)) == 2 and not keys_at(window, 0)
    assert keyed.selected == keys_at(window, 5) and len(keys_at(window, 20)) == 1
    window.act("undo")
    assert keyed.clip == before


def test_the_rows_follow_a_drag_on_all_keys(app, window, panel, keyed, mouse):
    from PySide6.QtCore import QPoint, Qt
    from PySide6.QtTest import QTest

    still = panel.rows.grab().toImage()
    start = panel.summary.position(0).toPoint()
    QTest.mousePress(panel.summary, Qt.MouseButton.LeftButton, pos=start)
    pressed = panel.rows.grab().toImage()
    for x in (10, 40):
        QTest.mouseMove(panel.summary, start + QPoint(x, 0))
    assert panel.rows.grab().toImage() not in (still, pressed), "they are shown where they go"
    QTest.mouseMove(panel.summary, start)
    assert panel.rows.grab().toImage() == pressed
    QTest.mouseRelease(panel.summary, Qt.MouseButton.LeftButton, pos=start)
    assert len(keys_at(window, 0)) == 2


def test_shift_selects_and_frees_the_keys_of_one_more_frame(app, window, panel, keyed, mouse):
    from PySide6.QtCore import Qt

    summary, shift = panel.summary, Qt.KeyboardModifier.ShiftModifier
    first, later = keys_at(window, 0), keys_at(window, 20)
    mouse.click(panel.rows, panel.rows.position(min(first)))
    assert len(keyed.selected) == 1
    mouse.click(summary, summary.position(0), shift)
    assert keyed.selected == first, "the other keys of a frame of which one is selected"
    mouse.click(summary, summary.position(20), shift)
    assert keyed.selected == first | later
    mouse.click(summary, summary.position(0), shift)
    assert keyed.selected == later


def test_a_box_on_all_keys_selects_whole_frames_to_delete(app, window, panel, keyed, mouse):
    from PySide6.QtCore import QPointF

    summary = panel.summary
    at = summary.position(20)
    mouse.drag(summary, at - QPointF(20, 5), at + QPointF(15, 5))
    assert keyed.selected == keys_at(window, 20)
    mouse.drag(summary, summary.position(0) + QPointF(9, 0), at - QPointF(9, 0))
    assert not keyed.selected
    mouse.click(summary, summary.position(0))
    window.menus.items["delete-key"].trigger()
    assert not keys_at(window, 0) and len(keyed.clip.names) == 1


def test_a_double_click_on_all_keys_seeks(app, window, panel, keyed):
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest

    for frame in (0, 12):
        at = panel.summary.position(frame).toPoint()
        QTest.mouseDClick(panel.summary, Qt.MouseButton.LeftButton, pos=at)
        assert keyed.frame == frame


def test_all_keys_stay_in_sight_while_the_rows_scroll(app, window, panel):
    place(window, *range(0, 120, 8))
    window.editor.timeline.keys.set()
    rest(app, window)
    first, *_, last = window.editor.edit.handles
    window.editor.handles.select([last.id])
    rows = panel.rows
    wait_for(
        lambda: not rows.visibleRegion().contains(rows.position((first.id, 0)).toPoint()),
        app.processEvents,
    )
    assert panel.summary.visibleRegion().boundingRect() == panel.summary.rect()


def test_measurements_leave_ground_between_their_diamonds(app, window, panel, keyed):
    from PySide6.QtGui import QColor

    clip = keyed.clip
    owner = window.editor.edit.handles[0].id
    key = clip.track(owner).keys[0]
    track = Track(owner, tuple(replace(key, frame=n) for n in range(100)), measured=True)
    keyed.change("Load", replace(clip, length=100, tracks=(track,)))
    keyed.seek(10)
    keyed.keys.set([SLIDERS])
    rest(app, window)
    summary, scale = panel.summary, panel.scale
    image = summary.grab().toImage()

    def is_ground(frame, above):
        at = summary.position(frame)
        here = image.pixelColor(round(at.x()), round(at.y()) - above)
        return here == image.pixelColor(round(summary.position(70).x()), 1) != QColor("black")

    assert scale.width > 7
    assert not any(is_ground(n, 3) for n in range(20, 60))
    assert all(is_ground(n + 0.5, 3) for n in range(20, 60))
    assert is_ground(40, 6) and not is_ground(10, 6), "a key that is set by hand stands out"


def test_the_dock_of_poses_shows_time_with_keys_or_an_open_timeline_only(app, window, poses):
    assert not poses.time.isVisible()
    timeline = dock(window, "Timeline")
    timeline.show()
    poses.parentWidget().raise_()
    wait_for(lambda: poses.shows_time, app.processEvents)
    timeline.close()
    wait_for(lambda: not poses.time.isVisible(), app.processEvents)
    place(window, 100)
    window.editor.timeline.keys.set()
    timeline.close()
    wait_for(lambda: poses.shows_time, app.processEvents)
    rest(app, window)  # menus know what can be undone
    window.act("undo")
    wait_for(lambda: not poses.time.isVisible(), app.processEvents)


def test_poses_are_keyed_one_after_the_other_without_leaving_their_dock(
    app, window, poses, mouse, hand
):
    """Scrub, start from a pose, scrub, start from the next; then play."""
    from PySide6.QtCore import QPointF

    dock(window, "Timeline").show()
    poses.parentWidget().raise_()
    wait_for(lambda: poses.shows_time, app.processEvents)
    place(window, 100)
    window.editor.handles.select([])
    rest(app, window)
    strip, timeline = poses.time, window.editor.timeline
    shown = poses.examples
    mouse.click(strip.buttons.key, QPointF(9, 9))
    assert len(keys_at(window, 0)) == 2
    rest(app, window)
    for frame, row in ((20, 3), (40, 5)):
        ruler = strip.ruler
        start, end = (QPointF(ruler.pixel(f), 8) for f in (timeline.frame, frame))
        mouse.drag(ruler, start, end)
        assert timeline.frame == frame
        rest(app, window)
        at = shown.viewport().mapToGlobal(shown.visualItemRect(shown.item(row)).center())
        words = ("mousemove", *map(str, at.toTuple()), "click", "--repeat", "2", "1")
        hand(*words)
        wait_for(lambda f=frame: keys_at(window, f), app.processEvents)
        rest(app, window)
        assert in_front(window, "Poses") and poses.shows_time
    assert set(timeline.clip.by_frame) == {0, 20, 40}
    mouse.click(strip.buttons.previous, QPointF(9, 9))
    assert timeline.frame == 20
    mouse.click(strip.buttons.next, QPointF(9, 9))
    assert timeline.frame == 40
    mouse.click(strip.buttons.play, QPointF(9, 9))
    assert timeline.playing and in_front(window, "Poses")
    mouse.click(strip.buttons.play, QPointF(9, 9))
    assert not timeline.playing
    assert strip.buttons.play.text() == "▶"


def test_a_press_beside_the_diamonds_of_the_strip_moves_the_playhead(
    app, window, strip, keyed, hand
):
    def at(frame):
        point = strip.summary.mapToGlobal(strip.summary.position(frame).toPoint())
        return "mousemove", *map(str, point.toTuple())

    hand(*at(10), "mousedown", "1", *at(12), *at(15), "mouseup", "1")
    assert keyed.frame == 15 and not keyed.selected
    hand(*at(20), "mousedown", "1", *at(22), *at(25), "mouseup", "1")
    assert keyed.frame == 15 and keyed.selected == keys_at(window, 25) != set()


def test_both_docks_have_one_scale(app, window, panel, strip, keyed, hand):
    from PySide6.QtCore import QPoint

    def turn(widget, at):
        point = widget.mapToGlobal(QPoint(round(at), 6))
        hand("mousemove", *map(str, point.toTuple()), "click", "--repeat", "2", "4")

    def fits():
        return strip.ruler.pixel(40) < strip.ruler.width()

    def places():
        docks = {panel: panel.ruler, strip: strip.ruler}
        return {
            tuple(round(ruler.mapTo(dock, QPoint()).x() + ruler.pixel(f)) for f in (0, 20))
            for dock, ruler in docks.items()
        }

    assert fits() and len(places()) == 1
    width = panel.scale.width
    turn(strip.summary, strip.ruler.pixel(20))
    assert panel.scale.width == pytest.approx(1.44 * width) and len(places()) == 1
    window.docks.panel(type(panel)).parentWidget().raise_()
    wait_for(lambda: in_front(window, "Timeline"), app.processEvents)
    assert panel.scale.width == pytest.approx(1.44 * width), "the other dock keeps it"
    turn(panel.rows, panel.ruler.pixel(20))
    assert len(places()) == 1 and not fits()
    keyed.set_clip(length=90)
    assert strip.ruler.pixel(89) < strip.ruler.width(), "another length is shown as a whole"


def test_tab_leads_through_the_buttons_of_the_strip_to_the_poses(app, window, poses, strip, hand):
    from PySide6.QtCore import Qt

    buttons = strip.buttons
    buttons.previous.setFocus(Qt.FocusReason.TabFocusReason)
    wait_for(buttons.previous.hasFocus, app.processEvents)
    for reached in (buttons.play, buttons.next, buttons.key, poses.save, poses.saved):
        hand("key", "Tab")
        wait_for(reached.hasFocus, app.processEvents)
    hand("key", "shift+Tab", "key", "shift+Tab", "key", "space")
    wait_for(lambda: window.editor.timeline.frame == 20, app.processEvents)
    assert len(keys_at(window, 20)) == 3, "the space bar presses the button"
