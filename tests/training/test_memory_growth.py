"""The memory of a process that trains from files does not grow with the number of shapes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import json, sys
import numpy as np
import deformer
from bars import bend, bar_mesh
from memory import peak_memory
from deformer.geometry import shape_sequence
from deformer.network import FactorisationSettings, ModelConfig
from deformer.parallel import InProcess
from deformer.training import feature_tiles, site_tiles
from deformer.training.training_set import TrainingSet
from deformer.workspace import LEAST_MEMORY, Workspace

count, memory, folder = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3]
site_tiles._TILE, feature_tiles._NUMBERS = 200_000, 200_000
workspace = Workspace(memory, folder)
rest, faces = bar_mesh(rings=40, side=6)
vertices = workspace.doubles((count, len(rest), 3))
for n in range(count):
    vertices[n : n + 1] = bend(rest, 0.8 * np.sin(n), 0.4 * np.cos(1.7 * n))[None]
shapes = shape_sequence(vertices, faces)
config = ModelConfig(components=4, training=FactorisationSettings(epochs=3, sparsity=0.2))
examples = TrainingSet.prepare(shapes, shapes.mesh(0), 0, config, workspace, InProcess())
result = examples.train_network(config)
model = examples.build_model(result.weights, config, {}, {})
peak = peak_memory()
size = examples.tiles.shape[0] * examples.tiles.shape[1] * 36
print(json.dumps({"peak": peak, "size": size, "codes": model.codes[:9].tolist()}))
"""


def run(count, memory, folder):
    """Peak of the resident memory and size of the features, in bytes."""
    command = [sys.executable, "-c", SCRIPT, str(count), str(memory), str(folder)]
    helpers = os.pathsep.join([str(Path(__file__).parents[1] / "helpers"), *sys.path])
    env = os.environ | {"PYTHONPATH": helpers}
    found = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=env)
    return json.loads(found.stdout.splitlines()[-1])


@pytest.mark.skipif(sys.platform == "win32", reason="no peak of the resident memory")
@pytest.mark.slow
def test_the_peak_does_not_grow_with_the_number_of_shapes(tmp_path):
    few, many = run(100, 5e8, tmp_path), run(1500, 5e8, tmp_path)
    more = many["size"] - few["size"]
    assert more > 40e6
    assert many["peak"] - few["peak"] < 0.5 * more
    # The features alone take more where they are in memory.
    whole = run(1500, 1e12, tmp_path)
    assert whole["peak"] - few["peak"] > more
    assert whole["codes"] == many["codes"]
    assert not any(tmp_path.iterdir())
