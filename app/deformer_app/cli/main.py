"""The `deformer` command; each command imports heavy modules only when it runs."""

from __future__ import annotations

import os
import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deformer_app import console
from deformer_app.cli import (
    evaluate as evaluate_command,
    layout as layout_command,
    rig as rig_command,
    shapes as shape_commands,
)
from deformer_app.cli.arguments import (
    MODEL_HELP,
    MOST_EPOCHS,
    MOST_SEED,
    Bare,
    Cache,
    Clip,
    ClipName,
    Cluster,
    Fps,
    Json,
    Memory,
    OutputFps,
    Reference,
    Shapes,
    Tolerance,
    bytes_of,
    examples,
    refuse_inputs,
)

if TYPE_CHECKING:
    from deformer import DeformationModel


app = typer.Typer(
    name="deformer",
    help="Drag a few points of a mesh; a prior learned from example shapes moves the rest.",
    epilog="Start with: deformer demo",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)

app.add_typer(shape_commands.app)
app.add_typer(evaluate_command.app)
app.add_typer(layout_command.app)
app.add_typer(rig_command.app)


class Config(StrEnum):
    """Networks and losses to train with."""

    default = "default"
    paper = "paper"


def main() -> None:
    """Run the command line and exit with its status; without arguments show the help."""
    # The threads of OpenMP and OpenBLAS spin while they wait for each other. On a busy machine
    # training then takes 2 to 10 times as long, and a drag 10 times; its matrices are too small for
    # several threads anyway. PyTorch and numpy read these variables when they are imported, so they
    # are set here.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(console.run(app))


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"deformer {version('deformer')}")
        raise typer.Exit


@app.callback()
def _options(
    _: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version and exit.", is_eager=True, callback=_print_version
        ),
    ] = False,
) -> None:
    pass


@app.command(
    epilog=examples(
        "deformer check walk/",
        "deformer check walk.npz --json",
        "deformer check walk/ --fix walk-fixed --report walk.html",
    )
)
def check(
    shapes: Shapes,
    fix: Annotated[
        Path | None,
        typer.Option(
            help="Directory for repaired copies, with the names and formats of the originals."
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="HTML file for a report with pictures.")
    ] = None,
    reference: Reference = None,
    fps: Fps = None,
    clip: Clip = None,
    memory: Memory = None,
    cache: Cache = None,
    as_json: Json = False,
) -> None:
    """Examine example shapes before training: what they hold, what is wrong with them.

    Exits with 1 if they, or their repaired copies, cannot be trained on.
    """
    import deformer
    from deformer_app.cli import check as checking

    refuse_inputs(report, shapes)
    workspace = deformer.Workspace(bytes_of(memory), cache)
    result = checking.run(shapes, fix, report, reference, fps, clip, workspace)
    if as_json:
        console.emit(result)
    else:
        checking.show(shapes, result)
    if not result["usable"]:
        raise typer.Exit(1)


