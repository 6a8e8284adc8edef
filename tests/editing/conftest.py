"""Fixtures of most tests of handle fits; a module may have a model of its own."""

from dataclasses import replace

import pytest

from misfits import MISFIT
from shapes import small_model


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture(scope="module")
def diagonal(model):
    return model.reference.bounding_diagonal


@pytest.fixture(scope="module")
def doubtful(model):
    """A model that has an error of its own at handles."""
    return replace(model, handle_misfits=(MISFIT, MISFIT))
