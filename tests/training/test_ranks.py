"""Two processes of a torchrun train the network that one trains."""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from torch import distributed

import deformer
import train_on_ranks
from bars import bending_bar
from deformer import InputError
from deformer.geometry.geodesics import Geodesics
from deformer.training import assist_training
from train_on_ranks import trained

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (distributed.is_available() and distributed.is_gloo_available()),
        reason="this torch has no gloo",
    ),
]
# With codes beyond the limit: their term of the loss belongs to the process with the largest.
PAPER = {"epochs": 25, "range_limit": 0.01}
STOCHASTIC = {"epochs": 25, "range_limit": 0.01, "batch": 4, "mixed_shapes": 5, "initial": "pca"}


def torchrun(count, *arguments, cwd=None):
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone"]
    helpers = str(Path(train_on_ranks.__file__).parent)
    paths = os.pathsep.join([helpers, *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.run(
        [*command, "--nproc-per-node", str(count), *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"},
        cwd=cwd,
        capture_output=True,
        text=True,
    )


def on_ranks(count, folder, training, **options):
    """What `trained` gives, in several processes."""
    output = folder / "result.npz"
    given = json.dumps({"training": training, **options})
    done = torchrun(count, train_on_ranks.__file__, given, output)
    assert done.returncode == 0, done.stderr
    with np.load(output) as arrays:
        return dict(arrays)


@pytest.mark.parametrize("training", [PAPER, STOCHASTIC], ids=["paper", "stochastic"])
def test_two_processes_have_the_losses_of_one(tmp_path, training):
    losses, result = trained(training)
    assert min(losses[-1]) > 0, "all terms count"
    found = on_ranks(2, tmp_path, training)
    np.testing.assert_allclose(found["losses"], losses, rtol=1e-4)
    np.testing.assert_allclose(found["C"], result.weights.arrays["C"], atol=1e-4)


@pytest.mark.parametrize(("before", "after"), [(2, 1), (1, 2)])
def test_a_training_goes_on_with_another_number_of_processes(tmp_path, before, after):
    whole, result = trained(STOCHASTIC)
    checkpoint = tmp_path / "checkpoint"

    def part(count, **options):
        if count == 1:
            losses, _ = trained(STOCHASTIC, checkpoint=checkpoint, **options)
            return losses
        found = on_ranks(count, tmp_path, STOCHASTIC, checkpoint=str(checkpoint), **options)
        assert bool(found["interrupted"]) == ("until" in options)
        return found["losses"].tolist()

    first = part(before, until=11)
    rest = part(after, resume=True)
    assert (len(first), len(rest)) == (11, 14)
    np.testing.assert_allclose([*first, *rest], whole, rtol=1e-4)
    assert not result.interrupted


def test_the_command_trains_on_two_processes(tmp_path):
    deformer.save_shapes(tmp_path / "bar.npz", bending_bar(count=6))
    command = ["-m", "deformer", "train", "bar.npz", "-o", "model", "--config", "paper"]
    options = ["--components", "2", "--epochs", "3", "--device", "cpu", "--json"]
    done = torchrun(2, *command, *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("{")]
    assert json.loads(line)["summary"]["epochs"] == 3
    model = deformer.load_model(tmp_path / "model")
    alone = deformer.train(
        bending_bar(count=6), 2, config="paper", epochs=3, device="cpu", document=None
    )
    assert model.summary["loss"] == pytest.approx(alone.summary["loss"], rel=1e-4)


def test_one_process_assists_nobody():
    assert not assist_training()


def test_what_several_processes_cannot_train_is_one_line(monkeypatch):
    monkeypatch.setenv("TORCHELASTIC_RUN_ID", "a run")
    monkeypatch.setenv("WORLD_SIZE", "2")
    with pytest.raises(InputError, match=r"started 2 processes, and .* is trained by one alone"):
        deformer.train(bending_bar(count=6), 2)


def test_distances_are_sent_as_their_mesh():
    distances = Geodesics(bending_bar(2).mesh(0))
    np.testing.assert_allclose(pickle.loads(pickle.dumps(distances)).row(5), distances.row(5))
