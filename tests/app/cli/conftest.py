"""The model of a tube, as a file that a test may change; a module may have a model of its own."""

import importlib
import pkgutil

import pytest

import deformer_app.cli
from shapes import small_model

# Commands import what they need when they run: while a test has replaced a function of the library,
# they would keep the replacement.
for module in pkgutil.iter_modules(deformer_app.cli.__path__, "deformer_app.cli."):
    importlib.import_module(module.name)


@pytest.fixture
def model_path(tmp_path):
    small_model().save(tmp_path / "model")
    return tmp_path / "model"
