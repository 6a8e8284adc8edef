"""Component analysis against models whose components are known."""

from dataclasses import replace

import numpy as np
import pytest

from deformer import Activations, ComponentAnalysis, InputError
from deformer.analysis.components import activation_correlations
from shapes import sequence, small_model


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture(scope="module")
def analysis(model):
    return ComponentAnalysis(model)


def test_components_are_ranked_by_strength(model, analysis):
    ranked = analysis.ranked()
    assert sorted(c.index for c in ranked) == list(range(model.components))
    strengths = [c.strength for c in ranked]
    assert strengths == sorted(strengths, reverse=True) and strengths[-1] > 0
    assert [c.index for c in analysis.ranked(2)] == [c.index for c in ranked[:2]]


def test_motion_is_that_of_the_representative_shape(model, analysis):
    acts = Activations(model)
    for c in analysis.ranked():
        z = acts.reference.copy()
        z[c.index] = c.extreme
        away = model.decode(z) - model.decode(acts.reference)
        assert c.motion == pytest.approx(np.sqrt((away**2).sum(axis=1).max()))
        assert c.extreme in (c.low, c.high)


def test_support_of_weights_that_are_written_by_hand(model):
    """Two rings of the tube and nothing else: 8 vertices a ring, 2 / 14 of its length apart."""
    C = model.weights.C.copy()
    C[:, :, 0] = 0.0
    C[16, 0, 0] = 1.0  # ring 2
    C[24:32, 0, 0] = 0.5  # ring 3
    C[40:48, 0, 0] = 0.01  # too weak to count
    model = replace(model, weights=replace(model.weights, C=C))
    found = ComponentAnalysis(model).describe(0)
    assert found.centre == 16 and found.support == 9
    # The far side of ring 3: half around (π r), and along.
    straight = np.hypot(np.pi * 0.25, 2 / 14) / model.geodesics.extent
    assert found.extent == pytest.approx(straight, rel=0.1)


def test_an_unused_component_is_last_and_acts_nowhere(model):
    codes = model.codes.copy()
    codes[:, 3] = Activations(model).reference[3]
    analysis = ComponentAnalysis(replace(model, codes=codes))
    last = analysis.ranked()[-1]
    assert last.index == 3
    assert (
        last.strength == 0
        and last.motion == 0
        and last.partner == -1
        and last.partner_correlation == 0
    )


def test_extreme_shapes_are_indices_into_the_whole_set(model):
    """Row 2 of the codes is training shape 7; it goes farthest in component 1."""
    codes = model.codes.copy()
    codes[2, 1] = 100.0
    split = {"train": [3, 5, 7, *range(8, 17)], "test": [0]}
    found = ComponentAnalysis(replace(model, codes=codes, split=split), extreme_count=2).describe(1)
    assert found.extreme_shapes[0] == 7 and len(found.extreme_shapes) == 2 and found.high == 100.0


def test_correlations_of_activations():
    a = np.array([1.0, -1.0, 1.0, -1.0])
    b = np.array([1.0, 1.0, -1.0, -1.0])
    codes = np.stack([a, -3 * a + 7, b, np.full(4, 2.0), a + b], axis=1)
    half = np.sqrt(0.5)
    expected = [
        [1, -1, 0, 0, half],
        [-1, 1, 0, 0, -half],
        [0, 0, 1, 0, half],
        [0, 0, 0, 0, 0],
        [half, -half, half, 0, 1],
    ]
    np.testing.assert_allclose(activation_correlations(codes), expected, atol=1e-12)


def test_the_partner_correlates_most(model):
    codes = model.codes.copy()
    codes[:, 4] = 2.0 - 3.0 * codes[:, 1]
    found = ComponentAnalysis(replace(model, codes=codes)).describe(4)
    assert found.partner == 1 and found.partner_correlation == pytest.approx(-1.0)


def test_names_are_shown(model):
    named = ComponentAnalysis(model.with_component_names({2: "left arm up"}))
    assert named.describe(2).label == "left arm up"
    assert named.describe(1).label == "component 1"


def test_mistakes_are_refused(model, analysis):
    with pytest.raises(InputError, match="component 6 does not exist"):
        analysis.describe(6)
    with pytest.raises(InputError, match="extreme_count"):
        ComponentAnalysis(model, extreme_count=-1)


def test_representative_features_are_the_farther_of_two(model):
    """By the paper's words, with the encoder's code of shape 0."""
    acts = Activations(model)
    z = model.encode(sequence().vertices[0])
    np.testing.assert_allclose(acts.reference, z, atol=1e-6)
    for k in range(model.components):
        reach = []
        for value in (model.codes[:, k].min(), model.codes[:, k].max()):
            moved = z.copy()
            moved[k] = value
            away = model.scaler.scale(model.decoder.features(moved)) - model.scaler.scale(acts.base)
            reach.append(np.sqrt((away**2).sum()))
        assert acts.strength[k] == pytest.approx(max(reach))
        assert acts.extreme[k] == (acts.low, acts.high)[int(np.argmax(reach))][k]
        per_vertex = acts.displacement(k)
        assert np.sqrt((per_vertex**2).sum()) == pytest.approx(acts.strength[k])
