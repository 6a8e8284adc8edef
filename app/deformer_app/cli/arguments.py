"""Arguments and options that several commands share. Imports nothing heavy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

SHAPES_HELP = "Directory of OBJ, PLY, OFF, STL or GLB files in natural name order, or one NPZ."
MODEL_HELP = "A model's directory, or the name of a shipped model."

Shapes = Annotated[Path, typer.Argument(metavar="SHAPES", help=SHAPES_HELP, show_default=False)]
Model = Annotated[str, typer.Argument(metavar="MODEL", help=MODEL_HELP, show_default=False)]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]


def examples(*commands: str) -> str:
    """Epilog of a command's help that lists examples."""
    return "\n\n".join(["Examples:", *(f"  {command}" for command in commands)])


def words(text: str | None) -> tuple[str, ...] | None:
    """Words of a text with commas between them; None for None."""
    return None if text is None else tuple(word.strip() for word in text.split(","))
