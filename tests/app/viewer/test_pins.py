"""Pins: a patch that stays, its size, and what is shown of it."""

import numpy as np
import pytest
from PIL import ImageColor

import deformer
from deformer_app.rendering.palette import KINDS
from deformer_app.viewer.actions import ACTIONS
from deformer_app.viewer.changes import NoticeGiven
from deformer_app.viewer.gizmo import translation
from deformer_app.viewer.handle_changes import gaps_of
from deformer_app.viewer.session import Session
from distances import largest
from off_screen_editor import SIZE, drag, event, finish, seen, texts


def press(editor, key):
    """Run the action of a key."""

    class _Shell:
        def __init__(self):
            self.editor = editor

    next(a for a in ACTIONS if a.key == key).run(_Shell())  # pyright: ignore[reportArgumentType]
    finish(editor)


@pytest.fixture
def pin(editor):
    """A pin at one end of the tube, made with the mouse and a key."""
    editor.pins.radius = 0.12
    _, at = seen(editor, 0.1)
    event(editor, "MouseMove", at)
    press(editor, "P")
    (found,) = editor.edit.handles
    return found


def pixel_of(editor, pin):
    """The middle of the pixel at which the middle of a pin is."""
    return np.floor(editor.state.camera.project(editor.vertices, SIZE))[pin.vertices[0]] + 0.5


def test_a_key_pins_the_patch_under_the_drag(editor, pin):
    vertex = pin.vertices[0]
    assert pin.kind == "pin" and editor.handles.selected == {pin.id}
    distance = editor.model.distances(vertex) / editor.model.reference.bounding_diagonal
    assert set(pin.patch) == set(np.flatnonzero(distance <= pin.radius).tolist())
    assert editor.session.entry.label == "Make pin"
    editor.undo()
    assert not editor.edit.handles, "placing and pinning are one step"


def test_a_pinned_patch_neither_slides_nor_turns_while_the_rest_is_dragged(editor, pin):
    """Compared with a pin of a vertex alone, which leaves the surface free to turn."""
    before, diagonal = editor.vertices, editor.model.reference.bounding_diagonal
    patch = list(pin.patch)
    _, at = seen(editor, 0.95)
    drag(editor, at, at + np.array([-60, 70]))
    assert largest(editor.vertices - before) > 0.05 * diagonal, "the other end has moved"
    held = largest(editor.vertices[patch] - before[patch])
    assert held < 5e-3 * diagonal
    vertex = pin.vertices[0]
    np.testing.assert_allclose(editor.vertices[vertex], before[vertex], atol=1e-6 * diagonal)


def test_a_click_on_a_pinned_patch_selects_the_pin_and_drags_leave_it(editor, pin):
    at = pixel_of(editor, pin)
    editor.handles.select([])
    drag(editor, at, at + np.array([20, 20]))
    assert editor.edit.handles == (pin,) and editor.handles.selected == {pin.id}


@pytest.mark.parametrize("where", ["middle", "patch"])
def test_a_pin_says_that_it_is_pinned_and_how_to_free_it(editor, pin, heard, where):
    at = pixel_of(editor, pin)
    if where == "patch":
        pixels = np.floor(editor.state.camera.project(editor.vertices[list(pin.patch)], SIZE)) + 0.5
        at = next(
            pixel
            for pixel in pixels
            if editor.stage.handle_at(tuple(pixel)) is None
            and editor.stage.vertex_at(tuple(pixel)) in pin.patch
        )
    editor.handles.select([])
    event(editor, "MouseMove", at)
    assert (editor.state.hovered.handle is None) == (where == "patch")
    assert "is pinned" in editor.stage.hint and "S frees it" in editor.stage.hint
    assert "drag the handle" not in editor.stage.hint and "to pull it" not in editor.stage.hint
    camera = editor.state.camera
    for pulls in (1, 2):
        drag(editor, at, at + np.array([30, 20]))
        told = texts(heard, NoticeGiven)
        assert len(told) == pulls and "Pinned" in told[-1] and "S makes it" in told[-1]
    assert editor.edit.handles == (pin,) and editor.state.camera == camera
    press(editor, "S")
    event(editor, "MouseMove", pixel_of(editor, pin))
    assert "drag the handle" in editor.stage.hint
    before = len(texts(heard, NoticeGiven))
    drag(editor, pixel_of(editor, pin), pixel_of(editor, pin) + np.array([30, 20]))
    assert editor.session.entry.label == "Drag" and len(texts(heard, NoticeGiven)) == before


