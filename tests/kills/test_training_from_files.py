"""A training from temporary files that is killed goes on to the same model."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from waiting import HANG, wait_for

SCRIPT = """
import sys
import time
import numpy as np
from bars import bending_bar
from deformer import FactorisationSettings, ModelConfig, train
from deformer.geometry import StoredShapes, map_shapes
from deformer.training import loop, memory, site_tiles
from deformer.training.training_set import TrainingSet
from deformer.workspace import LEAST_MEMORY, StoredArray, Workspace

# No memory for arrays of any size, many tiles, and a checkpoint after every round.
memory._OF_PART = memory._OF_VERTEX = memory._ARRAYS = 0
site_tiles._TILE, loop._CHECKPOINT_SECONDS = 2000, 0.0
folder, name, resume = sys.argv[1], sys.argv[2], sys.argv[3] == "resume"
workspace = Workspace(LEAST_MEMORY, folder)
shapes = map_shapes(bending_bar(), lambda p: p, workspace)
assert isinstance(shapes, StoredShapes)
prepare = TrainingSet.prepare

def watched(*arguments):
    found = prepare(*arguments)
    assert isinstance(found.tiles.tiles, StoredArray) and found.tiles.count > 1
    return found

def hold(progress):
    # What is to be killed must not end before, however late the killer looks.
    if name == "part" and not resume and (progress.stage, progress.done) == ("training", 6):
        time.sleep(600)

TrainingSet.prepare = watched
config = ModelConfig(components=3, training=FactorisationSettings(60, 0.2))
model = train(shapes, config=config, workspace=workspace, checkpoint=f"{folder}/{name}",
              resume=resume, on_progress=hold)
np.savez(f"{folder}/{name}.npz", codes=model.codes, C=model.weights.C)
"""
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.name == "nt", reason="POSIX signals"),
]


def start(folder, name, resume=""):
    helpers = os.pathsep.join([str(Path(__file__).parents[1] / "helpers"), *sys.path])
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(folder), name, resume],
        env=os.environ | {"PYTHONPATH": helpers},
    )


def test_a_killed_training_from_files_goes_on_to_the_same_model(tmp_path):
    with start(tmp_path, "whole") as process:
        assert process.wait(HANG) == 0
    folder = tmp_path / "part"

    def rounds():
        names = [path.name for path in folder.glob("epoch-*.safetensors")]
        return max((int(name[6:13]) for name in names), default=0)

    with start(tmp_path, "part") as process:
        wait_for(lambda: rounds() >= 3 or process.poll() is not None)
        process.send_signal(signal.SIGKILL)
        assert process.wait(HANG) == -signal.SIGKILL
    assert 3 <= rounds() < 60
    with start(tmp_path, "part", "resume") as process:
        assert process.wait(HANG) == 0
    # Temporary files have gone with the process.
    assert {path.name for path in tmp_path.iterdir()} == {"whole", "whole.npz", "part", "part.npz"}
    whole, part = np.load(tmp_path / "whole.npz"), np.load(tmp_path / "part.npz")
    np.testing.assert_array_equal(part["codes"], whole["codes"])
    np.testing.assert_array_equal(part["C"], whole["C"])
