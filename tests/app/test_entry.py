"""The ways into the command line, and Ctrl-C after the work of a command."""

import os
import signal
import subprocess
import sys

import pytest

COMMAND = f"""
import atexit, os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
atexit.register(os.kill, os.getpid(), {int(signal.SIGINT)})
from deformer_app.entry import main
sys.argv[:] = ["deformer", *sys.argv[1:]]
main()
"""


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize(("arguments", "status"), [(["info"], 0), (["info", "no-such-model"], 2)])
def test_ctrl_c_while_python_takes_itself_down_changes_nothing(arguments, status):
    command = [sys.executable, "-c", COMMAND, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stderr
    assert "interrupted" not in done.stderr


def test_the_package_runs_as_the_command():
    """As torchrun starts it."""
    command = [sys.executable, "-m", "deformer", "info", "no-such-model"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("deformer: no-such-model: no such model")