def test_a_pull_at_a_pinned_region_tells_of_the_pin(editor, heard):
    vertex, _ = seen(editor, 0.5)
    editor.handles.add_region(np.argsort(editor.model.distances(vertex))[:20].tolist())
    event(editor, "MouseMove", (3, 3))
    press(editor, "P")
    (region,) = editor.edit.handles
    assert region.kind == "pin" and not region.radius
    pixels = np.floor(editor.state.camera.project(editor.vertices[list(region.patch)], SIZE)) + 0.5
    at = next(p for p in pixels if editor.stage.handle_at(tuple(p)) is None)
    event(editor, "MouseMove", at)
    assert "is pinned" in editor.stage.hint and "wheel" not in editor.stage.hint
    drag(editor, at, at + np.array([30, 20]))
    assert editor.edit.handles == (region,) and "Pinned" in texts(heard, NoticeGiven)[-1]


def test_a_key_beside_the_body_tells_that_it_pins_what_is_selected(editor, heard):
    on_body = {height: seen(editor, height) for height in (0.1, 0.5, 0.9)}

    def told(selected, move, at):
        """Notices of P with some handles selected, after an event of the mouse."""
        editor.prior.reset()
        for height in selected:
            editor.handles.place(on_body[height][0], add=True)
        editor.commit("Place handle")
        finish(editor)
        before = len(texts(heard, NoticeGiven))
        event(editor, move, at)
        press(editor, "P")
        assert {handle.kind for handle in editor.edit.handles} == {"pin"}
        press(editor, "P")
        return texts(heard, NoticeGiven)[before:]

    end = ": the mouse is on no part of the body"
    assert told([0.1, 0.9], "MouseMove", (3, 3)) == ["Pinned the 2 selected handles" + end]
    assert told([0.1], "MouseMove", (3, 3)) == ["Pinned the selected handle" + end]
    at_handle = pixel_of(editor, editor.edit.handles[0])
    assert told([0.1], "MouseMove", at_handle) == []
    assert told([0.1, 0.9], "Leave", (3, 3)) == [], "the mouse is at a menu or a button"


@pytest.mark.parametrize("at_pin", [True, False])
def test_a_key_makes_no_step_for_a_pin_that_is_one(editor, pin, at_pin):
    _, end = seen(editor, 0.95)
    drag(editor, end, end + np.array([-60, 70]))  # the pin is held to some digits only
    editor.handles.select([pin.id])
    event(editor, "MouseMove", pixel_of(editor, pin) if at_pin else (3, 3))
    entry, before = editor.session.entry, editor.vertices.copy()
    for _ in range(2):
        press(editor, "P")
    assert editor.session.entry.label == entry.label and editor.session.cursor == 2
    assert editor.edit == entry.edit
    np.testing.assert_allclose(editor.vertices, before, rtol=0, atol=1e-12)
    editor.handles.select_all()
    event(editor, "MouseMove", (3, 3))
    press(editor, "P")
    assert {handle.kind for handle in editor.edit.handles} == {"pin"}
    assert editor.edit.handle(pin.id) == pin, "it stays while another one is pinned"


@pytest.mark.parametrize(("key", "word"), [("+", "large"), ("-", "small")])
def test_no_step_makes_a_pin_larger_than_pins_can_be_or_smaller(editor, pin, heard, key, word):
    event(editor, "MouseMove", pixel_of(editor, pin))
    for _ in range(40):
        press(editor, key)
    assert editor.edit.handle(pin.id).radius == editor.pins.radius != pin.radius
    _, end = seen(editor, 0.95)
    drag(editor, end, end + np.array([-60, 70]))  # the pin is held to some digits only
    editor.handles.select([pin.id])
    steps = len(editor.session.entries)
    press(editor, key)
    assert len(editor.session.entries) == steps, "it has no other size"
    assert any(f"as {word} as pins can be" in text for text in texts(heard, NoticeGiven))


@pytest.mark.parametrize("key", ["1", "2", "3"])
def test_a_pin_has_no_manipulator_and_its_keys_say_why(editor, pin, heard, key):
    press(editor, key)
    assert editor.stage.gizmo is None and "Pinned" in texts(heard, NoticeGiven)[-1]
    press(editor, "S")
    before = len(texts(heard, NoticeGiven))
    press(editor, key)
    assert editor.stage.gizmo is not None
    assert not any("Pinned" in text for text in texts(heard, NoticeGiven)[before:])


