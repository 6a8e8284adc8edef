"""Writers that are killed at each of their steps: what is there is the old or the new, as a whole.

`test_kills.py` kills whole commands at random moments, of which few fall into a write.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from waiting import HANG

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="forks a process for each step"),
]

# Writes 1 over 0 in children that are killed before their n-th change of a file, for each n. A file
# opened for writing is made empty before its child dies, as the system leaves it then.
KILLER = """
import json, os, signal, sys
import numpy as np
import deformer
from dataclasses import replace
from pathlib import Path
from deformer import io
from deformer.evaluation.journal import Journal
from deformer.training import checkpoints
from shapes import small_model

kind = sys.argv[1]
CHANGES = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "shutil.rmtree"}

class Model:
    model = small_model()
    def write(self, n):
        replace(self.model, codes=(n + 1.0) * self.model.codes).save("out")
    def read(self):
        return round((deformer.load_model("out").codes / self.model.codes).flat[0]) - 1

class Sequence:
    mesh = small_model().reference
    def write(self, n):
        shapes = np.full((3, 1, 1), n) + self.mesh.vertices
        deformer.save_shapes("out", deformer.MeshSequence(shapes, self.mesh.faces))
    def read(self):
        found = deformer.load_shapes("out").vertices - self.mesh.vertices
        assert len(found) == 3 and np.ptp(found.round()) == 0, found
        return int(found.round().flat[0])

class Json:
    def write(self, n):
        io.write_json("out", {"n": n, "more": list(range(1000))})
    def read(self):
        return io.read_json("out")["n"]

class Checkpoint:
    def write(self, n):
        status = {"epoch": n, "seconds": 1.0}
        checkpoints.save_checkpoint(Path("out"), {}, status, {"n": np.full(1000, n)})
    def read(self):
        status, arrays = checkpoints.load_checkpoint(Path("out"), {})
        assert (arrays["n"] == status["epoch"]).all()
        return status["epoch"]

work = {"model": Model, "sequence": Sequence, "json": Json, "checkpoint": Checkpoint}[kind]()

def die_at(step):
    steps = 0
    def hook(event, arguments):
        nonlocal steps
        writes = event == "open" and arguments[2] & (os.O_WRONLY | os.O_RDWR)
        if not writes and event not in CHANGES:
            return
        steps += 1
        if steps == step:
            if writes and isinstance(arguments[0], (str, bytes, os.PathLike)):
                os.open(arguments[0], arguments[2], 0o666)
            os.kill(os.getpid(), signal.SIGKILL)
    sys.addaudithook(hook)

def names():
    return sorted(map(str, Path().rglob("*")))

found, step, killed = [], 0, True
work.write(0)
work.write(1)
whole = names()
while killed:
    step += 1
    work.write(0)
    child = os.fork()
    if not child:
        die_at(step)
        work.write(1)
        os._exit(0)
    status = os.waitpid(child, 0)[1]
    killed = os.WIFSIGNALED(status)
    assert killed or status == 0, status
    found.append(work.read())
    # Whoever writes next removes what the killed one has left.
    work.write(1)
    assert names() == whole and work.read() == 1, (step, names())
print(json.dumps(found))
"""


@pytest.mark.parametrize("kind", ["model", "sequence", "json", "checkpoint"])
def test_a_writer_killed_at_any_step_leaves_the_old_or_the_new(tmp_path, kind):
    helpers = str(Path(__file__).parents[1] / "helpers")
    done = subprocess.run(
        [sys.executable, "-c", KILLER, kind],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([helpers, *sys.path])},
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    # Old ones first, then new ones; the last child lived.
    assert found == sorted(found) and set(found) == {0, 1} and len(found) > 2
