"""The model of a tube, and an editor of it on a plotter off the screen."""

import shutil
from pathlib import Path

import pytest

from off_screen_editor import editing
from shapes import small_model


@pytest.fixture(scope="session")
def saved_model(tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "tube"
    small_model().save(path)
    return path


@pytest.fixture
def model_path(saved_model, tmp_path_factory):
    """The model's folder, a copy for each test: names of components are written to it."""
    return Path(shutil.copytree(saved_model, tmp_path_factory.mktemp("models") / "tube"))


@pytest.fixture
def editor(model_path):
    with editing(model_path) as work:
        yield work


@pytest.fixture
def heard(editor):
    """All changes that the editor has told of."""
    changes = []
    editor.on_change.append(changes.append)
    return changes
