"""Truths of the training loop: it learns, repeats itself exactly, and resumes exactly."""

import json
import signal
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from deformer.acap.features import FeatureExtractor, extract_all
from deformer.acap.scaler import FeatureScaler
from deformer.errors import InputError
from deformer.geometry.geodesics import Geodesics
from deformer.linalg.device import resolve_device
from deformer.network import losses
from deformer.network.autoencoder import MeshAutoencoder
from deformer.network.config import ModelConfig, resolve_config
from deformer.training.adam import fit
from shapes import sequence

PAPER = resolve_config("paper", components=4, epochs=40)
MIXED = replace(PAPER, name="mixed").with_training(mixed_shapes=5)
DEEP = replace(MIXED, name="deep").with_training(layers=(7, 5))
STOCHASTIC = MIXED.with_training(batch=4, initial="pca", schedule="cosine", learning_rate=3e-3)
CONFIGS = pytest.mark.parametrize(
    "config", [PAPER, MIXED, DEEP, STOCHASTIC], ids=["paper", "mixed", "deep", "stochastic"]
)


@pytest.fixture(scope="module")
def data():
    """Scaled features, one-rings and geodesics of the small sequence."""
    shapes = sequence(8)
    extractor = FeatureExtractor(shapes.mesh(0))
    q = extract_all(extractor, shapes.vertices)
    x = FeatureScaler.fit(q).scale(q)
    return x, extractor.indptr, extractor.rings, Geodesics(shapes.mesh(0))


def weights(result):
    return result.weights.arrays


def assert_same(one, other):
    assert one.keys() == other.keys()
    for name, value in one.items():
        np.testing.assert_array_equal(value, other[name], err_msg=name)


class Stop:
    """A progress callback that interrupts after some epochs."""

    def __init__(self, epochs):
        self.epochs = epochs

    def __call__(self, progress):
        if progress.done == self.epochs:
            raise KeyboardInterrupt


def test_the_loss_falls_and_its_terms_are_reported(data):
    seen = []
    result = fit(*data, PAPER.with_training(epochs=150), device="cpu", on_progress=seen.append)
    assert [p.done for p in seen] == list(range(1, 151))
    assert all(p.stage == "training" and p.total == 150 for p in seen)
    for p in seen:
        assert p.loss == pytest.approx(p.reconstruction + p.sparsity + p.range, rel=1e-6)
    assert seen[-1].loss < 0.3 * seen[0].loss
    assert np.median([p.loss for p in seen[-20:]]) < np.median([p.loss for p in seen[60:80]])
    assert result.epochs == 150 and not result.interrupted and result.seconds > 0
    # The best is looked at every few epochs; it is among the losses seen and near the least.
    assert result.loss in [p.loss for p in seen]
    assert result.loss <= min(p.loss for p in seen[:-10]) * 1.05


def test_the_result_has_the_loss_that_it_says(data):
    """The returned weights, evaluated by the terms, give the returned loss."""
    x, indptr, rings, geodesics = data
    result = fit(x, indptr, rings, geodesics, PAPER, device="cpu")
    batch = torch.tensor(np.swapaxes(x, 0, 1), dtype=torch.float32)
    with torch.no_grad():
        network = MeshAutoencoder.from_weights(result.weights, indptr, rings)
        estimate, z = network(batch)
        locality = losses.Locality(geodesics, 0.2, 0.4).update(network.C)
        error = losses.reconstruction(batch, estimate).item()
        loss = error + 0.5 * losses.sparsity(network.C, locality).item()
        loss += 0.5 * losses.latent_range(z, 5.0).item()
    assert result.reconstruction == pytest.approx(error, rel=1e-4)
    assert result.loss == pytest.approx(loss, rel=1e-4)


@CONFIGS
def test_the_same_seed_gives_the_same_weights(data, config):
    config = config.with_training(epochs=25)
    first = weights(fit(*data, config, seed=3, device="cpu"))
    torch.manual_seed(99)  # what others did with torch's global generator does not matter
    assert_same(weights(fit(*data, config, seed=3, device="cpu")), first)
    other = weights(fit(*data, config, seed=4, device="cpu"))
    assert not np.array_equal(other["C"], first["C"])


def test_mixed_shapes_change_the_result(data):
    one = weights(fit(*data, PAPER.with_training(epochs=5), device="cpu"))
    other = weights(fit(*data, MIXED.with_training(epochs=5), device="cpu"))
    assert not np.array_equal(one["C"], other["C"])


