"""The optimisation behind sparse localised components, on a line of sites."""

import numpy as np
import pytest

from deformer.errors import InputError
from deformer.training.sparse_components import (
    Factorisation,
    LocalisedSettings,
    localised_components,
)

SITES = 60
LINE = np.linspace(0.0, 1.0, SITES)
CENTRES = 10, 30, 50


def distances(site):
    return np.abs(LINE - LINE[site])


def bumps(seed=0, shapes=20, dimensions=3):
    """Three bumps (3, M, D) that do not overlap, their weights (N, 3) in [−1, 1], the data."""
    rng = np.random.default_rng(seed)
    components = np.zeros((3, SITES, dimensions))
    for k, centre in enumerate(CENTRES):
        profile = np.maximum(0.0, 1.0 - np.abs(np.arange(SITES) - centre) / 5.0)
        components[k] = profile[:, None] * rng.normal(size=dimensions)
    weights = rng.uniform(-1, 1, (shapes, 3))
    weights /= np.abs(weights).max(0)
    return components, weights, np.tensordot(weights, components, 1)


def noise(seed=0, shapes=12, dimensions=3):
    """Smooth random data that no few components explain."""
    rng = np.random.default_rng(seed)
    raw = rng.normal(size=(shapes, SITES, dimensions))
    return np.cumsum(raw - raw.mean(1, keepdims=True), axis=1)


@pytest.mark.parametrize("dimensions", [2, 3, 9])
def test_local_components_are_found_with_their_supports(dimensions):
    components, weights, data = bumps(dimensions=dimensions)
    found = localised_components(data, distances, 3)
    order = np.argsort(found.centres)
    assert found.centres[order].tolist() == list(CENTRES)
    np.testing.assert_allclose(
        np.tensordot(found.weights, found.components, 1), data, atol=1e-6 * np.abs(data).max()
    )
    for k in range(3):
        sign = np.sign(found.weights[0, order[k]] * weights[0, k])
        np.testing.assert_allclose(found.weights[:, order[k]] * sign, weights[:, k], atol=1e-6)
        assert (found.components[order[k]] != 0).any(1).tolist() == components[k].any(1).tolist()


@pytest.mark.parametrize("signed", [True, False])
def test_objective_never_rises_and_weights_keep_their_range(signed):
    data = noise() if signed else noise() - noise()[:1]
    found = localised_components(data, distances, 8, LocalisedSettings(signed=signed, tolerance=0))
    assert len(found.objective) > 20
    assert (np.diff(found.objective) <= 1e-12 * found.objective[0]).all()
    assert found.objective[-1] < 0.8 * found.objective[0]
    used = found.components.any((1, 2))
    np.testing.assert_allclose(np.abs(found.weights[:, used]).max(0), 1.0)
    assert found.weights.min() >= 0 or signed


def test_no_step_raises_the_objective():
    data = 3.0 * noise(seed=4)
    for signed in (True, False):
        problem = Factorisation(data, distances, 6, LocalisedSettings(sparsity=5.0, signed=signed))
        problem.start()
        value = problem.objective()
        for _ in range(20):
            for step in (problem.fit_weights, problem.move_centres, problem.fit_components):
                step()
                value, before = problem.objective(), value
                assert value <= before * (1 + 1e-12), step


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_a_restored_state_goes_on_as_if_never_stopped(precision):
    """And makes no greedy start of its own."""
    data = noise(seed=2).astype(precision)
    whole = Factorisation(data, distances, 5, LocalisedSettings())
    whole.start()
    for _ in range(3):
        whole.round()
    state = {name: array.copy() for name, array in whole.state.items()}
    other = Factorisation(data, distances, 5, LocalisedSettings())
    assert not other.W.any() and not other.C.any()
    other.restore(state)
    assert other.terms() == whole.terms()
    for _ in range(4):
        whole.round()
        other.round()
    assert other.state.keys() == whole.state.keys()
    for name, array in whole.state.items():
        assert array.dtype == (np.int64 if name == "centres" else precision)
        np.testing.assert_array_equal(other.state[name], array)
    assert other.terms() == whole.terms()


