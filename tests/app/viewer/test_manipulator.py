"""The manipulator in an editor: its axes, exact numbers, and what is told beside the cursor."""

import numpy as np
from scipy.spatial.transform import Rotation

import deformer
from deformer_app.viewer.stage import Hover
from off_screen_editor import SIZE, click, drag, event, finish, part_pixel, press_key, seen


def label(editor):
    return editor.state.view.overlays.label.text


def with_handle(editor, share=0.5):
    vertex, at = seen(editor, share)
    click(editor, at)
    return vertex, editor.edit.handles[-1]


def test_how_far_it_moves_is_shown_and_typed_numbers_are_exact(editor):
    _, before = with_handle(editor)
    at = part_pixel(editor, "y")
    drag(editor, at, np.add(at, (0, -30)), release=False)
    moved = np.subtract(editor.edit.handles[0].centre, before.centre)
    assert label(editor) == f"Y  {moved[1]:.4g} units" and moved[1] > 0.01
    for key in ("minus", "period", "2", "5"):
        press_key(editor, key)
    assert label(editor) == "Y  -.25| units"
    event(editor, "MouseMove", np.add(at, (0, -60)))  # the mouse has no say meanwhile
    np.testing.assert_allclose(
        editor.edit.handles[0].centre, np.add(before.centre, (0, -0.25, 0)), atol=1e-12
    )
    press_key(editor, "Return")
    assert not editor.dragging and label(editor) == ""
    assert editor.session.entry.label == "Move"
    event(editor, "LeftButtonRelease", np.add(at, (0, -60)))
    finish(editor)
    np.testing.assert_allclose(
        editor.edit.handles[0].centre, np.add(before.centre, (0, -0.25, 0)), atol=1e-12
    )
    assert len(editor.session.entries) == 3, "placed, moved"


def test_a_deleted_number_gives_the_mouse_its_say_again_and_escape_takes_all_back(editor):
    _, before = with_handle(editor)
    at = part_pixel(editor, "y")
    drag(editor, at, np.add(at, (0, -30)), release=False)
    moved = editor.edit.handles[0].centre
    press_key(editor, "5")
    assert editor.edit.handles[0].centre != moved
    press_key(editor, "BackSpace")
    assert editor.edit.handles[0].centre == moved
    editor.controller.cancel()
    assert editor.edit.handles == (before,) and label(editor) == ""
    press_key(editor, "5")
    assert editor.edit.handles == (before,)


def test_a_plane_takes_two_numbers(editor):
    _, before = with_handle(editor)
    editor.state.set_axes("screen")
    at = part_pixel(editor, "xy")
    event(editor, "MouseMove", at)
    event(editor, "LeftButtonPress", at)
    for key in ("period", "1", "Tab", "period", "2"):
        press_key(editor, key)
    event(editor, "LeftButtonRelease", at)
    finish(editor)
    right, up, _ = editor.state.camera.axes()
    moved = np.subtract(editor.edit.handles[0].centre, before.centre)
    np.testing.assert_allclose(moved, 0.1 * right + 0.2 * up, atol=1e-12)


def test_a_single_vertex_turns_by_typed_degrees_and_its_surroundings_follow(editor):
    vertex, _ = with_handle(editor, 0.9)
    editor.handles.set_kind("exact")
    editor.state.set_gizmo("rotate")
    finish(editor)
    (start,) = deformer.local_rotations(editor.model, [vertex], editor.vertices)
    at = part_pixel(editor, "rz")
    drag(editor, at, np.add(at, (12, 12)), release=False)
    assert label(editor).startswith("Z  ") and label(editor).endswith("°")
    for key in ("3", "0"):
        press_key(editor, key)
    press_key(editor, "KP_Enter")
    event(editor, "LeftButtonRelease", at)
    finish(editor)
    (now,) = deformer.local_rotations(editor.model, [vertex], editor.vertices)
    turned = Rotation.from_matrix(now @ start.T).as_rotvec(degrees=True)
    np.testing.assert_allclose(turned, [0, 0, 30], atol=1e-6)
    assert editor.session.entry.label == "Rotate"