@CONFIGS
@pytest.mark.parametrize("stops", [(20,), (7, 23, 31)], ids=str)
def test_resuming_is_exact(data, config, stops, tmp_path):
    whole = fit(*data, config, seed=1, device="cpu")
    for n, epochs in enumerate(stops):
        part = fit(
            *data,
            config,
            seed=1,
            device="cpu",
            checkpoint=tmp_path / "run",
            resume=n > 0,
            on_progress=Stop(epochs),
        )
        assert part.interrupted and part.epochs == epochs
    rest = []
    resumed = fit(
        *data,
        config,
        seed=1,
        device="cpu",
        checkpoint=tmp_path / "run",
        resume=True,
        on_progress=rest.append,
    )
    assert [p.done for p in rest] == list(range(stops[-1] + 1, config.training.epochs + 1))
    assert not resumed.interrupted and resumed.epochs == config.training.epochs
    assert_same(weights(resumed), weights(whole))
    assert (resumed.loss, resumed.reconstruction) == (whole.loss, whole.reconstruction)
    assert resumed.seconds > part.seconds


def control_c_in_step(monkeypatch, step):
    """Make Ctrl-C come in the middle of that step, while the loss is computed."""
    calls = []
    reconstruction = losses.reconstruction

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) == step:
            signal.raise_signal(signal.SIGINT)
        return reconstruction(*arguments)

    monkeypatch.setattr(losses, "reconstruction", interrupted)


@CONFIGS
def test_resuming_is_exact_after_an_interrupt_inside_a_step(data, config, tmp_path, monkeypatch):
    """Ctrl-C comes at any time, not only between epochs."""
    whole = fit(*data, config, device="cpu")
    with monkeypatch.context() as patch:
        control_c_in_step(patch, 20)
        part = fit(*data, config, device="cpu", checkpoint=tmp_path)
    assert part.interrupted and part.epochs in (19, 20)
    resumed = fit(*data, config, device="cpu", checkpoint=tmp_path, resume=True)
    assert_same(weights(resumed), weights(whole))


def test_training_leaves_the_handling_of_control_c_as_it_was(data, monkeypatch):
    before = signal.getsignal(signal.SIGINT)
    fit(*data, PAPER.with_training(epochs=2), device="cpu")
    assert signal.getsignal(signal.SIGINT) is before
    fit(*data, PAPER, device="cpu", on_progress=Stop(2))
    assert signal.getsignal(signal.SIGINT) is before
    control_c_in_step(monkeypatch, 2)
    fit(*data, PAPER, device="cpu")
    assert signal.getsignal(signal.SIGINT) is before


def test_training_works_in_a_thread(data):
    """Where signals cannot be handled; the result is the same."""
    config = MIXED.with_training(epochs=5)
    with ThreadPoolExecutor(1) as pool:
        there = pool.submit(fit, *data, config, device="cpu").result()
    assert_same(weights(there), weights(fit(*data, config, device="cpu")))


@CONFIGS
def test_an_interrupt_in_the_first_step_still_gives_a_loss(data, config, monkeypatch):
    control_c_in_step(monkeypatch, 1)
    part = fit(*data, config, device="cpu")
    assert part.interrupted and np.isfinite([part.loss, part.reconstruction]).all()


@CONFIGS
def test_resuming_what_is_complete_changes_nothing(data, config, tmp_path):
    """The interrupt came with the last epoch."""
    part = fit(*data, config, device="cpu", checkpoint=tmp_path, on_progress=Stop(40))
    again = fit(*data, config, device="cpu", checkpoint=tmp_path, resume=True)
    assert_same(weights(again), weights(part))
    assert (again.loss, again.reconstruction) == (part.loss, part.reconstruction)


def test_interruption_returns_the_best_so_far(data):
    seen = []

    def stop(progress):
        seen.append(progress.loss)
        Stop(25)(progress)

    part = fit(*data, PAPER, device="cpu", on_progress=stop)
    assert part.interrupted and part.epochs == 25
    # Weights are kept every few epochs: the loss is one that was seen, and those are its weights.
    epoch = seen.index(part.loss) + 1
    assert part.loss <= 1.05 * min(seen[:15])
    assert_same(weights(part), weights(fit(*data, PAPER.with_training(epochs=epoch), device="cpu")))


@pytest.fixture
def stopped(data, tmp_path):
    """A folder with a checkpoint of MIXED after 20 epochs."""
    fit(*data, MIXED, seed=1, device="cpu", checkpoint=tmp_path / "run", on_progress=Stop(20))
    return tmp_path / "run"


def test_a_checkpoint_is_json_and_safetensors(stopped):
    files = sorted(path.name for path in stopped.iterdir())
    status = json.loads((stopped / "checkpoint.json").read_text())
    assert status["epoch"] == 20
    assert files == ["checkpoint.json", status["arrays"]]
    tensors = load_file(stopped / status["arrays"])
    assert all(torch.isfinite(value).all() for value in tensors.values())


