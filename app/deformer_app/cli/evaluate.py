"""The arguments of `deformer evaluate`; part of `deformer`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from deformer_app import console
from deformer_app.cli.arguments import (
    MOST_EPOCHS,
    MOST_RUNS,
    Clip,
    Cluster,
    Fps,
    Json,
    Reference,
    examples,
    numbers,
    words,
)

app = typer.Typer()


class Preset(StrEnum):
    """Predefined evaluations."""

    quick = "quick"
    paper = "paper"


@app.command(
    epilog=examples(
        "deformer evaluate walk/ -o evaluation --preset quick",
        "deformer evaluate walk-model walk/ -o evaluation --methods arap,arap-nearest",
        "deformer evaluate walk/ -o evaluation --protocols layout --methods autoencoder,pca,arap",
        "deformer evaluate datasets/ -o evaluation --preset paper --processes 2",
        "deformer evaluate walk/ -o evaluation --cluster tcp://10.0.0.1:8786",
    )
)
def evaluate(
    paths: Annotated[
        list[str],
        typer.Argument(
            metavar="[MODEL] SHAPES...",
            help="A model and the shapes that it was trained from, measured on those it has not "
            "seen; or sets of shapes, on which every method is trained.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", help="Directory for results and report; the same again goes on."
        ),
    ],
    preset: Annotated[
        Preset | None,
        typer.Option(
            help="quick: minutes, a first look. paper: the paper's tables and figures from a "
            "folder with its data sets."
        ),
    ] = None,
    methods: Annotated[
        str | None, typer.Option(help="Names with commas between.  \\[default: all]")
    ] = None,
    protocols: Annotated[
        str | None,
        typer.Option(
            help="reconstruction, sparse_control, layout, sensitivity, noise, "
            "rotation.  "
            "\\[default: reconstruction,sparse_control,rotation]"
        ),
    ] = None,
    components: Annotated[
        str | None,
        typer.Option(
            help="Numbers of components for reconstruction; 50 of them, or the largest, for the "
            "other protocols.  \\[default: 50]"
        ),
    ] = None,
    counts: Annotated[
        str | None, typer.Option(help="Numbers of control points.  \\[default: 5,10,20,40,80]")
    ] = None,
    splits: Annotated[
        int | None,
        typer.Option(min=1, max=MOST_RUNS, help="How many random splits.  \\[default: 1]"),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(
            min=1, max=MOST_RUNS, help="First control points drawn for each split.  \\[default: 1]"
        ),
    ] = None,
    split: Annotated[
        list[Path] | None,
        typer.Option(
            help='JSON {"train": \\[indices], "test": \\[indices]} in place of random splits; can '
            "be given several times."
        ),
    ] = None,
    layout: Annotated[
        Path | None,
        typer.Option(
            help="Handles file, as of deformer layout: its vertices are the control points of the "
            "protocol layout, which is measured alone unless --protocols names others."
        ),
    ] = None,
    sequence: Annotated[
        bool,
        typer.Option(
            "--sequence",
            help="The shapes are frames in order: train on one in ten and not on half, and "
            "measure motion, too.",
        ),
    ] = False,
    align: Annotated[
        bool,
        typer.Option(
            "--align", help="First take each shape's rigid motion against the reference away."
        ),
    ] = False,
    up: Annotated[
        str | None, typer.Option(help="Axis that points up in pictures.  \\[default: y]")
    ] = None,
    epochs: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=MOST_EPOCHS,
            help="At most so many steps of a network's training.  \\[default: its own]",
        ),
    ] = None,
    tests: Annotated[
        int | None, typer.Option(min=1, help="Measure on at most so many test shapes.")
    ] = None,
    processes: Annotated[int, typer.Option(min=1, max=MOST_RUNS, help="Trainings at a time.")] = 1,
    cluster: Cluster = None,
    reference: Reference = None,
    fps: Fps = None,
    clip: Clip = None,
    as_json: Json = False,
) -> None:
    """Measure how well methods recover shapes that they have not seen; write tables and a report.

    Writes results.json, results.csv, run.json and report.html. An interrupted run goes on when the
    same command is given again.
    """
    from deformer_app.report import evaluation as evaluating

    options = evaluating.Options(
        methods=words(methods),
        protocols=words(protocols),
        components=numbers("components", components) if components is not None else None,
        counts=numbers("counts", counts) if counts is not None else None,
        splits=splits,
        seeds=seeds,
        split_files=tuple(split or ()),
        sequence=sequence,
        align=align,
        up=up,
        epochs=epochs,
        tests=tests,
        layout=layout,
        reference=reference,
        fps=fps,
        clip=clip,
    )
    chosen = preset.value if preset else None
    try:
        with console.measurements_progress() as report:
            result = evaluating.run(paths, output, options, chosen, processes, report, cluster)
    except KeyboardInterrupt:
        console.note("Interrupted: what is finished is kept; the same command goes on.")
        raise console.Interrupted from None
    if as_json:
        console.emit(result)
        return
    console.show_facts(str(output), result)
