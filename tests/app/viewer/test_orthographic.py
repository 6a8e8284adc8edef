"""Parallel lines of sight in an editor's picture: what is drawn, picked and dragged."""

from dataclasses import replace

import numpy as np
import pytest

from deformer_app.viewer.session import Session
from off_screen_editor import SIZE, click, drag, event, finish, seen


@pytest.fixture
def editor(editor):
    editor.state.viewpoint.toggle_orthographic()
    finish(editor)
    return editor


def silhouette(editor):
    """Where the picture differs from the one without the surface."""
    view = editor.state.view
    pictures = []
    for visible in (True, False):
        view.surface.actor.SetVisibility(visible)
        view.render()
        pictures.append(view.grab().astype(int))
    view.surface.actor.VisibilityOn()
    return (pictures[0] != pictures[1]).any(axis=2)


@pytest.mark.parametrize("zoom", [1.0, 6.0])
def test_vtk_draws_what_the_camera_projects(editor, zoom):
    """However near the eye has come, nothing in front of it or behind it is cut off."""
    editor.picture.frame(40, 20)
    if zoom > 1:
        middle = editor.state.camera.project([editor.vertices.mean(axis=0)], SIZE)[0]
        editor.state.viewpoint.set_camera(editor.state.camera.zoomed(zoom, middle, SIZE))
    finish(editor)
    assert editor.state.camera.is_orthographic
    shown = silhouette(editor)
    pixels = editor.state.camera.project(editor.vertices, SIZE)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    rows, columns = np.nonzero(shown)
    border = np.array(SIZE) - 1
    for found, wanted in ((columns, 0), (rows, 1)):
        assert abs(found.min() - max(low[wanted], 0)) < 2
        assert abs(found.max() - min(high[wanted], border[wanted])) < 2
    inside = ((pixels > 2) & (pixels < border - 2)).all(axis=1)
    x, y = np.floor(pixels[inside]).astype(int).T
    near = [shown[y + dy, x + dx] for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
    assert np.any(near, axis=0).all()


def test_the_eye_s_distance_changes_nothing_in_the_picture(editor):
    """Looking along the tube, whose near end lies behind the eye after a zoom."""
    editor.picture.frame(80, 10)
    middle = editor.state.camera.project([editor.vertices.mean(axis=0)], SIZE)[0]
    near = editor.state.camera.zoomed(6.0, middle, SIZE)
    assert (
        editor.state.camera.depths(editor.vertices).min() > 0 > near.depths(editor.vertices).min()
    )
    pictures = []
    for away in (0.0, 10.0):
        position = np.add(near.position, away * near.axes()[2])
        editor.state.viewpoint.set_camera(replace(near, position=tuple(position.tolist())))
        finish(editor)
        pictures.append(editor.state.view.picture().astype(int))
    assert (np.abs(pictures[0] - pictures[1]).max(axis=2) > 8).mean() < 0.005


def test_what_is_seen_is_what_is_picked_and_a_drag_follows_the_mouse(editor):
    vertex, at = seen(editor, 0.95)
    goal = at + np.array([-25, -40])
    drag(editor, at, goal)
    (handle,) = editor.edit.handles
    assert handle.vertices == (vertex,)
    target = editor.state.camera.project([handle.centre], SIZE)[0]
    np.testing.assert_allclose(target, goal, atol=1.5)
    editor.handles.set_kind("exact")
    finish(editor)
    there = editor.state.camera.project(editor.vertices[[vertex]], SIZE)[0]
    np.testing.assert_allclose(there, goal, atol=1.5)
    # The handle is found again where it is, and moves by the manipulator, too.
    event(editor, "MouseMove", goal)
    assert editor.state.hovered.handle == handle.id


def test_the_manipulator_s_axis_follows_the_mouse_behind_the_eye_too(editor):
    _, at = seen(editor, 0.5)
    click(editor, at)
    middle = editor.state.camera.project([editor.edit.handles[0].centre], SIZE)[0]
    for _ in range(3):  # the eye comes nearer than the surface
        editor.state.viewpoint.set_camera(editor.state.camera.zoomed(1.6, middle, SIZE))
    for part in ("x", "xy"):
        gizmo, camera = editor.stage.gizmo, editor.state.camera
        assert gizmo is not None
        outline = camera.project(gizmo.outline(part, camera, SIZE), SIZE)
        start = outline[-1] if part == "x" else outline[:4].mean(axis=0)
        now = start + np.array([12.0, 0.0])
        amount = gizmo.step(part, start, now, camera, SIZE)
        assert amount is not None
        axes = np.array(gizmo.frame)[: len(amount)]
        step = camera.project([gizmo.centre, gizmo.centre + amount @ axes], SIZE)
        way = step[1] - step[0]
        if part == "xy":
            np.testing.assert_allclose(way, [12.0, 0.0], atol=1e-6)
        else:  # the mouse's way along the axis
            direction = way / np.hypot(*way)
            np.testing.assert_allclose(way @ direction, abs(12.0 * direction[0]), atol=1e-6)


def test_the_wheel_changes_the_scale_at_the_cursor(editor):
    _, at = seen(editor, 0.5)
    under = editor.state.camera.unproject(at, editor.state.camera.distance, SIZE)
    height = editor.state.camera.height
    event(editor, "MouseMove", at)
    event(editor, "MouseWheelForward", at)
    assert editor.state.camera.height < 0.95 * height
    np.testing.assert_allclose(editor.state.camera.project([under], SIZE)[0], at, atol=1.0)


def test_directions_keep_the_projection_and_a_session_brings_it_back(editor, tmp_path):
    editor.picture.frame(0, 90)
    assert editor.state.camera.is_orthographic
    editor.save_session(tmp_path / "flat.json")
    camera = editor.state.camera
    editor.state.viewpoint.toggle_orthographic()
    assert not editor.state.camera.is_orthographic
    editor.open_session(tmp_path / "flat.json")
    assert editor.state.camera == camera
    # A session of a release that had no such cameras.
    session = Session.load(tmp_path / "flat.json")
    del session.view["camera"]["height"]
    session.save(tmp_path / "old.json")
    editor.open_session(tmp_path / "old.json")
    assert not editor.state.camera.is_orthographic
    assert editor.state.camera.position == camera.position
