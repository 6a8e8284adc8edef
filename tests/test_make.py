"""What `make` tells an old Python, and what it does with a broken `.venv`."""

import shutil
import subprocess
import sys

import pytest

from paths import ROOT

pytestmark = pytest.mark.skipif(
    shutil.which("make") is None or sys.platform == "win32", reason="needs make"
)


@pytest.fixture
def make(tmp_path):
    """Runs `make demo` in a folder that has the Makefile alone, with a Python by its text."""
    shutil.copyfile(ROOT / "Makefile", tmp_path / "Makefile")
    for name in ("pyproject.toml", "constraints.txt"):
        (tmp_path / name).touch()

    def run(script):
        python = tmp_path / "python"
        python.write_text(f"#!/bin/sh\n{script}\n")
        python.chmod(0o755)
        return subprocess.run(
            ["make", "demo", f"PYTHON={python}"], cwd=tmp_path, capture_output=True, text=True
        )

    return run


def test_a_python_that_is_too_old_is_told_before_it_makes_anything(make, tmp_path):
    done = make("exit 1  # as the comparison of versions does")
    assert done.returncode != 0
    assert "Python 3.11 or newer is needed" in done.stderr
    assert not (tmp_path / ".venv").exists()


def test_an_environment_without_pip_is_made_anew(make, tmp_path):
    """As Debian leaves one where python3-venv was missing."""
    left = tmp_path / ".venv" / "bin" / "python"
    left.parent.mkdir(parents=True)
    left.write_text("#!/bin/sh\nexit 1\n")
    left.chmod(0o755)
    done = make('if [ "$1" = "-m" ]; then echo "$@" >made; exit 3; fi')
    assert (tmp_path / "made").read_text() == "-m venv .venv\n"
    assert done.returncode != 0


def test_an_environment_that_is_whole_is_kept(make, tmp_path):
    whole = tmp_path / ".venv" / "bin" / "python"
    whole.parent.mkdir(parents=True)
    whole.write_text("#!/bin/sh\n")
    whole.chmod(0o755)
    demo = whole.with_name("deformer")
    demo.write_text('#!/bin/sh\necho "$1 runs"\n')
    demo.chmod(0o755)
    done = make("echo wrong; exit 1")
    assert done.returncode == 0, done.stderr
    assert "installing packages into .venv" in done.stdout and "demo runs" in done.stdout
    assert "wrong" not in done.stdout