@pytest.mark.parametrize("how", ["wheel", "key"])
def test_the_size_of_a_pin_changes_and_is_one_step_of_the_history(editor, pin, how):
    at = pixel_of(editor, pin)
    camera = editor.state.camera
    event(editor, "MouseMove", at)
    steps = len(editor.session.entries)
    for _ in range(4):
        if how == "wheel":
            event(editor, "MouseWheelForward", at, shift=True)
            finish(editor)
        else:
            press(editor, "+")
    (larger,) = editor.edit.handles
    assert larger.radius > pin.radius and set(larger.patch) > set(pin.patch)
    assert larger.vertices[0] == pin.vertices[0]
    assert len(editor.session.entries) == steps + 1
    assert editor.state.camera == camera
    editor.undo()
    assert editor.edit.handles == (pin,)
    editor.redo()
    press(editor, "-")
    assert editor.edit.handles[0].radius < larger.radius


def test_shift_and_wheel_beside_a_pin_zoom(editor, pin):
    _, at = seen(editor, 0.9)
    camera = editor.state.camera
    event(editor, "MouseWheelForward", at, shift=True)
    assert editor.state.camera != camera and editor.edit.handles == (pin,)


def test_a_pin_that_becomes_soft_is_a_handle_of_its_vertex_again(editor, pin):
    editor.handles.set_kind("soft")
    (handle,) = editor.edit.handles
    assert handle.vertices == pin.vertices[:1] and not handle.patch and not handle.radius


def test_a_region_keeps_its_patch_as_a_pin(editor, heard):
    editor.handles.add_region(range(40, 56))
    editor.handles.set_kind("pin")
    (handle,) = editor.edit.handles
    assert handle.kind == "pin" and handle.patch == tuple(range(40, 56)) and not handle.radius
    press(editor, "+")
    assert any("P pins" in text for text in texts(heard, NoticeGiven))


def test_without_anything_under_the_mouse_the_selection_is_pinned(editor):
    editor.handles.place(100)
    editor.commit("Place handle")
    event(editor, "MouseMove", (3, 3))
    press(editor, "P")
    (handle,) = editor.edit.handles
    assert handle.kind == "pin" and handle.vertices[0] == 100


def test_the_patch_is_coloured(editor, pin):
    colour = np.array(ImageColor.getrgb(KINDS["pin"]))

    def like_it():
        editor.state.invalidate()
        finish(editor)
        picture = editor.state.view.grab()[..., :3].astype(int)
        return (np.abs(picture - colour).sum(axis=2) < 120).sum()

    editor.handles.select([])
    with_pin = like_it()
    for _ in range(3):
        editor.pins.resize(1.0, editor.edit.handles)
    larger = like_it()
    editor.handles.clear()
    assert 2 * like_it() < with_pin < 0.8 * larger  # how much is seen depends on the place


def test_a_session_keeps_the_size(editor, pin, tmp_path):
    editor.save_session(tmp_path / "work.json")
    assert Session.load(tmp_path / "work.json").edit.handles == (pin,)


def test_a_larger_pin_keeps_its_place_in_a_pose(editor, pin):
    """The patch is where it was shown, in a pose far from the reference."""
    editor.handles.place(110)
    editor.handles.move_selected(translation([-0.2, 0.4, 0.3]))
    editor.commit("Place and drag")
    finish(editor)
    before = editor.vertices
    editor.pins.resize(3.0, [editor.edit.handles[0]])
    finish(editor)
    larger = editor.edit.handles[0]
    np.testing.assert_allclose(larger.targets, before[list(larger.vertices)])


@pytest.mark.parametrize("kinds", [("exact",), ("soft", "exact", "soft")])
def test_a_pin_after_a_drag_leaves_the_surface_where_it_is(editor, kinds):
    """With handles that pull: a pin pulls the prior as the handle did."""
    for vertex, kind in zip((0, 60, 110), kinds, strict=False):
        editor.handles.select([editor.handles.place(vertex)])
        editor.commit("Place")
        editor.handles.set_kind(kind)
    finish(editor)
    editor.handles.select([editor.edit.handles[0].id])
    editor.handles.move_selected(translation([-0.2, 0.4, 0.3]))
    editor.commit("Drag")
    finish(editor)
    before, diagonal = editor.vertices.copy(), editor.model.reference.bounding_diagonal
    editor.pins.radius = 0.12
    editor.handles.set_kind("pin")
    finish(editor)
    assert editor.answer.final and editor.edit.handles[0].kind == "pin"
    assert largest(editor.vertices - before) < 2e-3 * diagonal
    pin = editor.edit.handles[0]  # its centre alone pulls the prior, as the handle did
    gaps = deformer.surface_gaps(editor.model, editor.answer.pose, pin.vertices)
    pull = np.linalg.norm(gaps_of(pin) - gaps, axis=1)
    assert len(pull) > 3 and pull[1:].max() < 1e-4 * diagonal < pull[0]
