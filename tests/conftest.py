"""What tests of several modules are given."""

import json
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from deformer_app import console
from deformer_app.cli import main as cli
from scripts import module_of

EXAMPLES = Path(__file__).parents[1] / "examples"

# How long an example takes tells of the machine. Examples are the same each time, so that a test
# fails with the change that breaks it; `pytest --hypothesis-profile default` draws new ones.
settings.register_profile(
    "tests", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("tests")


@pytest.fixture(scope="session")
def load_example():
    """Give the module of a numbered example, by its file's name without suffix."""
    return lambda name: module_of(EXAMPLES / f"{name}.py")


@pytest.fixture
def run(capfd, monkeypatch):
    """Run the command in this process; gives (status, stdout, stderr)."""

    def call(*arguments):
        texts = [str(argument) for argument in arguments]
        monkeypatch.setattr(sys, "argv", ["deformer", *texts])
        capfd.readouterr()
        status = console.run(cli.app, texts)
        return status, *capfd.readouterr()

    return call


@pytest.fixture
def run_json(run):
    """Run the command with --json; gives what it printed, and nothing else may be on stdout."""

    def call(*arguments):
        status, out, err = run(*arguments, "--json")
        assert status == 0, err
        assert out.count("\n") == 1
        return json.loads(out)

    return call


@pytest.fixture
def refuse(run):
    """Run the command with a user's mistake; gives the one line on stderr."""

    def call(*arguments):
        status, out, err = run(*arguments)
        assert status == 2, (out, err)
        assert out == ""
        last = err.splitlines()[-1]
        assert err == last + "\n", "more than one line"
        assert last.startswith("deformer: ")
        assert "Traceback" not in err
        return last

    return call
