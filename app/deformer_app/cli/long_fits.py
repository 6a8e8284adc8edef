"""`deformer fit` of one sequence: within a limit of memory, and gone on with after a kill."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import deformer
from deformer import io
from deformer_app import console
from deformer_app.cli import fit as fitting, outputs

if TYPE_CHECKING:
    from deformer import DeformationModel

# Sequences of fewer frames are fitted anew: that takes seconds.
_KEPT_FROM = 1000


def run(
    model: DeformationModel,
    handles: io.HandleFile,
    output: Path,
    options: fitting.Options,
    workspace: deformer.Workspace,
    bare: bool,
    timing: outputs.Timing,
    frames: bool,
) -> dict[str, Any]:
    """Fit a sequence and write it.

    Args:
        model, handles, options: as of `fit.stored_sequence`.
        output: the file or directory.
        workspace: where arrays are.
        bare, timing: as of `outputs.save`.
        frames: true for a record with `frames`.

    Returns:
        The fit's record, and what was written.

    Raises:
        InputError: before any work, more frames than the format can hold.
        Interrupted: Ctrl-C, with windows kept.
    """
    F = len(handles.frames)
    deformer.check_shapes_size(output, F, len(model.reference.vertices))
    kept = output.with_name(f"{output.name}.windows") if F >= _KEPT_FROM else None
    with io.locked(output):
        try:
            with console.progress("fitting") as report:
                shapes, result = fitting.stored_sequence(
                    model,
                    handles,
                    options,
                    workspace=workspace,
                    checkpoint=kept,
                    frames=frames,
                    progress=report,
                )
            result |= outputs.save_sequence(output, model, shapes, bare, timing)
        except KeyboardInterrupt:
            if kept is None or not kept.is_dir():
                raise
            console.note(f"Interrupted: the same command goes on from {kept}.")
            raise console.Interrupted from None
        if kept is not None:
            deformer.remove_windows(kept)
    return result
