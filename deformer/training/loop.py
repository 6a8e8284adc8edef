"""The loop around every training: progress, checkpoints, interruption and exact resuming."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from deformer.geometry import FloatArray
from deformer.network import ModelConfig, NetworkWeights
from deformer.training.checkpoints import load_checkpoint, save_checkpoint
from deformer.training.interrupts import DeferredInterrupt

_CHECKPOINT_SECONDS = 30.0

# What a checkpoint holds: JSON values, and arrays.
State = tuple[dict[str, Any], dict[str, NDArray]]


@dataclass(frozen=True)
class TrainingProgress:
    """What a progress callback is told.

    `stage` is "features" (done of total shapes), "training" (done of total epochs) or
    "cross-validation" (done of total epochs and handle fits of trials); the loss terms are weighted
    as they enter the loss, and zero outside of training.
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
    """The weights of the trained network and how it came about."""

    weights: NetworkWeights
    loss: float
    reconstruction: float
    epochs: int
    seconds: float
    interrupted: bool


class Trainee(Protocol):
    """What is trained, one step at a time; `start` or `restore` comes first."""

    def start(self) -> None:
        """Begin anew."""
        ...

    def step(self, epoch: int) -> tuple[float, ...]:
        """Take step `epoch`, from 0; give the terms of the loss in `TrainingProgress`'s order."""
        ...

    def state(self) -> State:
        """All that later steps depend on."""
        ...

    def restore(self, status: dict[str, Any], arrays: dict[str, NDArray]) -> None:
        """Go on from a `state`."""
        ...


class Course(NamedTuple):
    """How far a training came: steps and seconds with those before a stop, whether cut short."""

    epochs: int
    seconds: float
    interrupted: bool


def identity_of(x: FloatArray, config: ModelConfig, seed: int) -> dict[str, Any]:
    """What decides a run on scaled features (N, V, 9); a checkpoint is good for no other."""
    shapes = [*x.shape, float(np.abs(x).sum()), float(x.std())]
    return {"config": config.as_dict(), "seed": seed, "shapes": shapes}


def run_training(
    trainee: Trainee,
    epochs: int,
    identity: dict[str, Any],
    *,
    checkpoint: Path | None = None,
    resume: bool = False,
    on_progress: ProgressCallback | None = None,
) -> Course:
    """Take a training's steps up to `epochs`.

    Ctrl-C, and a KeyboardInterrupt that `on_progress` raises, end it early, after the step under
    way, with the checkpoint saved.

    Args:
        trainee: what takes the steps.
        epochs: steps of the whole training.
        identity: of `identity_of`.
        checkpoint: folder written every half minute and on interruption, or None.
        resume: continue from `checkpoint`; every number comes out as without the stop.
        on_progress: called after every step.

    Raises:
        InputError: there is nothing to resume, or it is of another identity.
    """
    epoch, seconds = 0, 0.0
    if resume:
        status, arrays = load_checkpoint(checkpoint, identity)
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
            save_checkpoint(checkpoint, identity, status, arrays)

    try:
        with DeferredInterrupt() as interrupt:
            while epoch < epochs and not interrupt.asked:
                terms = trainee.step(epoch)
                epoch += 1
                seconds = time.monotonic() - begun
                if on_progress is not None:
                    on_progress(TrainingProgress("training", epoch, epochs, sum(terms), *terms))
                if time.monotonic() - saved > _CHECKPOINT_SECONDS:
                    save()
                    saved = time.monotonic()
        interrupted = interrupt.asked
    except KeyboardInterrupt:  # from the callback: between two steps, too
        interrupted = True
    if interrupted:
        save()
    return Course(epoch, seconds, interrupted)
