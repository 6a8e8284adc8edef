"""The README's blocks marked for testing run, in order and as they stand."""

import functools
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import deformer
from bars import bending_bar

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^<!-- test -->\n```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
EPOCHS = 3  # in place of the default number, which takes minutes


def blocks(language):
    return [code for name, code in BLOCK.findall(README) if name == language]


@pytest.fixture
def walk(tmp_path, monkeypatch):
    """A working directory with the example shapes that the README speaks of."""
    monkeypatch.chdir(tmp_path)
    deformer.save_shapes("walk", bending_bar(count=24), format="obj")
    return tmp_path


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_shell_blocks_run(walk):
    # A `deformer` on the path that is the one under test, and quick to train.
    command = walk / "bin" / "deformer"
    command.parent.mkdir()
    command.write_text(
        f"#!{sys.executable}\nimport sys\n"
        f"if sys.argv[1] in ('train', 'evaluate'): sys.argv += ['--epochs', '{EPOCHS}']\n"
        "if sys.argv[1] == 'evaluate': sys.argv += ['--tests', '2', '--counts', '5']\n"
        "from deformer_app.cli.main import main\nmain()\n"
    )
    command.chmod(0o755)
    environment = {**os.environ, "PATH": f"{command.parent}{os.pathsep}{os.environ['PATH']}"}
    assert blocks("bash")
    for code in blocks("bash"):
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", code],
            env=environment,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
    assert (walk / "walk-model").is_dir()
    assert (walk / "evaluation" / "report.html").is_file()
    exact = deformer.load_mesh("exact.obj").vertices
    assert exact[204] == pytest.approx([0.4, 0.9, 0.0], abs=1e-6)
    assert deformer.load_mesh("pose.ply").vertices.shape == exact.shape


@pytest.mark.slow
def test_python_blocks_run(walk, monkeypatch):
    quick = functools.partial(deformer.train, epochs=EPOCHS)
    monkeypatch.setattr(deformer, "train", quick)
    namespace = {}
    assert blocks("python")
    for code in blocks("python"):
        exec(compile(code, "README.md", "exec"), namespace)
    shapes, model = namespace["shapes"], namespace["model"]
    assert namespace["q"].shape == (24, 226, 9)
    assert abs(namespace["p"] - shapes.vertices).max() < 1e-3
    assert namespace["vertices"].shape == shapes.vertices.shape
    assert namespace["pose"].vertices.shape == model.reference.vertices.shape
    assert (walk / "pose.ply").is_file()


def test_every_block_is_run_or_meant_not_to_be():
    fences = re.findall(r"^```(\w+)$", README, re.MULTILINE)
    assert len(fences) == len(BLOCK.findall(README)), "a block with a language lacks its mark"


def test_links_lead_somewhere():
    targets = re.findall(r"\]\(([^)#:]+)\)", README)
    missing = [target for target in targets if not (ROOT / target).exists()]
    assert not missing


def test_the_commands_at_the_top_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"^make (\w+)", README, re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
