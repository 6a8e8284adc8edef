"""The shown surface goes to a better pose smoothly, and arrives."""

import numpy as np
import pytest

from deformer_app.viewer.eased_offset import EasedOffset

FRAME = 1 / 60


def shown(offset, frames, pose, start=0.0):
    """The surfaces of some frames, from a time on."""
    surfaces = []
    for n in range(1, frames + 1):
        offset.advance(start + n * FRAME)
        surfaces.append(offset.added_to(pose))
    return np.array(surfaces)


def test_it_starts_where_the_surface_was_and_arrives_in_half_a_second():
    old, new = np.zeros((2, 3)), np.array([[1.0, 0, 0], [0, 0, 0]])
    offset = EasedOffset(1.0)
    offset.add(old - new, 0.0)
    np.testing.assert_array_equal(offset.added_to(new), old)
    surfaces = shown(offset, 60, new)
    steps = np.linalg.norm(np.diff([old, *surfaces], axis=0), axis=2)
    assert steps[0, 0] < 0.05 and steps.max() < 0.11, "a jolt"
    assert (steps[:, 1] == 0).all(), "a vertex whose place is the same has moved"
    assert np.abs(surfaces[29] - new).max() < 0.01
    assert not offset
    np.testing.assert_array_equal(surfaces[-1], new)


@pytest.mark.parametrize("every", [1, 4])
def test_poses_on_the_way_change_neither_place_nor_speed(every):
    offset, pose, time = EasedOffset(1.0), np.zeros((1, 3)), 0.0
    places = [0.0]
    for n in range(60):
        if n % every == 0 and n < 24:
            better = pose + np.array([[0.04 * every, 0, 0]])
            before = offset.added_to(pose)
            offset.add(pose - better, time)
            np.testing.assert_allclose(offset.added_to(better), before, atol=1e-12)
            pose = better
        time += FRAME
        offset.advance(time)
        places.append(offset.added_to(pose)[0, 0])
    speeds = np.diff(places)
    assert speeds.min() >= 0 and np.abs(np.diff(speeds)).max() < 0.02
    assert places[-1] == pytest.approx(0.96, abs=1e-3)


def test_clearing_shows_the_pose_at_once():
    offset, pose = EasedOffset(1.0), np.ones((1, 3))
    offset.add(-pose, 0.0)
    offset.clear()
    assert not offset
    np.testing.assert_array_equal(offset.added_to(pose), pose)


def test_small_steps_are_no_offsets():
    offset = EasedOffset(100.0)
    offset.add(np.full((1, 3), 1e-3), 0.0)
    assert not offset
