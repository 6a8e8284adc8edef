"""Arguments and options that several commands share. Imports nothing heavy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

# Most shapes, and pictures of a row, that a command makes: a sheet and an animation hold no more.
MOST_SHAPES = 10_000
# Most pictures of a full turn.
MOST_VIEWS = 1000
# Most steps of a training: the names of its checkpoints have seven digits.
MOST_EPOCHS = 9_999_999
# Most splits, seeds and processes of an evaluation, and the largest number in a list of numbers.
MOST_RUNS, MOST_LISTED = 1000, 1_000_000
# Largest seed that all generators of random numbers take.
MOST_SEED = 2**63 - 1

SHAPES_HELP = (
    "Directory of OBJ, PLY, OFF, STL, GLB, glTF or USD files in natural name order; or one NPZ; or "
    "one GLB, glTF or USD file with morph targets or an animation; or a point cache (MDD, PC2) "
    "beside its mesh."
)
MODEL_HELP = "A model's directory, or the name of a shipped model."

Shapes = Annotated[Path, typer.Argument(metavar="SHAPES", help=SHAPES_HELP, show_default=False)]
Model = Annotated[str, typer.Argument(metavar="MODEL", help=MODEL_HELP, show_default=False)]
Reference = Annotated[
    str | None,
    typer.Option(
        help="The undeformed shape: the name or the number of one of the shapes, or a mesh file, "
        "which becomes shape 0.  [default: the first]",
        show_default=False,
    ),
]
Fps = Annotated[
    float | None,
    typer.Option(
        help="Frames a second at which an animation is sampled.  [default: 24; of USD its own]",
        show_default=False,
    ),
]
Clip = Annotated[
    str | None,
    typer.Option(
        help="Name or number of a file's animation, to be read in place of its morph targets or of "
        "its first animation.",
        show_default=False,
    ),
]
OutputFps = Annotated[
    float, typer.Option("--fps", min=0.001, max=1e6, help="Of sequences: frames a second.")
]
Tolerance = Annotated[
    float,
    typer.Option(
        min=0,
        help="Of a GLB clip: the largest distance of a vertex from its place, as a share of the "
        "diagonal; it has as few morph targets as that allows.",
    ),
]
ClipName = Annotated[
    str | None,
    typer.Option(
        "--name", help="Of a GLB clip and USD: its name.  [default: the file's]", show_default=False
    ),
]
Bare = Annotated[
    bool,
    typer.Option(
        "--bare",
        help="Write positions and triangles alone, and nothing that the file has beside them from "
        "which the model was trained.",
    ),
]
Cluster = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="A Dask scheduler, tcp://HOST:PORT, whose workers compute; or local:N, N workers of "
        "this machine.  \\[default: this process]",
        show_default=False,
    ),
]
Memory = Annotated[
    str | None,
    typer.Option(
        metavar="SIZE",
        help="Memory to use, such as 2GB; what exceeds it is in temporary files. The model does "
        "not depend on it.  [default: half of what is free]",
        show_default=False,
    ),
]
Cache = Annotated[
    Path | None,
    typer.Option(
        metavar="DIRECTORY",
        help="Where the temporary files are; they are gone when the command ends.  [default: "
        "beside the output, or the system's]",
        show_default=False,
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]


def examples(*commands: str) -> str:
    """Epilog of a command's help that lists examples."""
    return "\n\n".join(["Examples:", *(f"  {command}" for command in commands)])


def words(text: str | None) -> tuple[str, ...] | None:
    """Words of a text with commas between them; None for None."""
    return None if text is None else tuple(word.strip() for word in text.split(","))


_UNITS = {"KB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12}


def bytes_of(size: str | None) -> float | None:
    """Bytes of a size such as "2GB" or "1.5 GB"; None for None."""
    if size is None:
        return None
    text = size.strip().upper()
    number, unit = text[:-2].strip(), _UNITS.get(text[-2:])
    if unit is None or not number.replace(".", "", 1).isdecimal() or len(number) > 12:
        raise typer.BadParameter(
            f"expected a size such as 2GB or 800MB, got {size[:60]!r}", param_hint="--memory"
        )
    return float(number) * unit


def numbers(
    name: str, text: str, *, least: int = 1, most: int = MOST_LISTED, spans: bool = False
) -> tuple[int, ...]:
    """Whole numbers with commas between them, each once, in order.

    Args:
        name: name of the option.
        text: the numbers.
        least: the smallest allowed.
        most: the largest allowed.
        spans: true to allow spans such as 3-5, which is 3,4,5.
    """
    found: set[int] = set()
    for word in text.split(","):
        first, dash, last = word.strip().partition("-")
        ends = (first, last) if dash and spans else (word.strip(),)
        if not all(end.isdecimal() and len(end) < 20 for end in ends):
            raise typer.BadParameter(
                f"expected whole numbers with commas between, got {text[:60]!r}",
                param_hint=f"--{name}",
            )
        low, high = int(ends[0]), int(ends[-1])
        if not least <= low <= high <= most:
            raise typer.BadParameter(
                f"expected numbers of {least}…{most}, got {text[:60]!r}",
                param_hint=f"--{name}",
            )
        found |= set(range(low, high + 1))
    return tuple(sorted(found))


def refuse_inputs(output: Path | None, *inputs: str | Path | None) -> None:
    """Raise InputError, before any work, if `output` is one of the inputs or inside a model.

    Args:
        output: the file or directory to write, if any.
        inputs: files and directories to read; also names that are neither, and None.
    """
    if output is None:
        return
    target = output.resolve()
    for given in filter(None, inputs):
        source = Path(given)
        try:
            if not source.exists():
                continue
        except OSError:  # no path at all, such as a number of thousands of digits
            continue
        # By what is on the disk, not by name: some systems ignore case.
        there = [path for path in (target, *target.parents) if path.exists()]
        same = next((path for path in there if path.samefile(source)), None)
        of_model = same not in (None, target) and (source / "model.json").is_file()
        if of_model or same == target:
            from deformer import InputError

            what = "is inside" if of_model else "is also the input"
            raise InputError(
                f"{output}: {what} {given}, which it would change; choose another output"
            )
