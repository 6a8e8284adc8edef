"""Synthesis: the paper's formula, its linear counterparts, plausible draws, transfer."""

from dataclasses import replace

import numpy as np
import pytest

from deformer import (
    Activations,
    Familiarity,
    InputError,
    Mesh,
    Synthesis,
    draw_codes,
    transfer,
    transfer_code,
)
from shapes import large_model, small_model


@pytest.fixture(scope="module")
def model():
    return small_model().with_component_names({2: "bend", 4: "twist more"})


@pytest.fixture(scope="module")
def synthesis(model):
    return Synthesis(model)


def test_weights_one_and_zero_are_representative_and_reference(model, synthesis):
    acts = Activations(model)
    np.testing.assert_array_equal(synthesis.code({}), acts.reference)
    for k in range(model.components):
        np.testing.assert_allclose(synthesis.code({k: 1.0}), acts.representative(k), atol=1e-12)
        np.testing.assert_array_equal(synthesis.code({k: 0.0}), acts.reference)


def test_weights_add_up_entry_by_entry(model, synthesis):
    acts = Activations(model)
    z = synthesis.code({"bend": 0.8, 4: -1.2})
    expected = acts.reference.copy()
    expected[2] += 0.8 * (acts.extreme[2] - acts.reference[2])
    expected[4] -= 1.2 * (acts.extreme[4] - acts.reference[4])
    np.testing.assert_allclose(z, expected, atol=1e-12)
    np.testing.assert_array_equal(synthesis.shape({"bend": 0.8, 4: -1.2}), model.decode(z))


def test_any_shape_can_be_the_start(model):
    acts = Activations(model)
    found = Synthesis(model, model.codes[5]).code({"1": 0.5})
    step = np.eye(model.components)[1] * 0.5 * (acts.extreme[1] - acts.reference[1])
    np.testing.assert_allclose(found, model.codes[5] + step, atol=1e-12)


@pytest.mark.parametrize("space", ["features", "linear"])
def test_linear_counterparts_agree_at_one_component_and_are_linear(model, synthesis, space):
    """Weight 1 of one component is its representative shape; beyond, each adds linearly."""
    for k in (0, 3):
        np.testing.assert_allclose(
            synthesis.shape({k: 1.0}, space), synthesis.shape({k: 1.0}), atol=1e-9
        )

    def made(weights):
        p = synthesis.shape(weights, space)
        return p if space == "linear" else model.extractor.extract(p)

    both = made({0: 0.4, 3: -0.3}) - made({})
    apart = made({0: 0.4}) - made({}) + made({3: -0.3}) - made({})
    np.testing.assert_allclose(both, apart, atol=1e-9 if space == "linear" else 2e-2)


def test_the_latent_way_is_not_linear(model, synthesis):
    double = synthesis.shape({2: 2.0}) - synthesis.shape({})
    single = synthesis.shape({2: 1.0}) - synthesis.shape({})
    size = np.abs(synthesis.shape({2: 2.0}, "linear") - synthesis.shape({})).max()
    assert np.abs(double - 2 * single).max() > 1e-2 * size


def test_a_sweep_is_its_shapes(model, synthesis):
    swept = synthesis.sweep("bend", [-1.0, 0.0, 1.0], {2: 9.0, 5: 0.5})
    assert swept.shape == (3, len(model.reference.vertices), 3)
    np.testing.assert_array_equal(swept[0], synthesis.shape({2: -1.0, 5: 0.5}))
    np.testing.assert_array_equal(swept[1], synthesis.shape({5: 0.5}))


def test_draws_are_within_the_bound_and_of_the_prior(model):
    familiarity = Familiarity(model)
    for bound in (0.25, 1.0):
        drawn = draw_codes(model, 50, seed=3, bound=bound)
        distances = np.array([familiarity.nearest(z)[1] for z in drawn])
        assert drawn.shape == (50, model.components)
        assert (distances <= bound + 1e-9).all()
        assert len(np.unique(drawn.round(6), axis=0)) == 50
    free = draw_codes(model, 4000, seed=3, bound=np.inf)
    prior = model.prior
    white = np.linalg.solve(prior.factor, (free - prior.mean).T)
    np.testing.assert_allclose(white.mean(axis=1), 0, atol=0.06)
    np.testing.assert_allclose(np.cov(white), np.eye(model.components), atol=0.12)
    np.testing.assert_array_equal(draw_codes(model, 2, seed=1), draw_codes(model, 2, seed=1))
    # Those that were near enough stay as drawn; the bound 0 leaves examples.
    near = [familiarity.nearest(z)[1] <= 1 for z in free[:50]]
    assert any(near) and not all(near)
    # Products of other sizes round differently.
    np.testing.assert_allclose(draw_codes(model, 50, seed=3)[near], free[:50][near], atol=1e-12)
    at_examples = draw_codes(model, 5, bound=0.0)
    assert all((np.abs(model.codes - z).max(axis=1) < 1e-9).any() for z in at_examples)


def test_transfer_to_a_larger_body_gives_the_larger_shape(model):
    """Gradients of deformation do not feel size: the same pose, three times as large."""
    body = model.reference
    large = replace(model, reference=Mesh(3.0 * body.vertices + 1.0, body.faces))
    z = model.codes[4]
    np.testing.assert_allclose(
        transfer(model, large, z), 3.0 * model.decode(z) + 1.0, atol=1e-9 * body.bounding_diagonal
    )


def test_a_transferred_code_is_what_the_target_encodes(model):
    """Between a model and itself it is the encoder on the decoder."""
    z = model.codes[4]
    expected = model.decoder.project(model.decoder.features(z))
    np.testing.assert_allclose(transfer_code(model, model, z), expected)
    shape, again = model.decode(z), model.decode(transfer_code(model, model, z))
    assert np.abs(again - shape).max() < 0.05 * model.reference.bounding_diagonal


@pytest.mark.slow
def test_mistakes_are_refused(model, synthesis):
    for weights, words in (
        ({6: 1.0}, "component 6 does not exist"),
        ({"bent": 1.0}, "'bend', 'twist more'"),
        ({"bend": 1.0, 2: 0.5}, "one component"),
        ({1: np.nan}, "finite"),
    ):
        with pytest.raises(InputError, match=words):
            synthesis.code(weights)
    with pytest.raises(InputError, match="space"):
        synthesis.shape({1: 1.0}, "straight")
    with pytest.raises(InputError, match="start"):
        Synthesis(model, np.zeros(3))
    with pytest.raises(InputError, match="bound"):
        draw_codes(model, 3, bound=-1.0)
    other = large_model()
    with pytest.raises(InputError, match="connectivities differ"):
        transfer(model, other, model.codes[0])
    with pytest.raises(InputError, match="z: expected"):
        transfer(model, model, np.zeros(2))
