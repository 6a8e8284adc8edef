"""Uncertainty against sampling, and the promise of its suggestions."""

import numpy as np
import pytest

from deformer import HandleSolver, InputError
from deformer.editing import uncertainty
from shapes import small_model


@pytest.fixture(scope="module")
def model():
    return small_model()


def solved(model, vertices, **options):
    solver = HandleSolver(model, **options)
    solver.set_handles(vertices, model.decode(model.codes[2])[vertices])
    solver.solve()
    return solver


def test_deviation_is_that_of_sampled_shapes(model):
    """Without handles the posterior is the prior: draw codes close to it and look at shapes."""
    solver = HandleSolver(model, rigid=False)
    solver.solve()
    share = 0.02  # small enough for shapes to be linear in codes
    y = np.random.default_rng(0).normal(size=(4000, model.components))
    shapes = model.decode(model.prior.mean + share * y @ model.prior.factor.T)
    expected = np.sqrt(shapes.var(axis=0).sum(axis=1)) / share
    found = uncertainty(solver).deviation
    np.testing.assert_allclose(found, expected, rtol=0.06)


@pytest.mark.parametrize("freedom", [1.0, 0.02])
def test_gain_is_what_another_handle_takes_away(model, freedom):
    solver = solved(model, [4, 60], freedom=freedom)
    before = uncertainty(solver)
    for vertex in (before.suggestion, 17, 100):
        pose = solver.solve(warm=True)
        other = HandleSolver(model, freedom=freedom)
        other.set_handles([4, 60, vertex], [*(h.target for h in solver.handles),
                                            pose.vertices[vertex]])  # fmt: skip
        other.restore(pose.z, pose.rotation, pose.translation)
        after = uncertainty(other)
        left = (after.deviation**2).sum() / (before.deviation**2).sum()
        assert 1 - left == pytest.approx(before.gain[vertex], abs=0.02)


def test_the_suggestion_gains_most_and_is_no_handle_yet(model):
    handles = [4, 60, 119]
    found = uncertainty(solved(model, handles))
    assert found.suggestion not in handles
    assert found.gain[found.suggestion] == found.gain.max() <= 1
    assert found.gain.min() >= 0
    assert found.gain[handles].max() < 0.6 * found.gain.max()


def test_handles_hold_what_is_near_them(model):
    found = uncertainty(solved(model, [4, 60, 119]))
    assert found.deviation[[4, 60, 119]].max() < 0.5 * found.deviation.max()


def test_before_any_solution_there_is_none(model):
    with pytest.raises(InputError, match="solve"):
        uncertainty(HandleSolver(model))
