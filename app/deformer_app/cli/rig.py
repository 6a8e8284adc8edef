"""The arguments of `deformer rig`; part of `deformer`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deformer_app import console
from deformer_app.cli.arguments import Bare, Json, Model, examples, refuse_inputs

app = typer.Typer()


@app.command(
    epilog=examples(
        "deformer rig humanoid -o rig.glb",
        "deformer rig walk-model -o rig.glb --bones 20 --influences 8 --fps 30",
    )
)
def rig(
    model: Model,
    output: Annotated[Path, typer.Option("-o", "--output", help="GLB file to write.")],
    bones: Annotated[int, typer.Option(min=1, max=1000, help="Most bones.")] = 30,
    influences: Annotated[
        int, typer.Option(min=1, max=16, help="Most bones that move a vertex.")
    ] = 4,
    fps: Annotated[
        float, typer.Option(min=0.01, max=1000, help="Examples a second in the clip.")
    ] = 24.0,
    bare: Bare = False,
    as_json: Json = False,
) -> None:
    """Make bones and smooth weights that reproduce the model's shapes, for any engine to play.

    The file has the reference with its skeleton, and a clip with one training shape a frame; and
    what the file has from which the model was trained: materials, textures, colours, names.
    """
    from deformer_app.cli import rigs

    refuse_inputs(output, model)
    result = rigs.run(model, output, bones, influences, fps, bare)
    if as_json:
        console.emit(result)
    else:
        rigs.show(result)
