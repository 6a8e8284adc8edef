"""Training within a limit of memory: the same model, from files in place of memory."""

import numpy as np
import pytest

from bars import bending_bar
from deformer import FactorisationSettings, InputError, MeshSequence, ModelConfig, train
from deformer.geometry import StoredShapes, map_shapes
from deformer.parallel.threads import Threads
from deformer.training import memory, site_tiles
from deformer.training.training_set import TrainingSet
from deformer.workspace import LEAST_MEMORY, StoredArray, Workspace

# One value of λ₁: its trials take most of the time.
OPTIONS = {"config": ModelConfig(components=3, training=FactorisationSettings(4, 0.2))}


def noisy(shapes):
    """The shapes with noise that the training removes."""
    p = shapes.vertices
    size = 0.004 * np.linalg.norm(np.ptp(p[0], axis=0))
    return MeshSequence(p + np.random.default_rng(0).normal(scale=size, size=p.shape), shapes.faces)


@pytest.fixture
def small_parts(monkeypatch):
    """Parts so small that the bar has many."""
    monkeypatch.setattr(site_tiles, "_TILE", 2000)


@pytest.fixture
def limit(monkeypatch):
    """A limit of memory that leaves none for arrays of any size."""
    monkeypatch.setattr(memory, "_OF_PART", 0.0)
    monkeypatch.setattr(memory, "_OF_VERTEX", 0.0)
    monkeypatch.setattr(memory, "_ARRAYS", 0)
    return LEAST_MEMORY


def stored(shapes, folder):
    """The shapes in a file."""
    return map_shapes(shapes, lambda p: p, Workspace(LEAST_MEMORY, folder))


@pytest.mark.parametrize("change", [lambda shapes: shapes, noisy], ids=["clean", "noisy"])
def test_the_model_does_not_depend_on_the_memory(tmp_path, small_parts, limit, change, monkeypatch):
    shapes, options = change(bending_bar()), {**OPTIONS, "align_shapes": True}
    split = {"train": [n for n in range(len(shapes)) if n != 3], "test": [3]}
    whole = train(shapes, **options, split=split, workspace=Workspace(1e11))
    seen, prepare = [], TrainingSet.prepare

    def watched(*arguments):
        seen.append(prepare(*arguments))
        return seen[-1]

    monkeypatch.setattr(TrainingSet, "prepare", watched)
    shared, share = [], Threads.share
    monkeypatch.setattr(
        Threads, "share", lambda self, value: shared.append(value) or share(self, value)
    )
    filed = stored(shapes, tmp_path)
    assert isinstance(filed, StoredShapes)
    model = train(filed, **options, split=split, workspace=Workspace(limit, tmp_path))
    assert isinstance(seen[0].tiles.tiles, StoredArray) and seen[0].tiles.count > 1
    assert isinstance(seen[0].shapes, StoredShapes)
    assert shared and not any(isinstance(value, np.ndarray) for value in shared)  # no tiles
    assert (seen[0].noise > 0) == (change is noisy)
    np.testing.assert_array_equal(model.codes, whole.codes)
    np.testing.assert_array_equal(model.weights.C, whole.weights.C)
    assert model.fingerprint == whole.fingerprint
    assert model.config == whole.config and model.handle_noise == whole.handle_noise
    drop = {"seconds"}
    assert {k: v for k, v in model.summary.items() if k not in drop} == {
        k: v for k, v in whole.summary.items() if k not in drop
    }
    assert not any(tmp_path.iterdir())


def test_a_training_in_files_goes_on_from_its_checkpoint(tmp_path, small_parts, limit):
    whole = train(bending_bar(), **OPTIONS, workspace=Workspace(1e11))
    stages = []

    def stop(progress):
        stages.append(progress.stage)
        if (progress.stage, progress.done) == ("training", 2):
            raise KeyboardInterrupt

    folder = tmp_path / "run"
    filed = stored(bending_bar(), tmp_path)
    options = {**OPTIONS, "workspace": Workspace(limit, tmp_path), "checkpoint": folder}
    part = train(filed, **options, on_progress=stop)
    assert part.summary["interrupted"] and "features" in stages
    stages.clear()
    model = train(
        filed, **options, resume=True, on_progress=lambda progress: stages.append(progress.stage)
    )
    assert "features" not in stages and "cross-validation" not in stages
    np.testing.assert_array_equal(model.codes, whole.codes)
    np.testing.assert_array_equal(model.weights.C, whole.weights.C)
    assert {path.name for path in tmp_path.iterdir()} == {"run"}


def test_large_sets_are_tried_on_some_of_them(monkeypatch):
    from deformer.training import settings_search, trials

    monkeypatch.setattr(settings_search, "_TRIAL_SHAPES", 6)
    tried, counts = trials.noise_recoveries, []

    def counted(shapes, *arguments):
        counts.append(len(shapes))
        return tried(shapes, *arguments)

    monkeypatch.setattr(trials, "noise_recoveries", counted)
    shapes = bending_bar()
    model = train(shapes, **OPTIONS)
    assert len(shapes) > 6 and set(counts) == {6}
    assert len(model.codes) == len(shapes)


def test_too_little_memory_is_told_before_anything_is_done(tmp_path):
    with pytest.raises(
        InputError, match=r"training: 3 components, .* expected at most the 0\.5 GB"
    ):
        train(
            bending_bar(), **OPTIONS, workspace=Workspace(LEAST_MEMORY), checkpoint=tmp_path / "run"
        )
    assert not any(tmp_path.iterdir())
