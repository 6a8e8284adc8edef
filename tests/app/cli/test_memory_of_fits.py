"""The memory of `deformer fit` does not grow with the number of frames."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import deformer

SCRIPT = """
import sys
from deformer_app.entry import main
from memory import peak_memory
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
print(peak_memory())
"""


def peak(folder, frames):
    """Peak of the resident memory of a fit of frames, in bytes."""
    model = deformer.load_model("hand")
    vertices = [0, 1500, 3000]
    places = model.reference.vertices[vertices]
    sway = 0.1 * model.reference.bounding_diagonal * np.sin(np.arange(frames) / 30)
    name = f"{frames}.json"
    with (folder / name).open("w") as file:
        file.write('{"frames": [')
        for n, shift in enumerate(sway.tolist()):
            rows = zip(vertices, (places + np.array([shift, 0, 0])).tolist(), strict=True)
            handles = [{"vertex": v, "position": p} for v, p in rows]
            file.write(("," if n else "") + json.dumps(handles))
        file.write("]}")
    # So little that even the shapes of few frames are in a file.
    memory = deformer.sequence_memory(len(model.reference.vertices), model.components, 3).least
    command = ["fit", "hand", name, "-o", f"{frames}.mdd", "--memory", f"{memory / 1e6 + 20:.0f}MB"]
    helpers = os.pathsep.join([str(Path(__file__).parents[2] / "helpers"), *sys.path])
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *command], stdout=subprocess.PIPE, text=True, check=True,
        cwd=folder, env=os.environ | {"PYTHONPATH": helpers},
    )  # fmt: skip
    found = deformer.load_shapes(
        folder / f"{frames}.mdd", workspace=deformer.Workspace(1e9, folder)
    )
    assert len(found) == frames
    return int(done.stdout.splitlines()[-1])


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no peak of the resident memory")
def test_the_peak_does_not_grow_with_the_number_of_frames(tmp_path):
    few, many = 400, 1600
    positions = 24 * (many - few) * len(deformer.load_model("hand").reference.vertices)
    assert peak(tmp_path, many) - peak(tmp_path, few) < 0.3 * positions
