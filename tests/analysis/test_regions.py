"""Regions of components, on models whose supports are written down."""

from dataclasses import replace

import numpy as np
import pytest

from deformer import Activations, InputError, component_regions
from shapes import small_model


def with_supports(supports):
    """The small model with given weights (K, V) of its components, the same for all features."""
    model = small_model()
    C = np.zeros_like(model.weights.C)
    for k in range(model.components):
        C[: supports.shape[1], :, k] = supports[k % len(supports), :, None]
    return replace(model, weights=replace(model.weights, C=C))


def halves(model):
    """Weights (K, V): even components act on the left half of the tube, odd ones on the right."""
    x = model.reference.vertices[:, 0]
    left = (x < np.median(x)).astype(float)
    rows = [left if k % 2 == 0 else 1.0 - left for k in range(model.components)]
    return np.array(rows)


def test_components_of_one_place_are_one_region_and_every_component_is_in_one():
    model = with_supports(halves(small_model()))
    regions = component_regions(model)
    found = {frozenset(region.components) for region in regions}
    everything = range(model.components)
    assert found == {frozenset(k for k in everything if k % 2 == n) for n in (0, 1)}
    order = Activations(model).order.tolist()
    assert regions[0].components[0] == order[0]
    for region in regions:
        assert sorted(region.components, key=order.index) == list(region.components)


def test_the_centre_and_support_of_a_region_are_those_of_its_components():
    model = with_supports(halves(small_model()))
    vertices = model.reference.vertices
    for region in component_regions(model):
        inside = halves(model)[region.components[0]] > 0
        np.testing.assert_allclose(region.centre, vertices[inside].mean(axis=0), atol=1e-9)
        np.testing.assert_array_equal(region.support > 0, inside)


def test_the_overlap_decides_how_much_is_one_region():
    model = small_model()
    x = model.reference.vertices[:, 0]
    first = (x < np.quantile(x, 0.6)).astype(float)
    second = (x > np.quantile(x, 0.4)).astype(float)
    rows = [first if k % 2 == 0 else second for k in range(model.components)]
    model = with_supports(np.array(rows))
    cosine = (first @ second) / np.sqrt(first.sum() * second.sum())
    assert 0.05 < cosine < 0.9
    assert len(component_regions(model, overlap=cosine - 0.02)) == 1
    assert len(component_regions(model, overlap=cosine + 0.02)) == 2


def test_a_component_without_any_weight_is_a_region_of_its_own():
    rows = halves(small_model())
    rows[::2] = rows[1]
    rows[0] = 0.0
    regions = component_regions(with_supports(rows))
    assert (0,) in [region.components for region in regions]
    assert all(np.isfinite(region.centre).all() for region in regions)


def test_activations_of_another_model_are_refused():
    model = small_model()
    fewer = Activations(model)
    fewer.order = fewer.order[:3]  # as those of a model of three components
    with pytest.raises(InputError, match="another model"):
        component_regions(model, fewer)
