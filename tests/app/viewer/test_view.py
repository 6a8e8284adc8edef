"""Where the camera goes: zoom within limits, framing; and a press a few pixels beside the body."""

import numpy as np
import pytest

from deformer_app.viewer.changes import MenuAsked
from deformer_app.viewer.gizmo import translation
from off_screen_editor import SIZE, click, drag, event, finish, press_key, seen


def pixels(editor):
    return editor.state.camera.project(editor.vertices, SIZE)


@pytest.mark.parametrize("where", ["surface", "beside"])
def test_the_wheel_goes_neither_through_the_surface_nor_out_of_sight(editor, where):
    at = seen(editor, 0.5)[1] if where == "surface" else np.array([30.0, 30.0])
    for _ in range(80):
        event(editor, "MouseWheelForward", at)
    if where == "surface":
        assert editor.state.view.vertex_at(tuple(at)) is not None
    assert (editor.state.camera.depths(editor.vertices) > 0).any()
    for _ in range(160):
        event(editor, "MouseWheelBackward", at)
    extent = np.ptp(pixels(editor), axis=0).max()
    assert 10 < extent < SIZE[1] / 4
    assert np.isfinite(extent)


def test_what_is_under_the_mouse_stays_there_while_the_wheel_turns(editor):
    _, at = seen(editor, 0.7)
    picked = editor.state.view._pick(at)[1]
    for _ in range(8):
        event(editor, "MouseWheelForward", at)
    np.testing.assert_allclose(editor.state.camera.project([picked], SIZE)[0], at, atol=0.6)


def test_framing_keeps_the_direction_and_shows_the_selection_or_all(editor):
    drag(editor, (8, 8), (70, 40))
    axes = editor.state.camera.axes()
    event(editor, "MouseWheelForward", (200, 100))
    editor.picture.frame_all()
    np.testing.assert_allclose(editor.state.camera.axes(), axes, atol=1e-9)
    whole = pixels(editor)
    assert (whole > 0).all() and (whole < SIZE).all()
    editor.picture.frame_selected()  # nothing is selected
    np.testing.assert_allclose(pixels(editor), whole, atol=1e-6)
    vertex, at = seen(editor, 0.9)
    click(editor, at)
    editor.picture.frame_selected()
    np.testing.assert_allclose(editor.state.camera.axes(), axes, atol=1e-9)
    there = pixels(editor)[vertex]
    np.testing.assert_allclose(there, np.array(SIZE) / 2, atol=60)
    assert np.ptp(pixels(editor), axis=0).max() > 1.5 * np.ptp(whole, axis=0).max()


@pytest.mark.parametrize("orthographic", [False, True])
def test_a_view_shows_where_the_body_comes_to_rest(editor, orthographic):
    """A step's pose is on its way while the user asks for a view of it."""
    if orthographic:
        editor.state.viewpoint.toggle_orthographic()
    for vertex in (0, 60, 115):
        editor.handles.place(vertex, add=True)
    editor.handles.select_all()
    editor.handles.move_selected(translation([9.0, 5.0, 0.0]))
    editor.commit("Move")
    finish(editor)

    def off():
        places = pixels(editor) / SIZE - 0.5
        return np.abs(places.min(axis=0) + places.max(axis=0)).max()

    views = (editor.picture.frame_all, lambda: editor.picture.frame(0, 0))
    for step, view in zip((editor.undo, editor.redo), views, strict=True):
        step()
        view()
        finish(editor)
        assert off() < 1e-3
    editor.undo()
    editor.picture.frame_all()
    drag(editor, (8, 8), (70, 40))  # the user goes on with another view
    camera = editor.state.camera
    finish(editor)
    assert editor.state.camera == camera


def outline(editor):
    """The highest pixel of the body in the middle of the picture, found by looking at each."""
    x = SIZE[0] // 2 + 0.5
    for y in range(SIZE[1]):
        if editor.state.view.vertex_at((x, y + 0.5)) is not None:
            return x, y + 0.5
    raise AssertionError("the body is not in the middle")


