"""The arguments of `deformer layout`; part of `deformer`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deformer_app import console
from deformer_app.cli.arguments import (
    MOST_LISTED,
    Json,
    Model,
    examples,
    numbers,
    refuse_inputs,
)

app = typer.Typer()


@app.command(
    epilog=examples(
        "deformer layout humanoid --count 20 -o layout.json --picture layout.png",
        "deformer layout walk-model --count 20 --symmetric --fixed 12,40",
        "deformer layout walk-model --count 5,10,20 --noise 0.01 --exclude 300-420",
    )
)
def layout(
    model: Model,
    count: Annotated[
        str,
        typer.Option(
            help="Number of handles. Several with commas between give one nested layout: the "
            "handles of each are the first ones of the next."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="JSON file for the handles, at their places on the reference."
        ),
    ] = None,
    symmetric: Annotated[
        bool,
        typer.Option("--symmetric", help="Handles in left and right pairs, or in the middle."),
    ] = False,
    fixed: Annotated[
        str | None, typer.Option(help="Vertices that are handles in any case: 12,40.")
    ] = None,
    exclude: Annotated[
        str | None,
        typer.Option(
            help="Vertices that must not be handles: 12,300-420; or a JSON file "
            '{"vertices": \\[indices]}.'
        ),
    ] = None,
    noise: Annotated[
        float,
        typer.Option(
            min=0,
            max=1,
            help="Standard deviation of the handles' positions in use, in bounding diagonals.",
        ),
    ] = 0.0,
    picture: Annotated[
        Path | None,
        typer.Option(help="PNG or JPEG of the numbered handles and of what stays uncertain."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Choose the vertices to track, paint or rig: those that tell most about all others.

    Prints, for each handle, how far the vertices nearest to it are expected to be off, and for each
    count how far all are. The file is read by fit, by evaluate --layout and by the window.
    """
    from deformer_app.cli import layouts as laying_out

    refuse_inputs(output, model, exclude)
    refuse_inputs(picture, model, exclude, output)
    excluded = None
    if exclude is not None and not exclude.endswith(".json"):
        excluded = numbers("exclude", exclude, least=0, spans=True)
    result = laying_out.run(
        model,
        numbers("count", count, most=MOST_LISTED),
        Path(exclude) if exclude is not None and excluded is None else excluded or (),
        output,
        picture,
        symmetric=symmetric,
        fixed=numbers("fixed", fixed, least=0) if fixed else (),
        noise=noise,
    )
    if as_json:
        console.emit(result)
        return
    laying_out.show(result)
