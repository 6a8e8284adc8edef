"""The entry point of the `deformer` command; it says what to install where packages are missing."""

from __future__ import annotations

import gc
import sys


def main() -> None:
    """Run the command line; exit with 2 and one line where one of its packages is missing."""
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
    run()
