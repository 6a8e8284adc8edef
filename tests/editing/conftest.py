"""Fixtures of most tests of handle fits; a module may have a model of its own."""

import pytest

from shapes import small_model


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture(scope="module")
def diagonal(model):
    return model.reference.bounding_diagonal