@app.command(
    epilog=examples(
        "deformer train walk/ -o walk-model --components 20",
        "deformer train walk/ -o walk-model --resume",
        "deformer train frames.npz -o walk-model --memory 4GB",
        "deformer train walk/ -o walk-model --cluster tcp://10.0.0.1:8786",
    )
)
def train(
    shapes: Shapes,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Directory to write the model to.")
    ],
    components: Annotated[int, typer.Option(min=1, help="Latent dimensions K.")] = 50,
    epochs: Annotated[
        int | None,
        typer.Option(
            min=1, max=MOST_EPOCHS, help="Steps of the optimiser.  [default: the configuration's]"
        ),
    ] = None,
    split: Annotated[
        Path | None,
        typer.Option(
            help='JSON {"train": \\[indices], "test": \\[indices]}; trains on all if absent.'
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=MOST_SEED, help="Seed of everything random.")] = 0,
    device: Annotated[str, typer.Option(help="auto, cpu, cuda or mps.")] = "auto",
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from the checkpoint of an interrupted run.")
    ] = False,
    config: Annotated[
        Config, typer.Option(help="default, or the network and losses of the paper.")
    ] = Config.default,
    align: Annotated[
        bool,
        typer.Option(
            "--align", help="First take each shape's rigid motion against the reference away."
        ),
    ] = False,
    up: Annotated[
        str, typer.Option(help="Axis that points up, in pictures, USD and GLB: x, y, z, -x…")
    ] = "y",
    reference: Reference = None,
    fps: Fps = None,
    clip: Clip = None,
    memory: Memory = None,
    cache: Cache = None,
    cluster: Cluster = None,
    as_json: Json = False,
) -> None:
    """Learn a model from example shapes.

    Checkpoints are kept in OUTPUT.checkpoint while training runs. Ctrl-C saves what is finished,
    the best model so far if there is one; --resume goes on from there.
    """
    import deformer
    from deformer import io
    from deformer_app.cli import rebuilding, training_guards as guards
    from deformer_app.cli.check import shape_names

    if deformer.assist_training():
        return
    refuse_inputs(output, shapes, split)
    limit = bytes_of(memory)
    options: dict[str, Any] = {
        "components": components,
        "config": config.value,
        "epochs": epochs,
        "align_shapes": align,
        "seed": seed,
    }
    with (
        guards.outputs(output, options if resume else None) as checkpoint,
        guards.kept_if_cut_short(checkpoint),
    ):
        workspace = deformer.Workspace(limit, cache or checkpoint.absolute().parent)
        with console.progress("loading") as progress:
            sequence = deformer.load_shapes(
                shapes, progress, fps=fps, clip=clip, workspace=workspace
            )
        chosen = None
        if reference is not None:
            sequence, chosen = io.with_reference(sequence, reference, workspace)
        advice = guards.refuse_unusable(shapes, sequence)
        parts = io.load_split(split, len(sequence)) if split else None
        with console.training_progress() as report:
            model = deformer.train(
                sequence,
                **options,
                reference=chosen,
                split=parts,
                device=device,
                up=up,
                document=deformer.load_document(shapes),
                checkpoint=checkpoint,
                resume=resume,
                workspace=workspace,
                cluster=cluster,
                on_progress=report,
            )
        try:
            model.save(output)
        except deformer.InputError as error:
            raise deformer.InputError(f"{error}; {guards.how_to_go_on(checkpoint)}") from error
        interrupted = bool(model.summary.get("interrupted"))
        if not interrupted:
            deformer.remove_checkpoint(checkpoint)
    if as_json:
        console.emit({"model": str(output), **_describe(model)})
    else:
        console.show_facts(f"{output}", model.summary)
    if interrupted:
        console.note(f"Interrupted: saved the best model so far to {output}.")
        console.note(f"To go on: {guards.command_to_resume()}")
        raise console.Interrupted
    console.note(f"Saved {output}.")
    for message in [*advice, *rebuilding.advice(model, shape_names(shapes, sequence))]:
        console.note(message)