def test_weights_and_component_are_scaled_together():
    data = noise()
    problem = Factorisation(data, distances, 1, LocalisedSettings(sparsity=0.0))
    problem.start()
    along = problem.C[0] / np.linalg.norm(problem.C[0])
    problem.restore({**problem.state, "C": 3.0 * problem.C})
    problem.fit_weights()
    X = data.reshape(len(data), -1)
    np.testing.assert_allclose(problem.W @ problem.C, np.outer(X @ along, along), atol=1e-12)
    assert np.abs(problem.W).max() == pytest.approx(1.0)


def test_objective_is_that_of_the_paper():
    data = noise()
    settings = LocalisedSettings(sparsity=1.5, d_min=0.1, d_max=0.3)
    found = localised_components(data, distances, 6, settings)
    unit = np.sqrt((data**2).mean())
    penalty = 0.0
    for site, component in zip(found.centres, found.components, strict=True):
        locality = np.interp(distances(site), [0.1, 0.3], [0.0, 1.0])
        penalty += 1.5 * (locality * np.linalg.norm(component, axis=1)).sum() / unit
    residual = data - np.tensordot(found.weights, found.components, 1)
    expected = ((residual / unit) ** 2).sum() / 2 + penalty
    assert found.objective[-1] == pytest.approx(expected, rel=1e-12)


def test_a_larger_charge_gives_smaller_supports():
    support = [
        (localised_components(noise(), distances, 6, LocalisedSettings(sparsity=s)).components != 0)
        .any(2)
        .mean()
        for s in (0.0, 2.0, 8.0)
    ]
    assert support[0] == 1.0
    assert support[2] < support[1] < 0.95


def test_far_from_its_centre_a_component_costs_as_much_whatever_is_charged_near():
    shares = []
    for far_sparsity in (0.0, 50.0):
        settings = LocalisedSettings(sparsity=0.01, d_min=0.1, d_max=0.3, far_sparsity=far_sparsity)
        found = localised_components(noise(), distances, 6, settings)
        far = np.array([distances(site) >= 0.3 for site in found.centres])
        there = np.linalg.norm(found.components, axis=2) > 0
        shares.append((there[far].mean(), there[~far].mean()))
        assert (np.diff(found.objective) <= 1e-9 * found.objective[0]).all()
    assert shares[0][0] > 0.9
    assert shares[1][0] == 0 and shares[1][1] > 0.9


def test_without_a_charge_it_is_a_low_rank_factorisation():
    data = bumps()[2]
    found = localised_components(
        data, distances, 3, LocalisedSettings(sparsity=0, tolerance=1e-12, rounds=300)
    )
    np.testing.assert_allclose(
        np.tensordot(found.weights, found.components, 1), data, atol=1e-3 * np.abs(data).max()
    )


@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_components_scale_with_the_data(scale):
    data = noise()
    one, other = (localised_components(f * data, distances, 5) for f in (1.0, scale))
    np.testing.assert_allclose(other.components, scale * one.components, atol=1e-8 * scale)
    np.testing.assert_allclose(other.weights, one.weights, atol=1e-8)


def test_the_same_twice():
    one, other = (localised_components(noise(), distances, 5) for _ in range(2))
    assert np.array_equal(one.components, other.components)
    assert np.array_equal(one.weights, other.weights)


def test_more_components_than_the_data_hold():
    data = np.zeros((7, SITES, 3))
    data[:, 30:33] = np.arange(7.0)[:, None, None]
    found = localised_components(data, distances, 3)
    assert found.components.any((1, 2)).tolist() == [True, False, False]
    assert not found.weights[:, 1:].any()
    np.testing.assert_allclose(np.tensordot(found.weights, found.components, 1), data, atol=1e-9)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: localised_components(np.zeros((4, SITES)), distances, 2), r"got \(4, 60\)"),
        (lambda: localised_components(np.full((4, SITES, 3), np.nan), distances, 2), "finite"),
        (lambda: localised_components(bumps()[2], distances, 0), "at least 1, got 0"),
        (lambda: LocalisedSettings(d_min=0.4, d_max=0.2), "got 0.4 and 0.2"),
        (lambda: LocalisedSettings(sparsity=-1), "got -1"),
        (lambda: LocalisedSettings(rounds=-1), "got -1"),
    ],
)
def test_bad_input_gives_one_line(call, message):
    with pytest.raises(InputError, match=message) as error:
        call()
    assert "\n" not in str(error.value)
