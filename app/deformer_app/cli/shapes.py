"""Arguments of the commands about components and new shapes; part of `deformer`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deformer_app import console
from deformer_app.cli.arguments import (
    MOST_SEED,
    MOST_SHAPES,
    MOST_VIEWS,
    Bare,
    ClipName,
    Json,
    Model,
    OutputFps,
    Tolerance,
    examples,
    refuse_inputs,
)

app = typer.Typer()

FOLDER_HELP = "Directory to write to."
SHAPE_HELP = (
    "A mesh file of the model's connectivity, the number of a training shape, a JSON file with a "
    "latent code (as of deformer encode), or: reference."
)


@app.command(
    epilog=examples(
        "deformer components humanoid -o components",
        "deformer components walk-model -o c --top 8",
        "deformer components walk-model --glb keys.glb --top 8",
    )
)
def components(
    model: Model,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help=FOLDER_HELP, show_default=False),
    ] = None,
    glb: Annotated[
        Path | None,
        typer.Option(
            help="GLB file to write the components to as shape keys: each from -1 to 1, with "
            "in-betweens, and a clip that sweeps it.",
            show_default=False,
        ),
    ] = None,
    top: Annotated[
        int | None, typer.Option(min=1, help="Only so many, the strongest.  [default: all]")
    ] = None,
    extreme_count: Annotated[
        int,
        typer.Option(
            "--extreme-shapes",
            min=0,
            help="Training shapes to name for each, those that use it most.",
        ),
    ] = 3,
    turntable: Annotated[
        int,
        typer.Option(
            min=0, max=MOST_VIEWS, help="Pictures of a full turn around each; 0 draws none."
        ),
    ] = 16,
    bare: Bare = False,
    tolerance: Annotated[
        float,
        typer.Option(
            min=0,
            help="Of --glb: the largest distance of a vertex from its path, as a share of the "
            "diagonal; each component has as many in-betweens as that needs, up to 12 a side.",
        ),
    ] = 1e-3,
    as_json: Json = False,
) -> None:
    """Show what every latent component does: meshes, heat-mapped pictures, a table.

    Each component is taken to the extreme value of the training shapes that changes the reference
    most. Writes components.csv and .json, sheet.png, and a mesh, a picture and a turntable each.
    """
    from deformer_app.cli import components as analysing

    refuse_inputs(output, model)
    refuse_inputs(glb, model)
    if output is None and glb is None:
        from deformer import InputError

        raise InputError("components: expected -o DIRECTORY, --glb FILE or both; give one")
    keys = None if glb is None else analysing.write_keys(model, glb, top, tolerance, bare)
    if keys is not None and not as_json:
        analysing.show_keys(keys)
    if output is None:
        if as_json and keys is not None:
            console.emit(keys)
        return
    with console.progress("components") as report:
        result = analysing.run(model, output, top, extreme_count, turntable, bare, report)
    if keys is not None:
        result["shape_keys"] = keys
    if as_json:
        console.emit(result)
        return
    analysing.show(result)


@app.command(
    epilog=examples(
        'deformer name walk-model 3="left arm up" 7=nod',
        "deformer name walk-model 3=",
        'deformer name humanoid 3="left arm up" -o my-humanoid',
    )
)
def name(
    model: Model,
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="K=NAME...",
            help="Component and its name; nothing after = removes the name.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Name those of a copy, written here, instead."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Name components of a model; the names count wherever a component's number does."""
    from deformer_app.cli import components as analysing

    refuse_inputs(output, model)
    result = analysing.rename(model, names, output)
    if as_json:
        console.emit(result)
        return
    console.show_facts(str(result["model"]), result["names"])