@app.command(epilog=examples("deformer info", "deformer info humanoid", "deformer info walk-model"))
def info(
    model: Annotated[
        str | None,
        typer.Argument(metavar="[MODEL]", help=f"{MODEL_HELP} Lists the shipped models if absent."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show what is in a model, or which models are shipped."""
    import deformer

    if model is None:
        names = list(deformer.shipped_models())
        if as_json:
            console.emit({"shipped": names})
        else:
            console.out.print("Shipped models:", *(names or ["none"]))
        return
    loaded = deformer.load_model(model)
    facts = _describe(loaded)
    if as_json:
        console.emit({"model": model, **facts})
        return
    summary, config = facts.pop("summary"), facts.pop("config")
    console.show_facts(model, facts)
    console.show_facts("Configuration", config)
    console.show_facts("Training", summary)


@app.command(
    epilog=examples(
        "deformer fit humanoid handles.json -o pose.ply",
        "deformer fit walk-model frames.json -o poses.npz --hard",
        "deformer fit walk-model frames.json -o walk.glb --fps 30",
        "deformer fit walk-model takes/*.json -o clips --cluster local:4",
        "deformer fit --session edited.json -o pose.ply",
    )
)
def fit(
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="One pose: a mesh file (.obj .ply .off .stl .glb .usd). A sequence: a clip "
            "(.glb), a point cache (.mdd .pc2), .usd, .npz, or a directory of mesh files.",
        ),
    ],
    model: Annotated[
        str | None,
        typer.Argument(metavar="MODEL", help=MODEL_HELP, show_default=False),
    ] = None,
    handles: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="HANDLES...",
            help='JSON {"handles": \\[{"vertex": 17, "position": \\[x, y, z]}, …]}, or {"frames": '
            '\\[\\[…handles…], …]} for a sequence. Optional: "weight"; "kind", "soft", "exact" or '
            '"pin"; "face" with "barycentric" in place of "vertex"; "offset" along the normal; '
            '"orientation" \\[w, x, y, z], of the surface relative to the reference. Beside them '
            '"noise", as --noise. Of several files, or with --cluster, each has a result of its '
            "name in the directory OUTPUT.",
            show_default=False,
        ),
    ] = None,
    session: Annotated[
        Path | None,
        typer.Option(
            help="In place of HANDLES: a session saved by deformer edit, to the pose it shows. "
            "MODEL is then only needed if the model has moved.",
        ),
    ] = None,
    hard: Annotated[
        bool, typer.Option("--hard", help="Meet every handle exactly, and not just closely.")
    ] = False,
    noise: Annotated[
        float | None,
        typer.Option(
            help="Standard deviation of the positions' coordinates, in their units: soft handles "
            "are met as closely as that tells.  \\[default: what HANDLES says, or exact positions]",
        ),
    ] = None,
    smoothness: Annotated[
        float | None,
        typer.Option(
            min=0,
            help="Of sequences: weight of accelerations; 0 fits frame by frame.  "
            "\\[default: what HANDLES says, or 10]",
        ),
    ] = None,
    device: Annotated[str, typer.Option(help="Of sequences: cpu, cuda, mps or auto.")] = "cpu",
    backend: Annotated[
        str | None,
        typer.Option(
            help="Of sequences: numba or torch.  [default: numba on the CPU, torch elsewhere]"
        ),
    ] = None,
    bare: Bare = False,
    fps: OutputFps = 24.0,
    tolerance: Tolerance = 1e-3,
    name: ClipName = None,
    suffix: Annotated[
        str | None,
        typer.Option(
            "--format", help="Of several HANDLES: format of the results.  \\[default: glb]"
        ),
    ] = None,
    cluster: Cluster = None,
    memory: Memory = None,
    cache: Cache = None,
    as_json: Json = False,
) -> None:
    """Pose a model by handles: where a few points of its surface should be.

    A sequence is fitted as a whole, without jitter; its frames may have different handles. It need
    not fit in memory. What is fitted of a long one is kept in OUTPUT.windows: if the command is
    interrupted or killed, the same command goes on.
    """
    import deformer
    from deformer_app.cli import fit as fitting, outputs

    refuse_inputs(output, model, *(handles or ()), session)
    if noise is not None and (hard or session is not None):
        other = "--hard, which meets every handle exactly" if hard else "--session"
        raise deformer.InputError(f"--noise: got it with {other}; give one of them")
    if session is not None:
        _fit_session(session, model, handles, output, bare, as_json)
        return
    if model is None or not handles:
        raise deformer.InputError(
            "fit: expected MODEL and HANDLES, or --session FILE; see deformer fit --help"
        )
    timing = outputs.Timing(fps, tolerance, name)
    if len(handles) > 1 or cluster is not None:
        from deformer_app.cli import many_fits

        for option, value in (("--memory", memory), ("--cache", cache)):
            if value is not None:
                raise deformer.InputError(
                    f"{option}: fits of several files and on a cluster have their results in "
                    "memory; leave it out, or fit one file without --cluster"
                )
        options = fitting.Options(hard, noise, smoothness, device, backend)
        with console.progress("fitting") as report:
            result = many_fits.run(
                model, handles, output, suffix or "glb", options, bare, timing, cluster, report
            )
        if as_json:
            console.emit(result)
        else:
            many_fits.show(result)
        return
    if suffix is not None:
        raise deformer.InputError(
            "--format: got it with one file, whose format the ending of OUTPUT tells; leave it out"
        )
    loaded = deformer.load_model(model)
    workspace = deformer.Workspace(bytes_of(memory), cache or outputs.folder_beside(output))
    file = fitting.handles_of(loaded, handles[0], workspace)
    outputs.check_output(output, file.is_sequence)
    noise = fitting.chosen_noise(noise, file)
    if file.is_sequence:
        from deformer_app.cli import long_fits

        options = fitting.Options(hard, noise, smoothness, device, backend)
        result = long_fits.run(loaded, file, output, options, workspace, bare, timing, as_json)
    else:
        vertices, result = fitting.pose(loaded, file, hard, noise)
        outputs.save(output, loaded, vertices, bare)
    turned = fitting.axis_warning(loaded, file)
    if as_json:
        warning = turned or fitting.unit_warning(loaded, file)
        console.emit({**result, "warning": warning, "output": str(output)})
        return
    if turned:
        console.note(turned)
    hidden = ("z", "frames")
    facts = {name: value for name, value in result.items() if name not in hidden}
    console.show_facts(str(output), {"frames": len(file.frames), **facts})


@app.command(
    epilog=examples(
        "deformer edit",
        "deformer edit humanoid",
        "deformer edit walk-model",
        "deformer edit --session pose.json",
    )
)
def edit(
    model: Annotated[
        str | None,
        typer.Argument(metavar="[MODEL]", help=f"{MODEL_HELP} The start page if absent."),
    ] = None,
    session: Annotated[Path | None, typer.Option(help="A saved session to go on with.")] = None,
    plain: Annotated[
        bool,
        typer.Option(
            "--plain",
            help="A bare window without menus, of humanoid if no MODEL is named; needs no Qt.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Open a window: click a vertex, drag it, done.

    Menus and docks need Qt: pip install "deformer\\[app]". With --json what came of it is printed
    when the window is closed.
    """
    from deformer import InputError
    from deformer_app.viewer.model_files import first_model
    from deformer_app.viewer.settings import EditInterrupted

    # Mistakes come as a line on the terminal, before there is a window.
    opened = first_model(model, session)
    if fault := console.screen_fault():
        raise InputError(
            f"edit: there is no screen to open a window on ({fault}); `deformer fit` and "
            "`deformer demo` need none"
        )
    try:
        if plain:
            from deformer_app.viewer.plain import PlainWindow

            named, saved = opened
            edited = PlainWindow(named or "humanoid", saved, session).run()
        else:
            try:
                from deformer_app.viewer.qt.start import run_editor
            except ImportError as error:
                raise InputError(
                    f'edit: the window needs Qt ({error}); pip install "deformer[app]", or add '
                    "--plain"
                ) from error
            edited = run_editor(*opened, session)
    except EditInterrupted as interrupt:
        if interrupt.kept is None:
            raise
        console.note(
            "Interrupted: the unsaved session is kept; to go on: "
            + shlex.join(["deformer", "edit", "--session", str(interrupt.kept)])
        )
        raise console.Interrupted from None
    if as_json and edited is not None:
        console.emit(edited.summary())


@app.command(epilog=examples("deformer demo", "deformer demo -o pictures --json"))
def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Directory for the pictures and the mesh.")
    ] = Path("demo-out"),
    model: Annotated[str, typer.Option(help=f"{MODEL_HELP} It should stand upright.")] = "humanoid",
    as_json: Json = False,
) -> None:
    """Replay a drag on the shipped model; write pictures, an animation and the last pose.

    Needs no network and no display.
    """
    from deformer_app.cli import demo as player

    refuse_inputs(output, model)
    with console.progress("demo") as report:
        result = player.run(model, output, report)
    if as_json:
        console.emit(result)
        return
    player.show(result)


def _fit_session(
    path: Path,
    model: str | None,
    handles: list[Path] | None,
    output: Path,
    bare: bool,
    as_json: bool,
) -> None:
    """Write the pose that a session shows."""
    import deformer
    from deformer_app.cli import fit as fitting, outputs
    from deformer_app.viewer import pose_worker as posing
    from deformer_app.viewer.session import Session

    if handles:
        raise deformer.InputError(f"fit: got both {handles[0]} and --session; give one of them")
    outputs.check_output(output, is_sequence=False)
    session = Session.load(path)
    refuse_inputs(output, session.model.path)
    loaded = deformer.load_model(model or session.model.path)
    session.check_fits(loaded, model or session.model.path, path)
    pose = posing.replay(session, loaded)
    outputs.save(output, loaded, pose.vertices, bare)
    result = fitting.describe(pose)
    if as_json:
        console.emit({**result, "output": str(output)})
    else:
        console.show_facts(str(output), {k: v for k, v in result.items() if k != "z"})


def _describe(model: DeformationModel) -> dict[str, Any]:
    reference, document = model.reference, model.document
    return {
        "vertices": len(reference.vertices),
        "faces": len(reference.faces),
        "components": model.components,
        "names": {str(k): name for k, name in model.component_names.items()},
        "bounding_diagonal": reference.bounding_diagonal,
        "document": document and f"{document.name}{document.suffix}",
        "split": {part: len(indices) for part, indices in (model.split or {}).items()},
        "config": model.config.as_dict(),
        "summary": console.plain(model.summary),
    }
