"""The share and the remaining time of a training over all its stages."""

import pytest

from deformer import TrainingProgress
from deformer_app.viewer.training_estimate import TrainingEstimate, in_words


def test_the_share_grows_over_all_stages_and_ends_at_one():
    estimate = TrainingEstimate()
    shares = []
    for stage in ("loading", "features", "cross-validation", "training"):
        for done in (1, 5, 10):
            estimate.follow(TrainingProgress(stage, done, 10))
            shares.append(estimate.share)
    assert shares == sorted(shares) and len(set(shares)) == len(shares)
    assert shares[-1] == 1.0


def test_a_stage_that_is_left_out_is_skipped_and_a_late_report_does_not_go_back():
    estimate = TrainingEstimate()
    estimate.follow(TrainingProgress("training", 1, 2))
    share = estimate.share
    estimate.follow(TrainingProgress("features", 1, 2))
    assert estimate.share == share > 0.5


def test_the_time_left_follows_from_the_rate():
    now = [100.0]
    estimate = TrainingEstimate(lambda: now[0])
    assert estimate.seconds_left is None
    estimate.follow(TrainingProgress("features", 10, 10))  # a quarter of the whole
    now[0] += 30.0
    assert estimate.seconds_left == pytest.approx(90.0)


def test_the_time_of_compiling_is_left_out():
    now = [0.0]
    estimate = TrainingEstimate(lambda: now[0])
    now[0] = 10.0
    estimate.hold(True)
    now[0] = 60.0
    estimate.follow(TrainingProgress("features", 10, 10))  # a quarter of the whole
    assert estimate.seconds_left == pytest.approx(30.0)
    estimate.hold(True)
    now[0] = 100.0
    estimate.hold(False)
    assert estimate.seconds_left == pytest.approx(30.0)
    now[0] = 110.0
    assert estimate.seconds_left == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(None, "estimating"), (3, "few seconds"), (47, "50 s"), (600, "10 min"), (9000, "2.5 h")],
)
def test_the_time_left_is_told_in_words(seconds, words):
    assert words in in_words(seconds)