def test_a_later_checkpoint_replaces_the_earlier(data, stopped):
    options = {"seed": 1, "device": "cpu", "checkpoint": stopped, "resume": True}
    fit(*data, MIXED, **options, on_progress=Stop(30))
    assert json.loads((stopped / "checkpoint.json").read_text())["epoch"] == 30
    assert len(list(stopped.iterdir())) == 2


@pytest.mark.parametrize("kind", ["safetensors", "json"])
def test_a_crash_while_saving_leaves_the_earlier_checkpoint(data, stopped, monkeypatch, kind):
    """The disk is full in the middle of writing: what was there still resumes exactly."""
    from deformer.io import tensors

    before = {path.name: path.read_bytes() for path in stopped.iterdir()}

    def no_tensors(tensors, path, metadata):
        path.write_bytes(b"half a file")
        raise OSError("no space left on device")

    def no_text(path, text, *options, **more):
        path.write_bytes(text.encode()[: len(text) // 2])
        raise OSError("no space left on device")

    options = {"seed": 1, "device": "cpu", "checkpoint": stopped, "resume": True}
    with monkeypatch.context() as patch:
        if kind == "json":
            patch.setattr(Path, "write_text", no_text)
        else:
            patch.setattr(tensors, "save_file", no_tensors)
        with pytest.raises(OSError, match="no space"):
            fit(*data, MIXED, **options, on_progress=Stop(30))
    for name, content in before.items():
        assert (stopped / name).read_bytes() == content
    whole = fit(*data, MIXED, seed=1, device="cpu")
    assert_same(weights(fit(*data, MIXED, **options)), weights(whole))


@pytest.mark.parametrize(
    ("config", "seed", "scale", "named"),
    [
        (replace(MIXED, components=5), 1, 1.0, "config"),
        (MIXED.with_training(learning_rate=2e-3), 1, 1.0, "config"),
        (MIXED, 2, 1.0, "seed"),
        (MIXED, 1, 0.9, "shapes"),
        (PAPER, 2, 0.9, "config, seed, shapes"),
    ],
)
def test_resuming_something_else_is_refused(data, stopped, config, seed, scale, named):
    x, *rest = data
    with pytest.raises(InputError, match=f"checkpoint.json.*other {named};"):
        fit(scale * x, *rest, config, seed=seed, device="cpu", checkpoint=stopped, resume=True)


def test_resuming_without_a_checkpoint_is_refused(data, tmp_path):
    with pytest.raises(InputError, match="no checkpoint"):
        fit(*data, PAPER, device="cpu", checkpoint=tmp_path, resume=True)
    with pytest.raises(InputError, match="folder"):
        fit(*data, PAPER, device="cpu", resume=True)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("checkpoint.json", b"{"),
        ("checkpoint.json", b"{}"),
        ("arrays", None),
        ("arrays", b"no tensors here"),
    ],
)
def test_damaged_checkpoints_are_refused(data, stopped, name, content):
    status = json.loads((stopped / "checkpoint.json").read_text())
    path = stopped / (status["arrays"] if name == "arrays" else name)
    if content is None:
        path.unlink()
    else:
        path.write_bytes(content)
    with pytest.raises(InputError, match=path.name) as caught:
        fit(*data, MIXED, seed=1, device="cpu", checkpoint=stopped, resume=True)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("device", ["tpu", "", "gpu:0"])
def test_unknown_devices_are_refused(data, device):
    with pytest.raises(InputError, match="cpu, cuda, mps or auto"):
        fit(*data, PAPER, device=device)


def test_a_factorisation_is_not_trained_by_gradients(data):
    with pytest.raises(InputError, match="Adam"):
        fit(*data, ModelConfig(), device="cpu")


def test_absent_devices_are_refused():
    for name, present in (
        ("cuda", torch.cuda.is_available()),
        ("mps", torch.backends.mps.is_available()),
    ):
        if not present:
            with pytest.raises(InputError, match=f"'{name}' is not available"):
                resolve_device(name)
    assert resolve_device("auto").type in ("cuda", "mps", "cpu")
    assert resolve_device("cpu") == torch.device("cpu")


def test_a_rising_rate_keeps_features_far_from_zero_from_saturating_the_network_for_good(data):
    """Adam's first steps move all weights alike, and their sum over the mesh is large."""
    x, *mesh = data
    offset = 0.1 * x - 0.57
    rising = PAPER.with_training(schedule="cosine", learning_rate=0.02, epochs=100)
    result = fit(offset, *mesh, replace(rising, components=20), device="cpu")
    assert result.reconstruction < 0.01 * 0.5 * (offset**2).sum(axis=(1, 2)).mean()
