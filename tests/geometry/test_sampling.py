"""Truths of farthest points: each is the farthest from those before it, by any distance."""

import numpy as np
import pytest

from deformer.geometry.sampling import farthest_rows, spread


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_rows_are_farthest_points_with_their_nearest(dtype):
    points = np.random.default_rng(0).normal(size=(300, 5)).astype(dtype)
    chosen, labels = farthest_rows(points, 40)
    distances = np.linalg.norm(points[:, None] - points[chosen], axis=2)
    assert chosen[0] == 0 and len(set(chosen.tolist())) == 40
    for n in range(1, 40):
        nearest = distances[:, :n].min(axis=1)
        assert nearest[chosen[n]] >= nearest.max() * (1 - 1e-5)
    np.testing.assert_array_equal(labels, distances.argmin(axis=1))


def test_points_at_one_place_are_chosen_once_each():
    assert sorted(farthest_rows(np.ones((4, 2)), 4)[0].tolist()) == [0, 1, 2, 3]
    assert sorted(spread(np.ones((4, 2)), 9).tolist()) == [0, 1, 2, 3]


def test_spread_begins_next_to_the_origin():
    points = np.array([[3.0, 0], [0.1, 0], [-2, 0], [0, 1]])
    assert spread(points, 3).tolist() == [1, 0, 2]
