"""How far off the examples a code is, as a percentile of examples left out."""

from dataclasses import replace

import numpy as np
import pytest

from deformer import Familiarity
from shapes import small_model


def with_codes(white, train=None):
    """The small model with other training codes, given in the prior's deviations (N, K)."""
    model = small_model()
    codes = model.prior.mean + white @ model.prior.factor.T
    order = list(range(len(codes))) if train is None else train
    return replace(model, codes=codes, split={"train": order, "test": []})


def code(model, white):
    return model.prior.mean + model.prior.factor @ white


def motion(frames, seed=0, slowness=20.0):
    """Whitened codes (frames, K) of a motion that forgets itself after some `slowness` frames."""
    rng, t = np.random.default_rng(seed), np.arange(frames)
    kernel = np.exp(-0.5 * ((t[:, None] - t) / slowness) ** 2) + 1e-8 * np.eye(frames)
    draws = rng.normal(size=(frames, small_model().components))
    return np.linalg.cholesky(kernel) @ draws


def quartiles(model, unseen):
    familiarity = Familiarity(model)
    return np.quantile([familiarity.percentile(code(model, y)) for y in unseen], [0.25, 0.5, 0.75])


def test_training_codes_are_familiar_and_far_ones_are_not():
    model = small_model()
    familiarity = Familiarity(model)
    assert max(familiarity.percentile(z) for z in model.codes) < 1e-9
    assert [familiarity.nearest(z)[0] for z in model.codes] == list(range(len(model.codes)))
    mean, first = model.prior.mean, model.codes[0]
    away = [familiarity.percentile(mean + s * (first - mean)) for s in (2.0, 4.0, 8.0)]
    assert 0 < away[0] < away[1] < away[2] and away[2] > 100


def test_shapes_in_no_order_are_left_out_one_by_one():
    rng = np.random.default_rng(1)
    K = small_model().components
    white = rng.normal(size=(300, K))
    model = with_codes(white)
    familiarity = Familiarity(model)
    gaps = np.linalg.norm(white[:, None] - white, axis=2) + 1e9 * np.eye(len(white))
    assert familiarity.window <= 1
    assert np.quantile(familiarity.left_out, 0.5) == pytest.approx(
        np.median(gaps.min(axis=1)), rel=0.05
    )
    low, middle, high = quartiles(model, rng.normal(size=(300, K)))
    assert 10 < low < 40 and 35 < middle < 65 and 60 < high < 90


def test_frames_that_are_close_in_time_do_not_make_all_else_far():
    """Blocks of frames that were never seen are as far off as examples left out are."""
    white = motion(1000)
    blocks = np.arange(1000) // 60 % 5 == 4
    model = with_codes(white[~blocks])
    familiarity = Familiarity(model)
    nearest = np.linalg.norm(np.diff(white, axis=0), axis=1)
    assert familiarity.window >= 10
    assert np.median(familiarity.left_out) > 5 * np.median(nearest)
    low, middle, high = quartiles(model, white[blocks])
    assert low < 50 and 10 < middle < 90 and high <= 130
    assert familiarity.percentile(code(model, np.full(model.components, 20.0))) > 300


def test_the_order_is_that_of_the_shapes_and_not_of_the_codes():
    white = motion(200)
    shuffled = np.random.default_rng(2).permutation(200)
    ordered, mixed = with_codes(white), with_codes(white[shuffled], shuffled.tolist())
    assert Familiarity(mixed).window == Familiarity(ordered).window > 5
    np.testing.assert_allclose(Familiarity(mixed).left_out, Familiarity(ordered).left_out)


def test_beyond_the_farthest_example_the_scale_goes_on():
    """Examples on a line, 1, 2 and 3 apart; along another axis a code is as far as it is off."""
    K = small_model().components
    white = np.zeros((4, K))
    white[:, 0] = [0, 1, 3, 6]
    model = with_codes(white)
    familiarity = Familiarity(model)
    np.testing.assert_allclose(familiarity.left_out, [1, 1, 2, 3], atol=1e-9)
    for distance, percentile in ((0.5, 12.5), (1.5, 62.5), (2.5, 87.5), (3.0, 100), (9.0, 300)):
        away = np.zeros(K)
        away[1] = distance
        assert familiarity.percentile(code(model, away)) == pytest.approx(percentile)


@pytest.mark.parametrize("count", [1, 5])
def test_examples_that_are_one_shape_tell_nothing_of_distances(count):
    model = with_codes(np.zeros((count, small_model().components)))
    K = model.components
    away = np.zeros(K)
    away[0] = 2.0 * np.sqrt(2.0 * K)
    assert Familiarity(model).percentile(code(model, away)) == pytest.approx(200.0)
