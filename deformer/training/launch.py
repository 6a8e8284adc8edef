"""How this process was started: alone, or as one of several by `torchrun`."""

from __future__ import annotations

import os

from deformer.errors import InputError


def launched() -> tuple[int, int]:
    """Rank of this process, from 0, and the number of processes; (0, 1) without `torchrun`."""
    if "TORCHELASTIC_RUN_ID" not in os.environ:
        return 0, 1
    return int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1))


def check_alone(what: str) -> None:
    """Raise InputError if there are several processes, which `what` has no use for."""
    _, count = launched()
    if count > 1:
        raise InputError(
            f"train: torchrun started {count} processes, and {what}; start one, without torchrun, "
            "or take --config paper"
        )


def assist_training() -> bool:
    """Take part in the training of another process, if `torchrun` started this one for that.

    `torchrun` starts a program several times. Before it reads anything, it calls this function: in
    the first process it does nothing, and `train` then shares its steps with the others, which are
    in this function meanwhile.

    Returns:
        True if this was an assistant, whose work is done; False in the first or only process.
    """
    rank, _ = launched()
    if rank == 0:
        return False
    from deformer.training.adam import assist  # the import of torch takes seconds

    assist()
    return True
