"""The wheel, installed apart from the checkout: every module imports, every file is there."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from paths import ROOT

pytestmark = pytest.mark.slow
SOURCES = {"deformer": ROOT, "deformer_app": ROOT / "app", "deformer_models": ROOT / "models"}
# The optional Qt and the encoder of videos come with `deformer[app]`, Dask with `[cluster]`.
IMPORT_ALL = """
import importlib, json, sys
modules = json.load(sys.stdin)
places = {}
for name in modules:
    try:
        places[name] = importlib.import_module(name).__file__
    except ModuleNotFoundError as error:
        optional = {"PySide6", "pyvistaqt", "qtpy", "imageio_ffmpeg", "dask", "distributed"}
        if error.name.split(".")[0] not in optional:
            raise
import deformer
models = {name: deformer.load_model(name).fingerprint for name in deformer.shipped_models()}
print(json.dumps({"places": places, "models": models}))
"""


def files(suffixes):
    """Files of the three packages in the checkout, relative to where each package lies."""
    found = []
    for package, folder in SOURCES.items():
        for path in (folder / package).rglob("*"):
            if path.suffix in suffixes and "__pycache__" not in path.parts:
                found.append(path.relative_to(folder))
    return found


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder in which the wheel of the checkout is installed, without what it depends on."""
    pytest.importorskip("setuptools", "77", reason="needs setuptools to build a wheel")
    folder = tmp_path_factory.mktemp("installation")
    # A copy: what a build leaves in its folder must not enter the next one.
    tree, target = folder / "tree", folder / "site"
    tree.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tree)
    skipped = shutil.ignore_patterns("__pycache__", "*.egg-info", "build")
    for package, path in SOURCES.items():
        shutil.copytree(path / package, tree / path.relative_to(ROOT) / package, ignore=skipped)
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    command += ["--no-build-isolation", "--disable-pip-version-check", "--target", target, tree]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return target


def test_every_module_imports_and_the_shipped_models_load(site):
    modules = [".".join(path.with_suffix("").parts) for path in files({".py"})]
    modules = [name.removesuffix(".__init__") for name in modules]
    assert len(modules) > 100
    # -I and -P keep the checkout, where this runs, off the path.
    program = f"import sys; sys.path.insert(0, {str(site)!r})\n{IMPORT_ALL}"
    done = subprocess.run(
        [sys.executable, "-I", "-c", program],
        input=json.dumps(modules),
        cwd=site,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    for name, place in found["places"].items():
        assert Path(place).is_relative_to(site), f"{name} came from {place}"
    assert "deformer.editing" in found["places"] and "deformer_app.cli.main" in found["places"]
    assert found["models"], "no model is shipped"


def test_models_interfaces_and_the_template_of_reports_are_installed(site):
    expected = files({".py", ".pyi", ".html", ".json", ".safetensors", ".ply"})
    assert {".pyi", ".html", ".json", ".safetensors", ".ply"} <= {path.suffix for path in expected}
    missing = [str(path) for path in expected if not (site / path).is_file()]
    assert not missing