def test_a_press_a_few_pixels_beside_the_body_is_on_it(editor):
    x, y = outline(editor)
    near = editor.stage.vertex_at((x, y - 5.0))
    assert near is not None and editor.state.view.vertex_at((x, y - 5.0)) is None
    # The nearest corner of the outline, and nothing hides it.
    assert editor.state.view.sees(editor.vertices[near])
    assert editor.stage.vertex_at((x, y - 9.0)) is None
    camera = editor.state.camera
    drag(editor, (x, y - 4.0), (x, y - 40.0))
    assert editor.state.camera == camera
    assert editor.edit.handles[0].vertices[0] == near
    drag(editor, (x, 5.0), (x + 30, 5.0))
    assert editor.state.camera != camera


def test_beside_the_body_no_vertex_of_its_back_is_offered(editor):
    hits = 0
    for x in range(10, SIZE[0], 7):
        for y in range(10, SIZE[1], 7):
            if editor.state.view.vertex_at((x, y)) is None:
                vertex = editor.stage.vertex_at((x, y))
                if vertex is not None:
                    hits += 1
                    assert editor.state.view.sees(editor.vertices[vertex])
                    edges = editor.state.view.surface.edges
                    ends = pixels(editor)[edges[(edges == vertex).any(axis=1)]]
                    low, high = ends.min(axis=(0, 1)), ends.max(axis=(0, 1))
                    assert (low <= (x + 6, y + 6)).all() and (high >= (x - 6, y - 6)).all()
    assert hits > 10


def test_a_right_click_asks_for_a_menu_and_a_right_drag_orbits(editor, heard):
    vertex, at = seen(editor, 0.5)
    click(editor, at, button="Right")
    (asked,) = [change for change in heard if isinstance(change, MenuAsked)]
    assert asked.hover.vertex == vertex and np.allclose(asked.pixel, at, atol=0.6)
    heard.clear()
    drag(editor, at, np.add(at, (30, 10)), button="Right")
    assert not [change for change in heard if isinstance(change, MenuAsked)]
    assert editor.edit.handles == ()


LETTERS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789+-*/=.,;:_#<>?!~^"
NAMED = ("Up", "Down", "Left", "Right", "Prior", "Next", "Home", "End", "Insert", "Delete",
         "BackSpace", "Return", "KP_Enter", "Tab", "space", "Escape", "Pause", "Print", "Menu",
         "plus", "minus", "KP_Add", "KP_Subtract", "question",
         *(f"F{n}" for n in range(1, 13)), *(f"KP_{n}" for n in range(10)))  # fmt: skip


def test_no_key_means_anything_to_vtk_or_pyvista(editor):
    """Every key, with Shift and Ctrl: camera, looks and picture stay as they are."""
    click(editor, seen(editor, 0.6)[1])
    finish(editor)
    plotter = editor.state.view.plotter

    def state():
        lens, actor = plotter.renderer.GetActiveCamera(), editor.state.view.surface.actor
        look = actor.GetProperty()
        return (
            lens.GetPosition(), lens.GetFocalPoint(), lens.GetViewUp(), lens.GetViewAngle(),
            lens.GetParallelProjection(), lens.GetParallelScale(), look.GetRepresentation(),
            look.GetPointSize(), look.GetLineWidth(), look.GetOpacity(),
            plotter.render_window.GetStereoRender(), len(plotter.renderer.actors),
            type(plotter.iren.style), editor.edit, editor.state.look, editor.handles.selected,
        )  # fmt: skip

    before = state()
    keys = [(letter, letter) for letter in LETTERS] + [(name, "\0") for name in NAMED]
    for name, letter in keys:
        for shift, control in ((False, False), (True, False), (False, True)):
            press_key(editor, name, letter, shift, control)
            assert state() == before, f"{name}, shift {shift}, control {control}"
    assert not plotter._closed
