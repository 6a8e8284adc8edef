"""`deformer evaluate`: studies from the arguments, a resumable run, and its report."""

from __future__ import annotations

import os
import platform
import shlex
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import deformer
from deformer import evaluation, io
from deformer.evaluation import (
    QUICK,
    Reading,
    Setting,
    Source,
    Split,
    Study,
    paper_sources,
    paper_studies,
)
from deformer_app.report import report

_PACKAGES = ("deformer", "numpy", "scipy", "torch", "numba", "libigl", "potpourri3d", "pyvista")
# Entries of a run's directory; one of them exists soon after the run has started.
_RUN_ENTRIES = ("journal.jsonl", "models", "examples")
# Files that a run replaces, and how they begin.
_WRITTEN = {
    "journal.jsonl": rb'\{"key": "|$',
    "results.json": rb'\[\s*(\{\s*"dataset": |\])',
    "results.csv": b"dataset,method,protocol,",
    "run.json": rb'\{\s*"command": "',
    "report.html": rb'.*<meta name="generator" content="deformer">',
}


# Options of how shapes are read, which the paper's preset has itself.
_READ = ("sequence", "align", "up", "layout", "reference", "fps", "clip")


@dataclass(frozen=True)
class Options:
    """Options of the command line; None leaves the default, or the preset's value."""

    methods: tuple[str, ...] | None = None
    protocols: tuple[str, ...] | None = None
    components: tuple[int, ...] | None = None
    counts: tuple[int, ...] | None = None
    splits: int | None = None
    seeds: int | None = None
    split_files: tuple[Path, ...] = ()
    sequence: bool = False
    align: bool = False
    up: str | None = None
    epochs: int | None = None
    tests: int | None = None
    layout: Path | None = None
    reference: str | None = None
    fps: float | None = None
    clip: str | None = None

    def given(self) -> dict[str, Any]:
        """Options of `Study` that the user has set."""
        names = ("methods", "protocols", "components", "counts", "splits", "seeds")
        values = {name: getattr(self, name) for name in (*names, "epochs", "tests")}
        return {name: value for name, value in values.items() if value is not None}


def run(
    paths: list[str],
    output: Path,
    options: Options,
    preset: str | None,
    processes: int,
    progress: Callable[[int, int, str], None],
    cluster: str | None = None,
) -> dict[str, Any]:
    """Measure, and write results.json, results.csv, run.json and report.html to `output`.

    Args:
        paths: sets of shapes, or a model and its shapes.
        output: directory of the run.
        options: options of the command line.
        preset: "quick", "paper" or None.
        processes: number of trainings at a time.
        progress: called with finished measurements, all measurements, and the current label.
        cluster: address of a Dask scheduler, or "local:N"; None is no cluster.

    Returns:
        Paths of directory and report, numbers of rows and failures, and the seconds taken.

    Raises:
        InputError: a path or an option that cannot be used.
    """
    _check_output(output)
    begun = time.time()
    studies = _paper(paths, options) if preset == "paper" else _studies(paths, options, preset)
    output.mkdir(parents=True, exist_ok=True)
    with io.locked(output):
        rows = evaluation.evaluate(studies, output, processes, progress, cluster=cluster)
        seconds = time.time() - begun
        facts = {
            "command": shlex.join(["deformer", *sys.argv[1:]]),
            "versions": {"python": platform.python_version()}
            | {name: metadata.version(name) for name in _PACKAGES},
            "machine": {
                "system": platform.platform(),
                "processor": _processor(),
                "cores": os.cpu_count(),
            },
            "processes": processes,
            "cluster": cluster,
            "seconds": round(seconds, 1),
            "seeds": sorted({row["seed"] for row in rows}),
            "preset": preset,
            "studies": [_facts(study) for study in studies],
        }
        io.write_json(output / "run.json", facts)
        sources = list({study.source.name: study.source for study in studies}.values())
        report.write(output, rows, facts, {source.name: source.up for source in sources})
    return {
        "output": str(output),
        "report": str(output / "report.html"),
        "rows": len(rows),
        "failures": sum(row["metric"] == evaluation.FAILURE for row in rows),
        "seconds": round(seconds, 1),
    }


def _studies(paths: list[str], options: Options, preset: str | None) -> list[Study]:
    """A study of each set of shapes, or one study of a model on its shapes."""
    models = [path for path in paths if _is_model(path)]
    shapes = [path for path in paths if path not in models]
    if not shapes or (models and (len(models), len(shapes)) != (1, 1)):
        raise deformer.InputError(
            f"got {len(models)} models and {len(shapes)} sets of shapes, expected sets of shapes, "
            "or one model and the shapes that it was trained from"
        )
    named: dict[str, str] = {}
    for path in shapes:
        name = Path(path).resolve().stem
        if name in named:
            raise deformer.InputError(
                f"{path}: {named[name]} is called {name!r}, too; rename one of them"
            )
        named[name] = path
    sources = [
        Source.at(
            name,
            str(Path(path).resolve()),
            ordered=options.sequence,
            align=options.align,
            up=options.up or "y",
            reading=Reading(options.fps, options.clip, options.reference),
        )
        for name, path in named.items()
    ]
    chosen = QUICK if preset == "quick" else {}
    chosen = chosen | options.given()
    if options.layout is not None:
        if len(sources) > 1:
            raise deformer.InputError(
                f"{options.layout}: a layout is of one mesh, got {len(sources)} sets of shapes; "
                "give one"
            )
        chosen["layout"] = _layout(options.layout, sources[0])
        named_protocols = chosen.get("protocols", ()) if options.protocols else ()
        chosen["protocols"] = tuple(dict.fromkeys((*named_protocols, "layout")))
    if options.components is not None:
        # K of all protocols but the curve over K: the paper's 50 if it is given, else the largest.
        chosen["at"] = 50 if 50 in options.components else max(options.components)
    if models:
        return [_model_study(models[0], sources[0], options, chosen)]
    chosen.setdefault("methods", evaluation.known_methods())
    return [Study(source, **(chosen | _split_files(options, source.count))) for source in sources]


