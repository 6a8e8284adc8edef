"""Components and how usual a code is, against what the model itself says."""

import numpy as np
import pytest

from deformer import Activations, Familiarity, InputError
from shapes import small_model


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture(scope="module")
def activations(model):
    return Activations(model)


def test_limits_hold_every_training_code_tightly(model, activations):
    assert ((model.codes >= activations.low) & (model.codes <= activations.high)).all()
    assert (model.codes == activations.low).any(axis=0).all()
    assert (model.codes == activations.high).any(axis=0).all()


def test_components_are_in_order_of_strength(activations):
    assert (np.diff(activations.strength[activations.order]) <= 0).all()
    assert activations.strength.min() > 0


def test_support_is_where_the_weights_are(model, activations):
    C = model.weights.C
    for k in range(model.components):
        support = activations.support(k)
        assert support.max() == pytest.approx(1.0)
        np.testing.assert_array_equal(support > 0, np.abs(C[:, :, k]).sum(axis=1) > 0)
    with pytest.raises(InputError, match="does not exist"):
        activations.support(model.components)
    with pytest.raises(InputError, match="does not exist"):
        activations.representative(-1)


def test_training_codes_are_familiar_and_far_ones_are_not(model):
    familiarity = Familiarity(model)
    assert max(familiarity.distance(z) for z in model.codes) < 1e-9
    assert [familiarity.nearest(z)[0] for z in model.codes] == list(range(len(model.codes)))
    mean, first = model.prior.mean, model.codes[0]
    away = [familiarity.distance(mean + s * (first - mean)) for s in (2.0, 4.0, 8.0)]
    assert 0 < away[0] < away[1] < away[2] and away[2] > 1


def test_the_unit_of_familiarity_is_the_examples_own_distance(model):
    """Without a code among the examples, 95 % of them are within 1 of the others."""
    familiarity = Familiarity(model)
    L = model.prior.factor
    y = np.linalg.solve(L, model.codes.T).T
    gaps = np.linalg.norm(y[:, None] - y, axis=2) + 1e9 * np.eye(len(y))
    unit = np.quantile(gaps.min(axis=1), 0.95)
    z = model.codes[3] + 1e-3 * L[:, 0]
    assert familiarity.distance(z) == pytest.approx(1e-3 / unit, rel=1e-6)
