"""`python -m deformer`: the command line, which the application registers."""

from __future__ import annotations

import sys
from importlib.metadata import entry_points


def main() -> None:
    """Run what the console script `deformer` runs."""
    found = entry_points(group="console_scripts", name="deformer")
    if not found:
        sys.exit('deformer: the command line is not installed; pip install "deformer[app]"')
    next(iter(found)).load()()


if __name__ == "__main__":
    main()
