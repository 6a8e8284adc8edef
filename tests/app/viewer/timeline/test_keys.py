"""Keys as values: what is between them, and what commands make of them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from deformer_app.viewer.edit import Edit, Handle
from deformer_app.viewer.timeline.interpolation import Curve
from deformer_app.viewer.timeline.keys import (
    SLIDERS,
    Clip,
    Key,
    Placement,
    Track,
    changed_owners,
    keys_of,
)
from deformer_app.viewer.timeline.onion import Onion, opacity
from deformer_app.viewer.timeline.playback import Playback

BASE = (0.5, -1.0, 0.25)
numbers = st.floats(-10, 10, allow_nan=False)


def placed(*at, turn=None):
    rows = None
    if turn is not None:
        matrix = Rotation.from_euler("z", turn, degrees=True).as_matrix()
        rows = tuple(map(tuple, matrix.tolist()))
    return Placement((tuple(map(float, at)),), rows)


def clip_of(*keys, owner=7):
    return Clip().with_keys((owner, Key(*key)) for key in keys)


def test_between_two_eased_keys_the_way_is_3_t_t_minus_2_t_t_t():
    track = clip_of((10, placed(0, 0, 0)), (20, placed(1, 2, -4))).track(7)
    for frame, share in ((0, 0), (10, 0), (15, 0.5), (12, 3 * 0.04 - 2 * 0.008), (20, 1), (99, 1)):
        found = track.placement(frame).targets[0]
        np.testing.assert_allclose(found, share * np.array([1, 2, -4]), atol=1e-12)


def test_a_linear_key_goes_straight_to_the_next_one():
    track = clip_of((0, placed(0, 0, 0), "linear"), (10, placed(1, 2, -4))).track(7)
    np.testing.assert_allclose(track.placement(3).targets[0], [0.3, 0.6, -1.2])


def test_an_eased_motion_goes_through_a_key_without_a_stop_and_rests_at_an_extreme():
    through = Curve([0, 10, 20], [[0.0], [1.0], [2.0]], [False] * 3)
    assert through([10.5])[0, 0] - through([9.5])[0, 0] == pytest.approx(0.1, rel=0.06)
    extreme = Curve([0, 10, 20], [[0.0], [1.0], [0.0]], [False] * 3)
    assert abs(extreme([10.5])[0, 0] - extreme([9.5])[0, 0]) < 1e-12
    assert extreme([10])[0, 0] - extreme([9.5])[0, 0] < 0.01


@given(st.lists(st.tuples(st.integers(0, 60), numbers, st.booleans()), min_size=1, max_size=8))
def test_a_curve_has_the_keys_values_and_never_leaves_the_range_of_two_keys(keys):
    by_frame = {frame: (value, straight) for frame, value, straight in keys}
    frames = sorted(by_frame)
    values = np.array([by_frame[frame][0] for frame in frames])
    curve = Curve(frames, values[:, None], [by_frame[frame][1] for frame in frames])
    np.testing.assert_allclose(curve(frames)[:, 0], values, atol=1e-12)
    for n, (start, end) in enumerate(pairwise(frames)):
        between = curve(np.linspace(start, end, 17))[:, 0]
        assert between.min() >= min(values[n : n + 2]) - 1e-9
        assert between.max() <= max(values[n : n + 2]) + 1e-9


def test_orientations_turn_at_the_eased_share_of_the_angle():
    track = clip_of((0, placed(0, 0, 0, turn=10)), (8, placed(0, 0, 0, turn=100))).track(7)
    for frame, angle in ((0, 10), (4, 55), (2, 10 + 90 * 0.15625), (8, 100)):
        expected = Rotation.from_euler("z", angle, degrees=True).as_matrix()
        np.testing.assert_allclose(track.placement(frame).orientation, expected, atol=1e-7)


def test_an_orientation_without_another_to_turn_to_stays_until_the_next_key():
    free = placed(1, 0, 0)
    track = clip_of((0, placed(0, 0, 0, turn=30)), (8, free), (12, placed(0, 0, 0, turn=60)))
    track = track.track(7)
    assert track.placement(7).orientation == track.placement(0).orientation
    assert track.placement(9).orientation is None
    assert track.placement(20).orientation == track.placement(12).orientation is not None


def test_codes_of_the_sliders_go_in_a_straight_line_through_their_space():
    clip = Clip().with_keys([(SLIDERS, Key(0, BASE)), (SLIDERS, Key(10, (1.5, 1.0, 0.25)))])
    found = np.array(clip.at(Edit(BASE), 5).base)
    np.testing.assert_allclose(found, [1.0, 0.0, 0.25])


def test_the_state_of_a_frame_has_keyed_handles_placed_and_others_where_they_were():
    keyed, free = Handle(7, (3,), ((9.0, 9.0, 9.0),), "exact"), Handle(8, (4,), ((1.0, 1.0, 1.0),))
    edit = Edit(BASE, (keyed, free))
    clip = clip_of((0, placed(0, 0, 0)), (10, placed(2, 0, 0)))
    found = clip.at(edit, 5)
    assert found.handle(7) == replace(keyed, targets=((1.0, 0.0, 0.0),))
    assert found.handle(8) == free and found.base == BASE
    assert clip.at(found, 0) == clip.at(edit, 0)


def test_a_handle_that_was_keyed_with_other_vertices_goes_with_its_first_one():
    """A pin that was made larger, or a vertex that became a pin, after its keys were set."""
    disc = Handle(7, (3, 4), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), "pin")
    clip = clip_of((0, placed(0, 0, 0)), (10, placed(2, 4, 0)))
    assert clip.at(Edit(BASE, (disc,)), 10).handle(7).targets == ((2.0, 4.0, 0.0), (3.0, 4.0, 0.0))
    mixed = clip.with_keys([(7, Key(20, Placement(disc.targets)))])
    found = mixed.at(Edit(BASE, (disc,)), 20).handle(7)
    assert found.targets == disc.targets and found.vertices == (3, 4)


def test_a_key_at_a_frame_that_has_one_replaces_it_and_frames_stay_in_order():
    clip = clip_of((20, placed(1, 0, 0)), (5, placed(2, 0, 0)), (20, placed(3, 0, 0)))
    assert clip.names == [(7, 5), (7, 20)]
    assert clip.key((7, 20)).value == placed(3, 0, 0)
    assert clip.key((7, 6)) is None and clip.key((8, 5)) is None


def test_a_clip_becomes_as_long_as_its_keys_need():
    assert clip_of((10, placed(0, 0, 0))).length == Clip().length
    assert clip_of((100, placed(0, 0, 0))).length == 101


def test_moved_keys_keep_their_distances_and_replace_what_is_there():
    clip = clip_of((2, placed(1, 0, 0)), (4, placed(2, 0, 0)), (7, placed(3, 0, 0)))
    right = clip.moved([(7, 2), (7, 4)], 3)
    assert right.names == [(7, 5), (7, 7)]
    assert right.key((7, 7)).value == placed(2, 0, 0)
    left = clip.moved([(7, 4), (7, 7)], -100)
    assert left.names == [(7, 0), (7, 2), (7, 3)]


def test_a_track_without_keys_is_gone():
    clip = clip_of((2, placed(1, 0, 0)))
    assert clip.without([(7, 2)]).tracks == ()
    assert clip.without([(7, 3), (8, 2)]) == clip


def test_the_next_key_is_that_of_any_track():
    clip = clip_of((2, placed(1, 0, 0)), (9, placed(1, 0, 0)))
    clip = clip.with_keys([(SLIDERS, Key(5, BASE))])
    assert [clip.next_key(2, 1), clip.next_key(5, 1), clip.next_key(9, 1)] == [5, 9, None]
    assert [clip.next_key(9, -1), clip.next_key(3, -1), clip.next_key(2, -1)] == [5, 2, None]


def test_only_what_was_moved_counts_as_changed():
    first = Handle(1, (3,), ((0.0, 0.0, 0.0),))
    edit = Edit(BASE, (first,))
    heavier = edit.with_handles([replace(first, weight=2.0)])
    assert changed_owners(edit, heavier) == []
    moved = edit.with_handles([replace(first, targets=((1.0, 0.0, 0.0),))])
    assert changed_owners(edit, moved) == [1]
    assert changed_owners(edit, edit.with_handles([Handle(2, (4,), ((0.0, 0.0, 0.0),))])) == [2]
    assert changed_owners(edit, replace(edit, base=(0.0, 0.0, 0.0))) == [SLIDERS]
    assert changed_owners(edit, edit.with_handles([first.oriented(np.eye(3))])) == [1]


def test_keys_are_those_of_the_state_for_the_owners_asked_for():
    edit = Edit(BASE, (Handle(1, (3,), ((0.0, 0.0, 0.0),)), Handle(2, (4,), ((1.0, 0.0, 0.0),))))
    assert keys_of(edit, 4, [2, SLIDERS]) == [
        (2, Key(4, replace(placed(1, 0, 0), gaps=()))),
        (SLIDERS, Key(4, BASE)),
    ]


def test_playback_keeps_the_time_however_rarely_it_is_asked():
    loop = Playback(first=10, begun=5.0, fps=30, length=48, loop=True)
    assert [loop.frame(5.0 + n / 30) for n in range(3)] == [10, 11, 12]
    assert loop.frame(5.0 + 38 / 30) == 0 and loop.frame(5.0 + (38 + 48 + 7) / 30) == 7
    assert not loop.ended(1e6)
    once = replace(loop, loop=False)
    assert once.frame(100.0) == 47
    assert not once.ended(5.0 + 37.5 / 30) and once.ended(5.0 + 38.5 / 30)


def test_onion_skins_are_frames_at_equal_distances_or_those_of_keys():
    clip = replace(clip_of((2, placed(1, 0, 0)), (9, placed(1, 0, 0)), (30, placed(1, 0, 0))))
    skins = Onion(before=2, after=3, step=5)
    assert skins.frames(clip, 9) == {-1: 4, 1: 14, 2: 19, 3: 24}
    assert replace(skins, at_keys=True).frames(clip, 9) == {-1: 2, 1: 30}
    assert Onion().frames(clip, 9) == {}
    assert opacity(1) == opacity(-1) > opacity(2) > opacity(3) > 0


def test_a_track_is_a_value():
    first, second = clip_of((2, placed(1, 0, 0))), clip_of((2, placed(1, 0, 0)))
    first.track(7).placement(5)  # a curve that is kept makes no difference
    assert first == second and hash(first) == hash(second)
    assert Track(7, first.track(7).keys) == second.track(7)


def test_gaps_go_along_between_keys_and_are_the_handle_s_own_where_none_were_keyed():
    handle = Handle(7, (3,), ((0.0, 0.0, 0.0),), gaps=((5.0, 0.0, 0.0),))
    edit = Edit(BASE, (handle,))
    first = Placement(((0.0, 0.0, 0.0),), gaps=())
    last = Placement(((2.0, 0.0, 0.0),), gaps=((0.0, 4.0, 0.0),))
    clip = clip_of((0, first, "linear"), (10, last, "linear"))
    between = clip.at(edit, 5).handles[0]
    assert between.targets == ((1.0, 0.0, 0.0),) and between.gaps == ((0.0, 2.0, 0.0),)
    assert clip.at(edit, 0).handles[0].gaps == ()
    older = clip_of((0, replace(first, gaps=None), "linear"), (10, last, "linear"))
    assert older.at(edit, 5).handles[0].gaps == handle.gaps
