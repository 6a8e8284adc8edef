"""Components and how usual a code is, against what the model itself says."""

import numpy as np
import pytest

from deformer import Activations, InputError
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
