"""Layouts: the best handles by exhaustive search, their promises, and what they must respect."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from deformer import HandleSolver, InputError, farthest_points, layout, load_model
from deformer.editing.handle_layout import _Choice
from deformer.editing.misfit_field import _LOCALITY, MisfitField, rebuilding_error
from deformer.editing.position_field import PositionField
from shapes import large_model, small_model


def summed_variance(C, weights, chosen, noise):
    """Weighted trace of C given noisy observations of the sites `chosen`."""
    h = (3 * np.array(chosen)[:, None] + np.arange(3)).ravel()
    left = C - C[:, h] @ np.linalg.solve(C[np.ix_(h, h)] + noise * np.eye(len(h)), C[h])
    return np.repeat(weights, 3) @ np.diag(left)


def random_field(seed, sites=9):
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(3 * sites, 7))
    weights = rng.uniform(0.5, 1.0, sites)
    return factor @ factor.T + 0.1 * np.eye(3 * sites), weights / weights.sum()


@pytest.mark.parametrize("seed", range(4))
def test_the_first_handle_is_the_best_of_all_and_more_are_nearly(seed):
    C, weights = random_field(seed)
    every = np.arange(9)[:, None]
    fixed = np.empty(0, dtype=np.int64)
    for count in (1, 2, 3):
        chosen = _Choice(C, weights, 0.01, [every], fixed).extend(count)
        all_left = [summed_variance(C, weights, h, 0.01) for h in combinations(range(9), count)]
        found = summed_variance(C, weights, chosen, 0.01)
        assert found <= (1 + 1e-9) * np.quantile(all_left, 0.0 if count == 1 else 0.15)


def test_no_handle_of_a_choice_would_be_better_elsewhere():
    C, weights = random_field(7, sites=20)
    choice = _Choice(C, weights, 0.01, [np.arange(20)[:, None]], np.empty(0, dtype=np.int64))
    chosen = list(choice.extend(4))
    last = len(chosen) - 1  # the last to move saw where all others are
    here = summed_variance(C, weights, chosen, 0.01)
    for site in set(range(20)) - set(chosen):
        moved = [*chosen[:last], site]
        assert summed_variance(C, weights, moved, 0.01) >= here * (1 - 1e-9)


def test_taking_a_handle_back_leaves_the_covariance_as_it_was():
    C, weights = random_field(3)
    choice = _Choice(C, weights, 0.01, [np.arange(9)[:, None]], np.array([4]))
    before, gains = choice._P.copy(), choice._gains()[0]
    choice.chosen.append(np.array([2, 6]))
    choice._observe(choice.chosen[-1])
    assert np.abs(choice._P - before).max() > 0.1
    choice._release(1)
    assert [group.tolist() for group in choice.chosen] == [[4]]
    np.testing.assert_allclose(choice._P, before, atol=1e-9 * np.abs(C).max())
    np.testing.assert_allclose(choice._gains()[0], gains, rtol=1e-6)


def test_deviation_is_that_of_the_conditional_gaussian(model):
    """At sites, by the formula for a conditional Gaussian; elsewhere close to it."""
    every = PositionField.of_prior(model, MisfitField(model, np.arange(120)))
    handles, noise = np.array([3, 50, 118]), 0.01
    h = (3 * handles[:, None] + np.arange(3)).ravel()
    C = every.covariance()
    left = C - C[:, h] @ np.linalg.solve(C[np.ix_(h, h)] + noise**2 * np.eye(9), C[h])
    expected = np.sqrt(np.diag(left).reshape(-1, 3).sum(axis=1))
    np.testing.assert_allclose(every.deviation(every.observed(handles, noise)), expected, atol=1e-8)
    sites = np.unique(np.concatenate([handles, np.arange(0, 120, 2)]))
    some = PositionField.of_prior(model, MisfitField(model, sites))
    found = some.deviation(some.observed(handles, noise))
    assert abs(found - expected).max() < 0.15 * expected.max()


def test_the_covariance_without_misfit_is_that_of_sampled_poses(model):
    """Draw codes and rigid motions near the mean; their positions have the covariance Y Yᵀ."""
    misfit = MisfitField(model, np.arange(0, 120, 10))
    field = PositionField.of_prior(model, misfit)
    solver = HandleSolver(model)
    prior, energy = model.rigid_prior, solver.energy
    assert prior is not None
    rng, share = np.random.default_rng(0), 0.02
    draws = []
    for _ in range(1500):
        x = share * rng.normal(size=energy.size)
        x[-6:-3] *= prior.rotation
        x[-3:] *= prior.translation
        p = model.decode_centred(energy.code(x))
        draws.append(energy.move(x, p - p.mean(axis=0))[misfit.sites].ravel())
    expected = np.cov(np.array(draws).T) / share**2
    found = field.covariance() - np.kron(misfit.covariance, np.eye(3))
    assert np.abs(found - expected).max() < 0.15 * np.abs(expected).max()


def test_shapes_that_others_explain_are_rebuilt_and_others_are_not(model):
    """Codes on a line are rebuilt from each other; one off the line is off by its distance."""
    tangents = model.tangents(model.latent_mean)
    line = np.linspace(-1, 1, 9)[:, None] * np.eye(6)[0]
    on = replace(model, codes=line, summary={})
    diagonal = model.reference.bounding_diagonal
    assert rebuilding_error(on, tangents) < 0.01 * _LOCALITY * diagonal
    off = replace(model, codes=np.vstack([line, 0.5 * np.eye(6)[1]]), summary={})
    a, b = (tangents[k].reshape(-1, 3) for k in (0, 1))
    across = 0.5 * (b - (a * b).sum() / (a * a).sum() * a)
    distance = np.sqrt((across**2).sum() / len(across))
    # One of ten shapes is off by that distance, the others by next to nothing.
    assert rebuilding_error(off, tangents) == pytest.approx(
        _LOCALITY * distance / np.sqrt(10), rel=0.05
    )


def test_a_layout_recovers_more_than_evenly_spread_handles():
    model = large_model()
    shapes = model.decode(model.codes)

    def error(vertices):
        solver = HandleSolver(model)
        squares = []
        for shape in shapes:
            solver.set_handles(vertices, shape[vertices], hard=True)
            squares.append(((solver.solve().vertices - shape) ** 2).mean())
        return np.sqrt(np.mean(squares))

    spread = [error(farthest_points(model.geodesics, 3, seed)) for seed in range(3)]
    assert error(layout(model, 3).vertices) < 0.9 * np.mean(spread)


def test_more_handles_leave_less_uncertain_and_nested_ones_stay(model):
    found = layout(model, [8, 2, 4])
    assert list(found.expected) == [2, 4, 8]
    assert found.expected[2] > found.expected[4] > found.expected[8] > 0
    np.testing.assert_array_equal(found.vertices[:2], layout(model, 2).vertices)
    np.testing.assert_array_equal(found.vertices[:4], layout(model, [2, 4]).vertices)
    assert len(set(found.vertices)) == 8
    assert np.sqrt((found.deviation**2).mean()) == pytest.approx(found.expected[8])
    assert found.deviation[found.vertices].max() < 0.5 * np.median(found.deviation)


def test_every_vertex_can_be_a_handle(model):
    found = layout(model, [3, 120])
    assert sorted(found.vertices.tolist()) == list(range(120))
    assert found.expected[120] < 0.25 * found.expected[3]


def test_noise_leaves_more_uncertain(model):
    assert layout(model, 4, noise=0.05).expected[4] > 1.1 * layout(model, 4).expected[4]


def test_regions_and_spacing_are_those_of_the_surface(model):
    found = layout(model, 4)
    rows = np.stack([model.geodesics.row(int(v)) for v in found.vertices])
    np.testing.assert_array_equal(found.region, rows.argmin(axis=0))
    np.testing.assert_array_equal(found.region[found.vertices], np.arange(4))
    between = rows[:, found.vertices] + np.diag([np.inf] * 4)
    np.testing.assert_allclose(found.spacing, between.min(axis=1))
    total = sum((found.region == n).sum() * d**2 for n, d in enumerate(found.region_deviation))
    assert total == pytest.approx((found.deviation**2).sum())


def test_fixed_vertices_are_handles_and_excluded_ones_are_not(model):
    free = layout(model, 4)
    banned = np.flatnonzero(np.isin(free.region, [0, 1]))
    found = layout(model, 4, fixed=[7, 100], exclude=np.setdiff1d(banned, [7, 100]))
    assert found.vertices[:2].tolist() == [7, 100]
    assert not np.isin(found.vertices[2:], banned).any()
    only = layout(model, 2, exclude=np.arange(2, 120))
    assert sorted(only.vertices.tolist()) == [0, 1]


@pytest.mark.parametrize("count", [3, 6])
def test_symmetric_layouts_are_pairs_and_middles(count):
    model = small_model()
    found = layout(model, count, symmetric=True)
    assert len(found.vertices) == len(set(found.vertices)) == count
    paired = set(found.pairs.ravel())
    assert len(paired) == 2 * len(found.pairs)
    # The reference, a tube, is symmetric about several planes; the pairs are of one of them.
    v = model.reference.vertices
    halves = [v[a] - v[b] for a, b in found.vertices[found.pairs]]
    for half in halves[1:]:
        cosine = abs(half @ halves[0]) / np.linalg.norm(half) / np.linalg.norm(halves[0])
        assert cosine == pytest.approx(1, abs=0.02)


def test_mistakes_are_named(model):
    for options, words in (
        ({"count": 0}, "count"),
        ({"count": 121}, "at most 120"),
        ({"count": []}, "count"),
        ({"count": 2, "fixed": [1, 2, 3]}, "number of fixed"),
        ({"count": 2, "fixed": [1, 1]}, "vertex 1 is given twice"),
        ({"count": 2, "fixed": [120]}, "does not exist"),
        ({"count": 2, "fixed": [5], "exclude": [5]}, "vertex 5 is excluded"),
        ({"count": 2, "exclude": np.arange(119)}, "at most 1,"),
        ({"count": 2, "noise": -1.0}, "noise"),
        ({"count": 2, "symmetric": 1}, "symmetric"),
    ):
        with pytest.raises(InputError, match=words):
            layout(model, **options)


def test_a_body_without_left_and_right_has_no_symmetric_layout():
    flag = load_model("flag")  # flat: its plane of symmetry is the cloth
    with pytest.raises(InputError, match="symmetric"):
        layout(flag, 4, symmetric=True)
