"""Ctrl-C at any moment of a command: one line and status 130."""

import errno
import os
import signal
import subprocess
import sys
import time

import pytest
import typer

from deformer_app import console
from waiting import HANG

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")

PRESSED = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
module, sys.argv[1:] = sys.argv[1], ["info", "humanoid"]
class Press:
    def find_spec(self, name, path=None, target=None):
        if name == module:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Press())
from deformer_app.entry import main
main()
"""


@pytest.mark.parametrize(
    "module",
    ["deformer_app.cli.main", "typer", "rich.console", "numpy", "scipy.sparse", "safetensors"],
)
def test_ctrl_c_during_an_import_is_one_line(module):
    done = subprocess.run([sys.executable, "-c", PRESSED, module], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "deformer: interrupted\n"


@pytest.fixture
def heeded():
    """Ctrl-C as a program has it that no shell has started in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_where_python_ignores_exceptions_comes_again(heeded):
    class Ending:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt), console._CtrlC():
        Ending()
        time.sleep(HANG)


def failing(pressed):
    app = typer.Typer()
    app.callback()(lambda: None)  # so that the command has a name

    @app.command()
    def command():
        try:
            if pressed:
                signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            pass
        raise ImportError("cannot import name")

    return app


def test_what_a_library_makes_of_ctrl_c_is_no_traceback(heeded, capsys):
    assert console.run(failing(pressed=True), ["command"]) == 130
    assert capsys.readouterr().err == "deformer: interrupted\n"
    with pytest.raises(ImportError):
        console.run(failing(pressed=False), ["command"])
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_what_the_system_refuses_comes_with_a_remedy():
    full = OSError(errno.ENOSPC, "No space left on device", "out.ply")
    assert console.system_mistake(full) == (
        "out.ply: No space left on device; free some space, or choose another place"
    )
    assert console.system_mistake(OSError(errno.EIO, "broken")).startswith("system: broken; ")


def test_bytes_of_names_and_pairs_and_thousands_are_readable():
    assert "a\udcff\u00e9".encode("ascii", console.READABLE) == rb"a\xff\xe9"
    assert console.brief([[0, 3], [1, 4]]) == "(0, 3), (1, 4)"
    assert console.brief(12345.6) == "12350" and console.brief(1e9) == "1e+09"
