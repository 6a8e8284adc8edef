"""The manipulator: what is hit, and what a drag of each part does."""

from itertools import pairwise

import numpy as np
import pytest

from deformer_app.rendering.camera import Camera
from deformer_app.viewer.gizmo import Gizmo, axis_length, rotation, scaling, translation

SIZE = (800, 600)
CAMERA = Camera((4.0, -6.0, 3.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
CENTRE = (0.2, -0.1, 0.3)


def middle(gizmo, part):
    line = CAMERA.project(gizmo.outline(part, CAMERA, SIZE), SIZE)
    return line.mean(axis=0) if len(line) in (2, 5) else line[10]


def dragged(gizmo, part, start, now):
    """The motion of a drag of a part, in two steps."""
    half = 0.5 * (np.asarray(start, dtype=float) + now)
    steps = [gizmo.step(part, *way, CAMERA, SIZE) for way in ((start, half), (half, now))]
    return gizmo.motion(part, sum(steps))


@pytest.mark.parametrize("mode", ["move", "rotate", "scale"])
def test_every_part_is_taken_where_it_is_drawn(mode):
    gizmo = Gizmo(CENTRE, mode)
    for part in gizmo.parts:
        assert gizmo.part_at(middle(gizmo, part), CAMERA, SIZE) == part
    assert gizmo.part_at((5.0, 5.0), CAMERA, SIZE) is None


def test_its_size_on_the_screen_does_not_depend_on_the_distance():
    for camera in (CAMERA, CAMERA.zoomed(5.0, (400, 300), SIZE)):
        ring = camera.project(Gizmo(CENTRE, "rotate").outline("rz", camera, SIZE), SIZE)
        across = np.ptp(ring, axis=0).max()
        assert across == pytest.approx(2 * axis_length(SIZE), rel=0.1)


def test_it_is_smaller_in_a_small_picture_and_not_larger_in_a_large_one():
    assert axis_length((850, 330)) < axis_length((500, 480)) < axis_length((1600, 1200))
    assert axis_length((1600, 1200)) == axis_length((3000, 2000))
    small = (400, 300)
    ring = CAMERA.project(Gizmo(CENTRE, "rotate").outline("rz", CAMERA, small), small)
    assert np.ptp(ring, axis=0).max() == pytest.approx(2 * axis_length(small), rel=0.1)


@pytest.mark.parametrize("part", ["x", "y", "z"])
def test_an_axis_moves_along_itself_and_under_the_mouse(part):
    gizmo = Gizmo(CENTRE, "move")
    axis = np.eye(3)["xyz".index(part)]
    start, now = CAMERA.project([CENTRE, CENTRE + 0.4 * axis], SIZE)
    moved = dragged(gizmo, part, start, now)([CENTRE])[0] - CENTRE
    np.testing.assert_allclose(moved, 0.4 * axis, atol=1e-9)


def test_a_plane_moves_within_itself_and_under_the_mouse():
    gizmo = Gizmo(CENTRE, "move")
    step = np.array([0.3, 0.0, -0.2])
    start, now = CAMERA.project([CENTRE, CENTRE + step], SIZE)
    moved = dragged(gizmo, "zx", start, now)([CENTRE])[0] - CENTRE
    np.testing.assert_allclose(moved, step, atol=1e-9)


def test_a_ring_turns_by_the_angle_that_the_mouse_has_gone():
    gizmo = Gizmo(CENTRE, "rotate")
    radius, turn = np.array([0.3, 0.0, 0.0]), rotation([0, 0, 0], [0, 0, 0.7])
    arm = turn(radius[None])[0]
    start, now = CAMERA.project([CENTRE + radius, CENTRE + arm], SIZE)
    motion = dragged(gizmo, "rz", start, now)
    np.testing.assert_allclose(motion([CENTRE + radius])[0], CENTRE + arm, atol=1e-9)
    np.testing.assert_allclose(motion([CENTRE])[0], CENTRE, atol=1e-12)


def test_scaling_doubles_to_the_right_and_undoes_to_the_left():
    gizmo = Gizmo(CENTRE, "scale")
    grown = dragged(gizmo, "s", (100, 100), (220, 100))
    shrunk = dragged(gizmo, "s", (100, 100), (-20, 100))
    p = np.array([[1.0, 2.0, 3.0]])
    np.testing.assert_allclose(grown(p) - CENTRE, 2 * (p - CENTRE))
    np.testing.assert_allclose(shrunk(grown(p)), p)


def test_an_axis_seen_end_on_cannot_be_dragged():
    camera = Camera((0.0, 0.0, 9.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    gizmo = Gizmo((0.0, 0.0, 0.0), "move")
    assert gizmo.step("z", (400, 300), (420, 300), camera, SIZE) is None
    assert gizmo.parts_seen(camera) == ["x", "y", "xy"]


def test_a_ring_turns_further_than_half_a_turn():
    gizmo, steps = Gizmo(CENTRE, "rotate"), []
    angles = np.linspace(0, 1.5 * np.pi, 30)
    arms = np.stack([np.cos(angles), np.sin(angles), np.zeros(30)], axis=1)
    pixels = CAMERA.project(CENTRE + 0.3 * arms, SIZE)
    for before, now in pairwise(pixels):
        steps.append(gizmo.step("rz", before, now, CAMERA, SIZE))
    np.testing.assert_allclose(sum(steps), [1.5 * np.pi])


def test_a_ring_seen_from_its_side_turns_what_is_in_front_with_the_mouse():
    camera = Camera((0.0, 0.0, 9.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    gizmo = Gizmo((0.0, 0.0, 0.0), "rotate")
    front = np.array([[0.0, 0.0, 0.5]])
    for part, way in (("ry", (30, 0)), ("rx", (0, 30))):
        step = gizmo.step(part, (400, 300), np.add((400, 300), way), camera, SIZE)
        np.testing.assert_allclose(abs(step), 30 / axis_length(SIZE))
        after = camera.project(gizmo.motion(part, step)(front), SIZE)[0] - (400, 300)
        assert after @ way > 0 and abs(after[0] * way[1] - after[1] * way[0]) < 1e-6


def test_its_axes_may_be_turned():
    tilt = rotation([0, 0, 0], [0.3, 0.2, -0.5]).matrix
    frame = tuple(tuple(float(c) for c in axis) for axis in tilt.T)
    gizmo = Gizmo(CENTRE, "move", frame)
    np.testing.assert_allclose(gizmo.motion("y", [0.4])([CENTRE])[0], CENTRE + 0.4 * tilt[:, 1])
    start, now = CAMERA.project([CENTRE, CENTRE + 0.4 * tilt[:, 2]], SIZE)
    np.testing.assert_allclose(gizmo.step("z", start, now, CAMERA, SIZE), [0.4])
    turn = Gizmo(CENTRE, "rotate", frame).motion("rx", [0.7]).matrix
    np.testing.assert_allclose(turn, tilt @ rotation([0, 0, 0], [0.7, 0, 0]).matrix @ tilt.T)


def test_motions():
    p = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    np.testing.assert_allclose(translation([1, 2, 3])(p), p + np.array([1, 2, 3]))
    np.testing.assert_allclose(rotation([0, 0, 0], [0, 0, np.pi / 2])(p), [[0, 1, 0], [-2, 0, 0]],
                               atol=1e-12)  # fmt: skip
    np.testing.assert_allclose(scaling([1, 0, 0], 3.0)(p), [[1, 0, 0], [-2, 6, 0]])
