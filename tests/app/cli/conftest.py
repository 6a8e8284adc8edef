"""The model of a tube, as a file that a test may change; a module may have a model of its own."""

import pytest

from shapes import small_model


@pytest.fixture
def model_path(tmp_path):
    small_model().save(tmp_path / "model")
    return tmp_path / "model"
