"""Trainings cut short at every stage, and what they need not do again."""

import json
import shutil

import numpy as np
import pytest

from bars import bending_bar
from deformer import InputError, MeshSequence, check_resumable, io, train
from deformer.training import trainer
from deformer.training.settings_search import HANDLE_NOISES, SPARSITIES
from deformer.training.training_set import TrainingSet
from deformer.training.trials import Trials

OPTIONS = {"components": 3, "epochs": 4}


@pytest.fixture(scope="module")
def whole():
    return train(bending_bar(), **OPTIONS)


class Stop:
    """A progress callback that keeps all events, and raises Ctrl-C at one of them."""

    def __init__(self, stage="", done=0):
        self.stages, self._at = [], (stage, done)

    def __call__(self, progress):
        self.stages.append((progress.stage, progress.done))
        if progress.stage == self._at[0] and progress.done >= self._at[1]:
            raise KeyboardInterrupt


def resume(folder):
    """Resume; gives the model, and what was told."""
    told = Stop()
    return train(bending_bar(), **OPTIONS, checkpoint=folder, resume=True, on_progress=told), told


def assert_same(model, other):
    assert model.handle_noise == other.handle_noise and model.config == other.config
    np.testing.assert_array_equal(model.codes, other.codes)
    np.testing.assert_array_equal(model.weights.C, other.weights.C)
    assert model.summary["interrupted"] is False


@pytest.mark.slow
def test_features_and_finished_trials_are_not_repeated(tmp_path, whole):
    # One of three trials has 4 rounds and 30 fits; two are made side by side.
    with pytest.raises(KeyboardInterrupt):
        train(
            bending_bar(),
            **OPTIONS,
            checkpoint=tmp_path / "run",
            on_progress=Stop("cross-validation", 70),
        )
    model, told = resume(tmp_path / "run")
    stage, done = told.stages[0]
    assert stage == "cross-validation" and done > 68
    assert_same(model, whole)


def test_an_interrupt_within_features_leaves_no_checkpoint(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        train(bending_bar(), **OPTIONS, checkpoint=tmp_path, on_progress=Stop("features", 3))
    with pytest.raises(InputError, match="no checkpoint"):
        resume(tmp_path)


@pytest.mark.slow
def test_the_finished_network_is_kept(tmp_path, whole, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(trainer, "rebuilding", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train(bending_bar(), **OPTIONS, checkpoint=tmp_path)
    # None of it is done again.
    monkeypatch.setattr(TrainingSet, "prepare", interrupted)
    monkeypatch.setattr(Trials, "noise_errors", interrupted)
    monkeypatch.setattr(Trials, "misfit_errors", interrupted)
    model, told = resume(tmp_path)
    assert told.stages == []
    assert_same(model, whole)
    assert model.summary["loss"] == pytest.approx(whole.summary["loss"])


@pytest.mark.slow
def test_an_interrupt_while_the_last_checkpoint_is_written_waits(tmp_path, monkeypatch):
    import signal

    from deformer.training import loop

    save = loop.save_checkpoint

    def with_interrupt(*arguments):
        signal.raise_signal(signal.SIGINT)
        save(*arguments)

    monkeypatch.setattr(loop, "save_checkpoint", with_interrupt)
    model = train(bending_bar(), **OPTIONS, checkpoint=tmp_path)
    assert model.summary["interrupted"] is True and model.summary["epochs"] == 4


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A folder with the features alone."""
    folder = tmp_path_factory.mktemp("run")
    with pytest.raises(KeyboardInterrupt):
        train(bending_bar(), **OPTIONS, checkpoint=folder, on_progress=Stop("cross-validation", 1))
    return folder


@pytest.mark.parametrize(
    ("options", "named"),
    [({"components": 4}, "config"), ({"epochs": 5}, "config"), ({"seed": 1}, "seed")],
)
def test_other_options_are_seen_without_the_shapes(stopped, options, named):
    check_resumable(stopped, **OPTIONS)
    with pytest.raises(InputError, match=f"other {named};"):
        check_resumable(stopped, **OPTIONS | options)


def test_other_shapes_are_refused(stopped):
    shapes = bending_bar()
    other = MeshSequence(1.01 * shapes.vertices, shapes.faces)
    with pytest.raises(InputError, match="other shapes;"):
        train(other, **OPTIONS, checkpoint=stopped, resume=True)


def test_damaged_features_are_refused(stopped, tmp_path):
    (tmp_path / "features.safetensors").write_bytes(b"half a file")
    with pytest.raises(InputError, match=r"features\.safetensors: "):
        check_resumable(tmp_path, **OPTIONS)


@pytest.mark.slow
@pytest.mark.parametrize("change", [lambda a: 1e30 * a, lambda a: 1e14 * a, lambda a: 0 * a])
def test_absurd_arrays_end_in_one_line_or_in_a_finite_model(tmp_path, change):
    told = Stop("training", 2)
    train(bending_bar(), **OPTIONS, checkpoint=tmp_path, on_progress=told)
    (file,) = tmp_path.glob("epoch-*.safetensors")
    arrays = {
        name: change(array).astype(array.dtype) if array.dtype.kind == "f" else array
        for name, array in io.read_tensors(file).items()
    }
    io.write_tensors(file, arrays)
    try:
        with np.errstate(all="ignore"):
            model, _ = resume(tmp_path)
    except InputError as error:
        assert str(error).startswith(str(tmp_path)) and len(str(error).splitlines()) == 1
        assert str(error).endswith("; delete the checkpoint, or start without --resume")
    else:
        assert np.isfinite(model.codes).all()
        assert np.isfinite(model.decode(model.codes)).all()


@pytest.mark.parametrize("change", [{"reference": 0}, {"vertices": 1e30}, {"scaler": 0}])
def test_absurd_features_name_the_checkpoint(stopped, tmp_path, change):
    folder = shutil.copytree(stopped, tmp_path / "run")
    file = folder / "features.safetensors"
    arrays = io.read_tensors(file)
    changed = {name: factor * arrays[name] for name, factor in change.items()}
    metadata = {"identity": json.dumps(io.read_metadata(file, "identity").value)}
    io.write_tensors(file, {**arrays, **changed}, metadata)
    with pytest.raises(InputError, match=r"altered .*; delete the checkpoint, or start") as caught:
        resume(folder)
    assert str(caught.value).startswith(str(file))


def test_a_damaged_trial_names_its_file(stopped, tmp_path):
    folder = shutil.copytree(stopped, tmp_path / "run")
    identity = io.read_metadata(folder / "features.safetensors", "identity").value
    trials = {str(sparsity): np.full(len(HANDLE_NOISES), np.nan) for sparsity in SPARSITIES}
    io.write_tensors(folder / "trials.safetensors", trials, {"identity": json.dumps(identity)})
    with pytest.raises(InputError, match=r"trials\.safetensors: .*delete the checkpoint"):
        resume(folder)
