"""The entry point of the `deformer` command: Ctrl-C at any time, and what to install if missing."""

from __future__ import annotations

import gc
import os
import signal
import sys


def main() -> None:
    """Run the command line; exit with 2 and one line where one of its packages is missing."""
    # Unless a shell has the command ignore Ctrl-C. `console.run` replaces this while there is work.
    heeded = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if heeded:
        signal.signal(signal.SIGINT, _leave)
    # Imports make a few hundred thousand objects that stay: looking through them for garbage again
    # and again takes a twentieth of the time of a short command.
    gc.set_threshold(50_000, 20, 20)
    try:
        from deformer_app.cli.main import main as run
    except ModuleNotFoundError as error:
        missing = (error.name or "").split(".")[0]
        if missing in ("", "deformer", "deformer_app"):
            raise
        message = f'deformer: the command line needs {missing}; pip install "deformer[app]"'
        print(message, file=sys.stderr)
        sys.exit(2)
    try:
        run()
    finally:
        # The work has ended, and its status stands. While Python takes itself down, Ctrl-C would
        # end the process with another one, or crash in a library that is half gone.
        if heeded:
            signal.signal(signal.SIGINT, signal.SIG_IGN)


def _leave(number: int, frame: object) -> None:
    """End before the work, when there is nothing to save.

    An exception could become another one in the module that is being imported.
    """
    os.write(2, b"deformer: interrupted\n")
    os._exit(130)