def test_its_axes_follow_the_surface_the_screen_or_the_world(editor):
    vertex, _ = with_handle(editor)
    np.testing.assert_array_equal(editor.stage.gizmo.frame, np.eye(3))
    editor.state.set_axes("surface")
    frame = np.array(editor.stage.gizmo.frame)
    normals = deformer.vertex_normals(editor.vertices, editor.model.reference.faces)
    np.testing.assert_allclose(frame[2], normals[vertex], atol=1e-5)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-5)
    assert (
        abs(frame[0] @ editor.state.viewpoint.sky) < 1e-6
        and np.cross(frame[0], frame[1]) @ frame[2] > 0
    )
    editor.state.set_axes("screen")
    np.testing.assert_allclose(editor.stage.gizmo.frame, editor.state.camera.axes())
    at = part_pixel(editor, "x")
    before = np.array(editor.edit.handles[0].centre)
    drag(editor, at, np.add(at, (40, 25)))
    pixels = editor.state.camera.project([before, editor.edit.handles[0].centre], SIZE)
    np.testing.assert_allclose(pixels[1] - pixels[0], (40, 0), atol=1.0)


def test_its_axes_stay_during_a_drag(editor):
    """Though the surface turns below the handle, and so does the view."""
    with_handle(editor, 0.9)
    editor.state.set_axes("surface")
    frame = editor.stage.gizmo.frame
    at = part_pixel(editor, "z")
    drag(editor, at, np.add(at, (20, 20)), release=False)
    drag(editor, np.add(at, (20, 20)), np.add(at, (40, 25)), button="Right")
    assert editor.dragging and editor.stage.gizmo.frame == frame
    event(editor, "LeftButtonRelease", np.add(at, (40, 25)))
    finish(editor)
    assert editor.stage.gizmo.frame != frame


def test_a_click_on_the_manipulator_changes_nothing_of_it_and_acts_below(editor):
    with_handle(editor)
    for part in editor.stage.gizmo.parts_seen(editor.state.camera):
        steps = len(editor.session.entries)
        at = part_pixel(editor, part)
        below = editor.stage.vertex_at(tuple(at))
        click(editor, at)
        assert [entry.label for entry in editor.session.entries[steps:]] == (
            [] if below is None else ["Place handle"]
        )
        editor.handles.select([editor.edit.handles[0].id])
        finish(editor)


def test_what_is_typed_without_a_drag_is_left_to_others(editor):
    with_handle(editor)
    before = editor.edit
    press_key(editor, "5")
    at = part_pixel(editor, "y")
    event(editor, "MouseMove", at)
    press_key(editor, "5")
    assert editor.edit == before and not editor.controller.takes_numbers


def test_what_is_under_a_still_mouse_follows_what_becomes_of_the_handle(editor):
    _, handle = with_handle(editor)
    at = np.floor(editor.state.camera.project([handle.centre], SIZE)[0]) + 0.5
    event(editor, "MouseMove", at)
    assert editor.state.hovered.handle == handle.id
    editor.handles.delete()
    finish(editor)
    assert editor.state.hovered.vertex is not None and editor.state.hovered.handle is None
    editor.pins.pin_here()
    finish(editor)
    (pin,) = editor.edit.handles
    assert pin.kind == "pin", "P pins the surface that is under the mouse now"


def test_a_mouse_that_has_left_the_picture_is_over_nothing(editor):
    _, handle = with_handle(editor)
    event(editor, "MouseMove", part_pixel(editor, "y"))
    event(editor, "Leave", (0, 0))
    editor.handles.select([])
    editor.handles.select([handle.id])
    finish(editor)
    assert editor.state.hovered == Hover()