@app.command(
    epilog=examples(
        "deformer synthesize humanoid --weights 2=0.8,5=1.2 -o pose.ply",
        "deformer synthesize humanoid --sweep 2=-1:1:9 --sweep 5=0:1:9 -o sweeps",
        "deformer synthesize humanoid --sweep 2=-1:1:49 -o sweep.glb --fps 24",
        "deformer synthesize humanoid --random 12 --seed 1 -o crowd",
        "deformer synthesize humanoid --from 17 --weights 2=0.5 --onto other-model -o pose.ply",
    )
)
def synthesize(
    model: Model,
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="A mesh file (.obj .ply .off .stl .glb .usd). For sweeps and random shapes a "
            "directory, or for one sweep a clip (.glb), a point cache (.mdd .pc2), .usd or .npz.",
        ),
    ],
    weights: Annotated[
        str | None,
        typer.Option(
            help="Component=weight with commas between, by number or by name; 1 is the component's "
            "extreme among the training shapes."
        ),
    ] = None,
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            help="Component=first:last:count; each one given is a row, --weights apply to all."
        ),
    ] = None,
    random: Annotated[
        int | None,
        typer.Option(min=1, max=MOST_SHAPES, help="Draw so many shapes from the latent prior."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=MOST_SEED, help="Of --random.")] = 0,
    bound: Annotated[
        float,
        typer.Option(
            min=0,
            help="Of --random: greatest distance from the nearest training shape; 1 is as far as "
            "those are from each other.",
        ),
    ] = 1.0,
    start: Annotated[
        str, typer.Option("--from", help=f"Shape to start from. {SHAPE_HELP}")
    ] = "reference",
    spaces: Annotated[
        str,
        typer.Option(
            help="latent, or a linear counterpart: of features, or linear of vertices; several "
            "with commas, for sweeps."
        ),
    ] = "latent",
    onto: Annotated[
        str | None,
        typer.Option(help="Carry the deformation over to this model of the same connectivity."),
    ] = None,
    bare: Bare = False,
    fps: OutputFps = 24.0,
    tolerance: Tolerance = 1e-3,
    name: ClipName = None,
    as_json: Json = False,
) -> None:
    """Make new shapes: components weighted, swept, or drawn at random."""
    from deformer_app.cli import outputs, synthesis as synthesising

    refuse_inputs(output, model, start, onto)
    timing = outputs.Timing(fps, tolerance, name)
    request = synthesising.Request(
        model,
        output,
        weights,
        tuple(sweep or ()),
        random,
        seed,
        bound,
        start,
        spaces,
        onto,
        bare,
        timing,
    )
    with console.progress("synthesis") as report:
        result = synthesising.run(request, report)
    if as_json:
        console.emit(result)
        return
    console.show_facts(str(output), {k: v for k, v in result.items() if k not in ("z", "codes")})


@app.command(
    epilog=examples(
        "deformer interpolate humanoid 3 40 -o path",
        "deformer interpolate humanoid reference pose.ply 12 -o path --steps 17 --spaces latent",
    )
)
def interpolate(
    model: Model,
    keys: Annotated[
        list[str],
        typer.Argument(
            metavar="SHAPE SHAPE...",
            help=f"Two or more to go through. Each: {SHAPE_HELP}",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="Directory to write to; or one file for one space: a clip (.glb), a point cache "
            "(.mdd .pc2), .usd or .npz.",
        ),
    ],
    steps: Annotated[
        int,
        typer.Option(min=2, max=MOST_SHAPES, help="Shapes from one to the next, both counted."),
    ] = 9,
    spaces: Annotated[
        str | None,
        typer.Option(
            help="Of latent, features, linear; with commas between.  [default: all; latent for one "
            "file]",
            show_default=False,
        ),
    ] = None,
    bare: Bare = False,
    fps: OutputFps = 24.0,
    tolerance: Tolerance = 1e-3,
    name: ClipName = None,
    as_json: Json = False,
) -> None:
    """Go from shape to shape in latent codes, in features and straight, side by side.

    Says how much shorter edges get on the way than between the shapes they lie between.
    """
    from deformer_app.cli import outputs, synthesis as synthesising

    refuse_inputs(output, model, *keys)
    timing = outputs.Timing(fps, tolerance, name)
    with console.progress("interpolation") as report:
        result = synthesising.between(model, keys, output, steps, spaces, bare, timing, report)
    if as_json:
        console.emit(result)
        return
    rows = [
        [space, f"{found['shortest_total']:.3f}", f"{found['edges_5_percent']:.3f}"]
        for space, found in result["spaces"].items()
    ]
    console.show_table(
        "Lengths on the way over those between the keys, least",
        ["space", "all edges", "edge at 5 %"],
        rows,
    )
    if "morph_targets" in result:
        told = {key: value for key, value in result.items() if key.startswith("morph")}
        console.show_facts(str(output), told)
    for file in result["files"]:
        console.note(f"Wrote {file}")


@app.command(
    epilog=examples(
        "deformer encode humanoid pose.ply", "deformer encode humanoid pose.ply -o code.json"
    )
)
def encode(
    model: Model,
    shape: Annotated[
        Path,
        typer.Argument(
            metavar="SHAPE", help="A mesh of the model's connectivity.", show_default=False
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Write the code (.json), or the mesh that it decodes to."
        ),
    ] = None,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Keep the encoder's code; do not search for a better one."),
    ] = False,
    bare: Bare = False,
    as_json: Json = False,
) -> None:
    """Find the latent code of a shape, and how well the model reproduces it."""
    from deformer_app.cli import synthesis as synthesising

    refuse_inputs(output, model, shape)
    result = synthesising.encode(model, shape, output, quick, bare)
    if as_json:
        console.emit(result)
        return
    console.show_facts(str(shape), {k: v for k, v in result.items() if k != "z"})
