"""The loop of every training: progress, checkpoints, interruption and exact resumption."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from deformer.errors import InputError
from deformer.geometry import FloatArray
from deformer.network import ModelConfig, NetworkWeights
from deformer.training.checkpoints import (
    check_arrays,
    check_state,
    load_checkpoint,
    save_checkpoint,
)
from deformer.training.interrupts import DeferredInterrupt
from deformer.training.site_tiles import SiteTiles

_CHECKPOINT_SECONDS = 30.0

# Contents of a checkpoint: JSON values, and arrays.
State = tuple[dict[str, Any], dict[str, NDArray]]


@dataclass(frozen=True)
class TrainingProgress:
    """Progress of a training.

    Args:
        stage: "features", "training" or "cross-validation".
        done: number of shapes, of epochs, or of epochs and handle fits of all trials, so far.
        total: the same number at the end of the stage.
        loss: sum of the terms; 0 outside of training, as they are.
        reconstruction: the squared error of the shapes; see `losses.Loss`.
        sparsity: the term Ω with its weight.
        range: the term V(Z) with its weight.
    """

    stage: str
    done: int
    total: int
    loss: float = 0.0
    reconstruction: float = 0.0
    sparsity: float = 0.0
    range: float = 0.0


ProgressCallback = Callable[[TrainingProgress], None]


@dataclass(frozen=True)
class TrainingResult:
    """The result of a training.

    Args:
        weights: weights of the trained network.
        loss: its total loss.
        reconstruction: the loss's reconstruction term.
        epochs: number of epochs trained.
        seconds: duration, including that before a resumption.
        interrupted: true if the training ended before the last epoch.
    """

    weights: NetworkWeights
    loss: float
    reconstruction: float
    epochs: int
    seconds: float
    interrupted: bool


class Trainee(Protocol):
    """A training method, one step at a time; `start` or `restore` is called first."""

    def start(self) -> None:
        """Initialise the weights."""
        ...

    def step(self, epoch: int) -> tuple[float, ...]:
        """Take step `epoch`, from 0; returns the terms of the loss, as in `TrainingProgress`."""
        ...

    def state(self) -> State:
        """All that later steps depend on; before `start` its arrays have their final shapes."""
        ...

    def restore(self, status: dict[str, Any], arrays: dict[str, NDArray]) -> None:
        """Continue from a `state`, its JSON values in `status` and its `arrays`."""
        ...


class Outcome(NamedTuple):
    """How a training ended.

    Args:
        epochs: number of steps taken, including those before a resumption.
        seconds: their duration.
        interrupted: true if the training ended before the last step.
    """

    epochs: int
    seconds: float
    interrupted: bool


def identity_of(x: FloatArray | SiteTiles, config: ModelConfig, seed: int) -> dict[str, Any]:
    """Identity of a training run, which a checkpoint must have to be resumed; JSON values.

    Args:
        x: (N, V, 9) scaled features, or tiles of features.
        config: configuration of the training.
        seed: seed of the training.
    """
    if isinstance(x, SiteTiles):
        shapes = [*x.shape, *np.sum([_sums(tile) for _, tile in x.each()], axis=0).tolist()]
    else:
        shapes = [*x.shape, float(np.abs(x).sum()), float(x.std())]
    return {"config": config.as_dict(), "seed": seed, "shapes": shapes}


def _sums(numbers: NDArray) -> tuple[float, float]:
    """Sums of magnitudes and of squares."""
    squares = np.einsum("nm,nm->", numbers, numbers, dtype=np.float64)
    return float(np.abs(numbers).sum(dtype=np.float64)), float(squares)


def run_training(
    trainee: Trainee,
    epochs: int,
    identity: dict[str, Any],
    *,
    checkpoint: Path | None = None,
    resume: bool = False,
    on_progress: ProgressCallback | None = None,
) -> Outcome:
    """Take the steps of a training, up to `epochs`.

    Ctrl-C, and a KeyboardInterrupt that `on_progress` raises, end the training after the current
    step, with the checkpoint saved.

    Args:
        trainee: takes the steps.
        epochs: number of steps of the whole training.
        identity: result of `identity_of`.
        checkpoint: folder written every half minute and at the end, or None.
        resume: continue from `checkpoint`; the result is that of an uninterrupted training.
        on_progress: called after every step.

    Raises:
        InputError: there is no checkpoint to resume, it is of another identity, or the training has
            diverged where it would be saved; a checkpoint from before stays.
    """
    epoch, seconds = 0, 0.0
    if resume:
        if checkpoint is None:
            raise InputError("resume: expected a checkpoint folder, got None; give one")
        status, arrays = load_checkpoint(checkpoint, identity)
        check_arrays(checkpoint / status["arrays"], arrays, trainee.state()[1])
        trainee.restore(status, arrays)
        epoch, seconds = status["epoch"], status["seconds"]
    else:
        trainee.start()
    saved = time.monotonic()
    begun = saved - seconds

    def save() -> None:
        if checkpoint is not None:
            status, arrays = trainee.state()
            status = {"epoch": epoch, "seconds": seconds, **status}
            check_state(arrays, epoch)
            save_checkpoint(checkpoint, identity, status, arrays)

    try:
        with DeferredInterrupt() as interrupt:
            while epoch < epochs and not interrupt.requested:
                terms = trainee.step(epoch)
                epoch += 1
                seconds = time.monotonic() - begun
                if on_progress is not None:
                    on_progress(TrainingProgress("training", epoch, epochs, sum(terms), *terms))
                if time.monotonic() - saved > _CHECKPOINT_SECONDS:
                    save()
                    saved = time.monotonic()
        interrupted = interrupt.requested
    except KeyboardInterrupt:  # raised by the callback, between two steps
        interrupted = True
    # The finished network, too: what follows takes seconds, and can be interrupted.
    with DeferredInterrupt() as interrupt:
        save()
    return Outcome(epoch, seconds, interrupted or interrupt.requested)
