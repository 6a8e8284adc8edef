"""The manipulator: what is hit, and what a drag of each part does."""

import numpy as np
import pytest

from deformer_app.rendering.camera import Camera
from deformer_app.viewer.gizmo import LENGTH, Gizmo, rotation, scaling, translation

SIZE = (800, 600)
CAMERA = Camera((4.0, -6.0, 3.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
CENTRE = (0.2, -0.1, 0.3)


def middle(gizmo, part):
    line = CAMERA.project(gizmo.outline(part, CAMERA, SIZE), SIZE)
    return line.mean(axis=0) if len(line) in (2, 5) else line[10]


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
        assert across == pytest.approx(2 * LENGTH, rel=0.1)


@pytest.mark.parametrize("part", ["x", "y", "z"])
def test_an_axis_moves_along_itself_and_under_the_mouse(part):
    gizmo = Gizmo(CENTRE, "move")
    axis = np.eye(3)["xyz".index(part)]
    start, now = CAMERA.project([CENTRE, CENTRE + 0.4 * axis], SIZE)
    moved = gizmo.motion(part, start, now, CAMERA, SIZE)([CENTRE])[0] - CENTRE
    np.testing.assert_allclose(moved, 0.4 * axis, atol=1e-9)


def test_a_plane_moves_within_itself_and_under_the_mouse():
    gizmo = Gizmo(CENTRE, "move")
    step = np.array([0.3, 0.0, -0.2])
    start, now = CAMERA.project([CENTRE, CENTRE + step], SIZE)
    moved = gizmo.motion("zx", start, now, CAMERA, SIZE)([CENTRE])[0] - CENTRE
    np.testing.assert_allclose(moved, step, atol=1e-9)


def test_a_ring_turns_by_the_angle_that_the_mouse_has_gone():
    gizmo = Gizmo(CENTRE, "rotate")
    radius, turn = np.array([0.3, 0.0, 0.0]), rotation([0, 0, 0], [0, 0, 0.7])
    arm = turn(radius[None])[0]
    start, now = CAMERA.project([CENTRE + radius, CENTRE + arm], SIZE)
    motion = gizmo.motion("rz", start, now, CAMERA, SIZE)
    np.testing.assert_allclose(motion([CENTRE + radius])[0], CENTRE + arm, atol=1e-9)
    np.testing.assert_allclose(motion([CENTRE])[0], CENTRE, atol=1e-12)


def test_scaling_doubles_to_the_right_and_undoes_to_the_left():
    gizmo = Gizmo(CENTRE, "scale")
    grown = gizmo.motion("s", (100, 100), (220, 100), CAMERA, SIZE)
    shrunk = gizmo.motion("s", (100, 100), (-20, 100), CAMERA, SIZE)
    p = np.array([[1.0, 2.0, 3.0]])
    np.testing.assert_allclose(grown(p) - CENTRE, 2 * (p - CENTRE))
    np.testing.assert_allclose(shrunk(grown(p)), p)


def test_an_axis_seen_end_on_cannot_be_dragged():
    camera = Camera((0.0, 0.0, 9.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    gizmo = Gizmo((0.0, 0.0, 0.0), "move")
    assert gizmo.motion("z", (400, 300), (420, 300), camera, SIZE) is None


def test_motions():
    p = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    np.testing.assert_allclose(translation([1, 2, 3])(p), p + np.array([1, 2, 3]))
    np.testing.assert_allclose(rotation([0, 0, 0], [0, 0, np.pi / 2])(p), [[0, 1, 0], [-2, 0, 0]],
                               atol=1e-12)  # fmt: skip
    np.testing.assert_allclose(scaling([1, 0, 0], 3.0)(p), [[1, 0, 0], [-2, 6, 0]])
