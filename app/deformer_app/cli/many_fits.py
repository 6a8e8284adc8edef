"""`deformer fit` of several handles files: a result for each, here or on a cluster."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import deformer
from deformer import io
from deformer.parallel import Done, Failed, executor_of
from deformer_app import console
from deformer_app.cli import fit as fitting, outputs
from deformer_app.cli.arguments import refuse_inputs

if TYPE_CHECKING:
    from deformer import DeformationModel

# Of files: nobody names a directory so.
_SUFFIXES = (*deformer.SEQUENCE_SUFFIXES, *io.MESH_SUFFIXES)


@dataclass(frozen=True)
class _Take:
    """A handles file, its contents, where its result goes, and the positions' deviation."""

    path: Path
    handles: io.HandleFile
    output: Path
    noise: float | None


def run(
    model: str,
    paths: list[Path],
    output: Path,
    suffix: str,
    options: fitting.Options,
    bare: bool,
    timing: outputs.Timing,
    cluster: str | None,
    progress: Callable[[int, int], None],
) -> dict[str, Any]:
    """Fit the model to each file, and write each result as soon as there is one.

    Args:
        model: directory or name of the model.
        paths: handles files, of poses or of sequences.
        output: directory of the results, which have the files' names.
        suffix: format of the results, with or without a dot.
        options: of all fits.
        bare: write positions and triangles alone.
        timing: of sequences.
        cluster: address of a Dask scheduler, or "local:N"; None is this process.
        progress: called with the frames that are fitted, and all frames.

    Returns:
        The directory, and the record of each fit with its handles file, output and warning.

    Raises:
        InputError: before any work, a file that cannot be used; after it, a fit that failed.
        Interrupted: Ctrl-C.
    """
    if output.is_file() or output.suffix.lower() in _SUFFIXES:
        raise deformer.InputError(
            f"{output}: names one file, but results of several handles files, or of a cluster, go "
            "into a directory; name a directory"
        )
    loaded = deformer.load_model(model)
    takes = _takes(loaded, model, paths, output, suffix, options)
    output.mkdir(parents=True, exist_ok=True)
    fits: dict[int, dict[str, Any]] = {}
    failures: list[str] = []
    frames = [len(take.handles.frames) for take in takes]
    try:
        with io.locked(output), executor_of(cluster=cluster) as executor:
            # Nothing of its file is needed to fit it.
            shared = executor.share(replace(loaded, document=None))
            numbers = {
                executor.submit(fitting.fit_task, shared, take.handles, take.noise, options): n
                for n, take in enumerate(takes)
            }
            done = 0
            for event in executor.as_completed():
                n = numbers[event.task]
                if isinstance(event, Failed):
                    if not isinstance(event.error, deformer.InputError):
                        raise event.error
                    failures.append(f"{takes[n].path}: {event.error}")
                elif isinstance(event, Done):
                    vertices, record = event.result
                    fits[n] = _saved(takes[n], loaded, vertices, record, bare, timing)
                else:
                    continue
                done += frames[n]
                progress(done, sum(frames))
    except KeyboardInterrupt:
        console.note(f"Interrupted: {len(fits)} of {len(takes)} results are in {output}.")
        raise console.Interrupted from None
    if failures:
        others = f" and {len(failures) - 1} other fits failed" if failures[1:] else ""
        raise deformer.InputError(
            f"{failures[0]}{others}; {len(fits)} of {len(takes)} results are in {output}"
        )
    return {"output": str(output), "fits": [fits[n] for n in range(len(takes))]}


def show(result: dict[str, Any]) -> None:
    """Print a table of the fits, and their warnings."""
    rows = [
        [
            Path(fit["handles"]).name,
            Path(fit["output"]).name,
            *(console.brief(fit[name]) for name in ("residual_rms", "max_residual")),
        ]
        for fit in result["fits"]
    ]
    columns = ["handles", "result", "residual rms", "max residual"]
    console.show_table(result["output"], columns, rows)
    for fit in result["fits"]:
        if fit["warning"]:
            console.note(f"{fit['handles']}: {fit['warning']}")


def _takes(
    model: DeformationModel,
    name: str,
    paths: list[Path],
    output: Path,
    suffix: str,
    options: fitting.Options,
) -> list[_Take]:
    """All files, read and checked before any is fitted."""
    named: dict[str, Path] = {}
    takes = []
    for path in paths:
        key = io.folded_name(path.stem)
        if key in named:
            raise deformer.InputError(
                f"{path}: its result would have the name of that of {named[key]} (some systems "
                "ignore case); rename one"
            )
        named[key] = path
        handles = fitting.handles_of(model, path)
        result = output / f"{path.stem}.{suffix.removeprefix('.')}"
        allowed = deformer.SEQUENCE_SUFFIXES if handles.is_sequence else io.MESH_SUFFIXES
        if result.suffix.lower() not in allowed:
            what = "sequence" if handles.is_sequence else "pose"
            raise deformer.InputError(
                f"--format: got {suffix!r}, expected one of {', '.join(allowed)} for the {what} of "
                f"{path}"
            )
        refuse_inputs(result, name, *paths)
        if output.is_dir():
            outputs.check_output(result, handles.is_sequence)
        takes.append(_Take(path, handles, result, fitting.chosen_noise(options.noise, handles)))
    return takes


def _saved(
    take: _Take,
    model: DeformationModel,
    vertices: Any,
    record: dict[str, Any],
    bare: bool,
    timing: outputs.Timing,
) -> dict[str, Any]:
    record |= outputs.save(take.output, model, vertices, bare, timing)
    warning = fitting.axis_warning(model, take.handles) or fitting.unit_warning(model, take.handles)
    return {
        "handles": str(take.path),
        "output": str(take.output),
        "warning": warning,
        **record,
    }
