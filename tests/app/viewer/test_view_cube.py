"""The orientation cube: what is under the mouse, and the directions that a click gives."""

import itertools

import numpy as np
import pytest

from deformer_app.rendering.camera import Camera, aim, upright_axes
from deformer_app.viewer.view_cube import HALF, centre, looking_from, outlines, side_at
from number_fields import type_centre
from off_screen_editor import SIZE, click, drag, event, finish

SIDES = [side for side in itertools.product((-1, 0, 1), repeat=3) if any(side)]
SHAPE = np.random.default_rng(0).normal(size=(20, 3))


def seen_at(point, axes):
    """The pixel of a point of the cube."""
    right, up, _ = axes
    return tuple(centre(SIZE) + HALF * np.array([point @ right, -(point @ up)]))


@pytest.mark.parametrize("side", SIDES)
def test_the_middle_of_every_part_that_is_seen_is_that_part(side):
    axes = aim(SHAPE, azimuth=37.0, elevation=28.0).axes()
    facing = [square for square in outlines(side) if np.sign(square.mean(axis=0)) @ axes[2] > 0.2]
    for square in outlines(side):
        axis = int(np.ptp(square, axis=0).argmin())
        if square[0, axis] * axes[2][axis] > 0.1:
            assert side_at(seen_at(square.mean(axis=0), axes), axes, SIZE) == side
    assert len(facing) <= 3


def test_beside_the_cube_there_is_nothing():
    axes = aim(SHAPE, azimuth=45.0, elevation=35.0).axes()
    x, y = centre(SIZE)
    for apart in ((60, 0), (-60, 0), (0, 60), (0, -60)):
        assert side_at((x + apart[0], y + apart[1]), axes, SIZE) is None
    assert side_at((x, y), axes, SIZE) is not None


@pytest.mark.parametrize("up", ["y", "z", "-x"])
@pytest.mark.parametrize("side", SIDES)
def test_a_side_is_looked_at_straight_and_upright(up, side):
    frame = upright_axes(up)
    before = Camera((3.0, -4.0, 2.0), (0.2, 0.1, 0.5), (0.0, 0.0, 1.0), height=2.0)
    camera = looking_from(side, before, frame)
    backward = frame @ camera.axes()[2]
    np.testing.assert_allclose(backward, np.array(side) / np.sqrt(np.abs(side).sum()), atol=1e-12)
    assert camera.focal == before.focal and camera.height == before.height
    assert camera.distance == pytest.approx(before.distance)
    upward = frame @ camera.axes()[1]
    assert upward[1] > 0 or (upward == (0, 0, -side[1])).all()
    # The part in the middle of the cube is then that part.
    assert side_at(tuple(centre(SIZE)), camera.axes() @ frame.T, SIZE) == side


def cube_pixels(editor):
    x, y = centre(SIZE).astype(int)
    return editor.state.view.grab()[y - 40 : y + 41, x - 40 : x + 41].astype(int)


def test_a_click_on_a_face_looks_from_there_and_a_drag_turns(editor):
    frame = editor.state.view.frame
    focal = editor.state.camera.focal
    axes = editor.state.camera.axes() @ frame.T
    at = tuple(np.floor(seen_at(np.array([0, 0, 1.0]), axes)) + 0.5)
    assert editor.stage.vertex_at(at) is None
    event(editor, "MouseMove", at)
    assert editor.state.hovered.side == (0, 0, 1)
    click(editor, at)
    np.testing.assert_allclose(frame @ editor.state.camera.axes()[2], [0, 0, 1], atol=1e-12)
    assert editor.state.camera.focal == focal
    middle = tuple(centre(SIZE))
    drag(editor, middle, (middle[0] - 60, middle[1] + 20))
    assert (frame @ editor.state.camera.axes()[2])[2] < 0.99
    assert editor.edit.handles == () and len(editor.session.entries) == 1


def test_a_manipulator_behind_the_cube_is_seen_through_it_and_pressed(editor):
    """No press on an axis or on the handle that it moves turns the view, also within the cube."""
    x, y = centre(SIZE)
    editor.handles.place(100)
    editor.commit("Place handle")
    gizmo, camera = editor.stage.gizmo, editor.state.camera
    depth = float(camera.depths([gizmo.centre])[0])
    there, here = (camera.unproject(p, depth, SIZE) for p in ((x - 25, y + 5), (60, 300)))

    def move_to(point):
        type_centre(editor, point)
        finish(editor)
        return cube_pixels(editor)

    away, covered = move_to(here), move_to(there)
    assert np.abs(covered - away).max(axis=2).mean() > 20, "the cube is faded"
    gizmo = editor.stage.gizmo
    pressed = set()
    for part in gizmo.parts_seen(camera):
        line = camera.project(gizmo.outline(part, camera, SIZE), SIZE)
        for at in np.floor(np.linspace(line[0], line[1], 9)) + 0.5:
            if editor.stage.cube_at(tuple(at)) is not None:
                event(editor, "MouseMove", at)
                assert editor.state.hovered.side is None
                pressed.add(editor.state.hovered.part)
    assert len(pressed - {None}) >= 2
    event(editor, "MouseMove", (x + 15, y - 10))
    assert editor.state.hovered.side is not None
    event(editor, "MouseMove", (5, 350))
    np.testing.assert_array_equal(move_to(here), away)


def test_the_cube_is_drawn_turned_lit_and_left_out(editor):
    editor.picture.frame(0, 0)
    finish(editor)
    front = cube_pixels(editor)
    editor.picture.frame(90, 0)
    finish(editor)
    left = cube_pixels(editor)
    assert (front != left).any(axis=2).mean() > 0.02  # other words
    event(editor, "MouseMove", tuple(centre(SIZE)))
    finish(editor)
    assert (cube_pixels(editor) != left).any(axis=2).mean() > 0.05
    event(editor, "MouseMove", (5, 350))
    editor.picture.change_look(cube=False)
    finish(editor)
    empty = cube_pixels(editor)
    assert (empty != left).any(axis=2).mean() > 0.2
    assert editor.stage.cube_at(tuple(centre(SIZE))) is None
    # A picture for others shows none, either, and the window has it again afterwards.
    editor.picture.change_look(cube=True)
    finish(editor)
    x, y = centre(SIZE).astype(int)
    exported = editor.state.view.picture()[y - 40 : y + 41, x - 40 : x + 41].astype(int)
    assert np.abs(exported - empty).max() <= 2
    editor.state.view.render()
    assert np.abs(cube_pixels(editor) - empty).max() > 20
