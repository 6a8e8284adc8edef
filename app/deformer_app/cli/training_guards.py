"""What guards `deformer train`: its shapes and outputs, and what is kept where it is cut short."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import deformer
from deformer import InputError, MeshSequence, StoredShapes, io
from deformer_app import console
from deformer_app.mistakes import system_mistake


def refuse_unusable(path: Path, shapes: MeshSequence | StoredShapes) -> list[str]:
    """Print warnings of `examine`; raise InputError if it finds an error.

    Returns:
        Advice for the end: that shapes are few.
    """
    from deformer_app.cli.check import shape_names

    report = deformer.examine(shapes, shape_names(path, shapes))
    errors = [finding.message for finding in report.findings if finding.severity == "error"]
    for finding in report.findings:
        if finding.severity == "warning":
            console.warn(finding.message)
    if not report.usable:
        reason = errors[0] if errors else "unusable"
        raise InputError(
            f"{path}: {reason} (all findings: deformer check {shlex.quote(str(path))})"
        )
    return [finding.message for finding in report.findings if finding.kind == "few"]


@contextmanager
def outputs(output: Path, resume: dict[str, Any] | None) -> Iterator[Path]:
    """Keep other processes from the model's directory while it is trained; check it first.

    Args:
        output: the model's directory.
        resume: options of the training that goes on from the checkpoint; None starts anew.

    Yields:
        The directory of the checkpoints.
    """
    if output.name in ("", ".."):  # as of "."
        output = output.resolve()
    checkpoint = output.parent / f"{output.name}.checkpoint"
    if resume is not None:
        _refuse_finished(output, checkpoint)
        deformer.check_resumable(checkpoint, **resume)
    output.parent.mkdir(parents=True, exist_ok=True)
    deformer.check_model_folder(output)
    with io.locked(output):
        if resume is None:
            deformer.check_checkpoint(checkpoint)
            if deformer.has_checkpoint(checkpoint):
                console.warn(f"replacing the checkpoint {checkpoint}; --resume would go on from it")
        yield checkpoint


def _refuse_finished(output: Path, checkpoint: Path) -> None:
    """Raise InputError if the training to resume has ended: its model is there, no checkpoint."""
    if deformer.has_checkpoint(checkpoint) or not output.is_dir():
        return
    try:
        deformer.load_model(output)
    except InputError:  # no model: the checkpoint is what is missing
        return
    raise InputError(
        f"{output}: the training of this model has ended, so there is nothing to resume; start "
        "without --resume to train anew"
    )


@contextmanager
def kept_if_cut_short(checkpoint: Path) -> Iterator[None]:
    """Say what is kept if Ctrl-C or a failure to write ends the block, and how to go on."""
    try:
        yield
    except KeyboardInterrupt:
        if deformer.has_checkpoint(checkpoint):
            console.note(f"Interrupted: {how_to_go_on(checkpoint)}")
        else:
            console.note("Interrupted: nothing was finished yet.")
        raise console.Interrupted from None
    except OSError as error:
        if not deformer.has_checkpoint(checkpoint):
            raise
        raise InputError(f"{system_mistake(error)}; {how_to_go_on(checkpoint)}") from error


def how_to_go_on(checkpoint: Path) -> str:
    """What is kept of a training that was cut short, and the command that goes on from it."""
    return f"what is finished is kept in {checkpoint}; to go on: {command_to_resume()}"


def command_to_resume() -> str:
    """The command that goes on from the checkpoint of this one."""
    arguments = [*sys.argv[1:], *([] if "--resume" in sys.argv else ["--resume"])]
    return shlex.join(["deformer", *arguments])