def _layout(path: Path, source: Source) -> tuple[int, ...]:
    """The vertices of a handles file of one pose."""
    file = io.load_handles(path, source.file_vertices)
    if file.is_sequence:
        raise deformer.InputError(
            f"{path}: has frames, expected the handles of one pose; give the file of "
            "`deformer layout`"
        )
    vertices = [handle.vertex for handle in file.frames[0]]
    for n, vertex in enumerate(vertices):
        if not isinstance(vertex, int):
            raise deformer.InputError(
                f"{path}: handles[{n}]: expected a vertex without offset, got a point beside the "
                "mesh's vertices; give the index of a vertex"
            )
    return source.closed_vertices([vertex for vertex in vertices if isinstance(vertex, int)])


def _split_files(options: Options, count: int) -> dict[str, Any]:
    if not options.split_files:
        return {}
    if options.splits is not None:
        raise deformer.InputError("--splits draws splits, --split gives them; leave one out")
    files = [io.load_split(path, count) for path in options.split_files]
    return {"splits": tuple(Split(tuple(f["train"]), tuple(f["test"])) for f in files)}


def _model_study(path: str, source: Source, options: Options, chosen: dict[str, Any]) -> Study:
    model = deformer.load_model(path)
    files = _split_files(options, source.count)
    split = Split(tuple(model.split["train"]), tuple(model.split["test"])) if not files else None
    for given in files.get("splits", ()):
        seen = sorted(set(given.test) & set(model.split["train"]))
        if seen:
            raise deformer.InputError(
                f"{path}: was trained on shape {seen[0]}, which the split tests on; leave out "
                "--split to take the model's own"
            )
    if split and max(split.train + split.test) >= source.count:
        raise deformer.InputError(
            f"{source.path}: has {source.count} shapes, the model's split goes to "
            f"{max(split.train + split.test)}; give the shapes that it was trained from"
        )
    for name in ("splits", "components"):
        if name in options.given():
            raise deformer.InputError(f"--{name} does not go with a model, which has its own")
    others = chosen.pop("methods", ())
    fixed = {
        "methods": ("model", *(name for name in others if name != "model")),
        "splits": (split,) if split else files["splits"],
        "components": (model.components,),
        "at": model.components,
        "model": Setting.of_model(path),
    }
    if model.config.align:
        source = replace(source, align=True)
    return Study(source, **(chosen | fixed))


def _paper(paths: list[str], options: Options) -> list[Study]:
    given = set(options.given()) - {"methods", "epochs", "tests"}
    flags = [name for name in _READ if getattr(options, name) not in (None, False)]
    if options.split_files:
        flags.append("split")
    if given or flags:
        name = sorted([*given, *flags])[0]
        raise deformer.InputError(f"--{name} does not go with --preset paper, which has its own")
    if len(paths) != 1 or not Path(paths[0]).is_dir():
        raise deformer.InputError(
            f"--preset paper: got {' '.join(paths)!r}, expected one folder with the data sets"
        )
    sources = paper_sources(Path(paths[0]).resolve())
    return paper_studies(sources, options.methods, options.epochs, options.tests)


def _is_model(path: str) -> bool:
    folder = Path(path)
    if (folder / "model.json").is_file():
        return True
    return not folder.exists() and path in deformer.shipped_models()


def _check_output(output: Path) -> None:
    if output.exists() and not output.is_dir():
        raise deformer.InputError(f"{output}: is a file, expected a directory; choose another")
    entries = {entry.name for entry in output.iterdir()} if output.is_dir() else set()
    if entries and not entries & set(_RUN_ENTRIES):
        raise deformer.InputError(
            f"{output}: holds something other than an evaluation; choose another directory"
        )
    for name, beginning in _WRITTEN.items():
        if name in entries and not io.begins_with(output / name, beginning):
            raise deformer.InputError(
                f"{output}: already holds {name!r}, which no evaluation has written; choose "
                "another directory or move that file away"
            )


def _facts(study: Study) -> dict[str, Any]:
    """A study as JSON values."""
    return {
        "dataset": study.source.name,
        "path": study.source.path,
        "shapes": study.source.count,
        "ordered": study.source.ordered,
        "align": study.source.align,
        "reference": study.source.reference,
        "methods": study.methods,
        "protocols": study.protocols,
        "components": study.components,
        "at": study.at,
        "counts": study.counts,
        "splits": [
            {"train": list(split.train), "test": list(split.test)} for split in study.drawn_splits()
        ],
        "seeds": study.seeds,
        "epochs": study.epochs,
        "tests": study.tests,
        "layout": study.layout,
    }


def _processor() -> str:
    """Name of the processor, as far as the system reports one."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
