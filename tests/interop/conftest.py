"""Other programs that the tests of this folder run; `make interop` installs them and says where."""

import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent
# Python with bpy, and a folder with the node_modules gltf-validator and three.
BLENDER, NODE = "DEFORMER_BLENDER_PYTHON", "DEFORMER_NODE_FOLDER"


@dataclass
class Imported:
    """What Blender has of a file: positions (frames, V, 3), and facts of each mesh."""

    vertices: np.ndarray
    facts: dict

    @property
    def mesh(self):
        (mesh,) = self.facts["meshes"]
        return mesh


def _run(command, **options):
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, **options)
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
    return done.stdout


def _installed(variable, what):
    """Where an environment variable says that another program is; skips the test without it."""
    found = os.environ.get(variable)
    if not found:
        pytest.skip(f"{variable} names no {what}: make interop")
    return found


@pytest.fixture(scope="session")
def blender(tmp_path_factory):
    """(path, frames, base) → `Imported`."""
    python = _installed(BLENDER, "Python with Blender")
    folder = tmp_path_factory.mktemp("blender")

    def imported(path, frames=(0,), base=None):
        output = folder / "found.npz"
        command = [python, str(HERE / "in_blender.py"), str(path), str(output), *map(str, frames)]
        _run(command + (["--base", str(base)] if base else []))
        found = np.load(output)
        return Imported(found["vertices"], json.loads(str(found["facts"])))

    return imported


@pytest.fixture(scope="session")
def validated():
    """Checks that the Khronos validator has nothing to say of a GLB file."""
    folder = _installed(NODE, "folder with the validator")

    def check(path):
        environment = os.environ | {"NODE_PATH": str(Path(folder) / "node_modules")}
        text = _run(["node", str(HERE / "validate.cjs"), str(path)], env=environment)
        issues = json.loads(text)["issues"]
        assert issues["numErrors"] == issues["numWarnings"] == 0, issues["messages"][:5]

    return check


@pytest.fixture(scope="session")
def three():
    """(path, times in seconds) → positions (times, V, 3) as three.js plays a GLB file."""
    folder = _installed(NODE, "folder with three.js")

    def played(path, times):
        modules = Path(folder) / "node_modules"
        command = ["node", str(HERE / "in_three.mjs"), str(modules), str(path), *map(str, times)]
        return np.array(json.loads(_run(command)))

    return played


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """A folder of files that Blender has exported; see `from_blender.py`."""
    python = _installed(BLENDER, "Python with Blender")
    folder = tmp_path_factory.mktemp("exported")
    _run([python, str(HERE / "from_blender.py"), str(folder)])
    return folder
