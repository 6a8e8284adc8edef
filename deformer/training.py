"""Training by gradients: Adam, checkpoints, interruption and exact resuming."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from deformer import losses
from deformer.autoencoder import MeshAutoencoder, ModelConfig
from deformer.checkpoints import load_checkpoint, save_checkpoint
from deformer.errors import InputError
from deformer.geodesics import Geodesics
from deformer.interrupts import DeferredInterrupt
from deformer.mesh import FloatArray, IntArray

CHECKPOINT_SECONDS = 30.0
# Copying the weights costs as much as a third of a step on small sets.
_BEST_EVERY = 10
# Mixed shapes that the principal components are taken from, beside the examples.
_INITIAL_MIXED = 128
_WARM_UP = 30


@dataclass(frozen=True)
class TrainingProgress:
    """What a progress callback is told.

    `stage` is "features" (done of total shapes) or "training" (done of total epochs); the loss
    terms are weighted as they enter the loss, and zero in the first stage.
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
    """The trained network and how it came about."""

    network: MeshAutoencoder
    loss: float
    reconstruction: float
    epochs: int
    seconds: float
    interrupted: bool


def resolve_device(device: str) -> torch.device:
    """The torch device of "cpu", "cuda", "mps" or "auto" (the first of cuda, mps, cpu present)."""
    available = {
        "cuda": torch.cuda.is_available(),
        "mps": torch.backends.mps.is_available(),
        "cpu": True,
    }
    if device == "auto":
        return torch.device(next(name for name, there in available.items() if there))
    if device.split(":")[0] not in available:
        raise InputError(f"device: expected cpu, cuda, mps or auto, got {device!r}")
    if not available[device.split(":")[0]]:
        raise InputError(f"device {device!r} is not available here; use cpu or auto")
    return torch.device(device)


class _Mixer:
    """New training shapes from pairs of examples: one inside a region, the other outside.

    The region is a geodesic disc about a random vertex with a soft rim; features blend linearly.
    """

    def __init__(self, x: Tensor, geodesics: Geodesics, generator: torch.Generator) -> None:
        self._x = x
        V = x.shape[0]
        # A few hundred fixed centres bound the geodesic rows that are ever needed.
        vertices = torch.randperm(V, generator=generator)[:200]
        rows = np.array([geodesics.normalised_row(int(i)) for i in vertices])
        rows[~np.isfinite(rows)] = 2.0
        self._rows = torch.as_tensor(rows, dtype=x.dtype, device=x.device)
        self._generator = generator

    def __call__(self, count: int) -> Tensor:
        """Mixed shapes (V, count, 9)."""
        N = self._x.shape[1]
        first = torch.randint(N, (count,), generator=self._generator)
        second = torch.randint(N, (count,), generator=self._generator)
        centre = torch.randint(len(self._rows), (count,), generator=self._generator)
        radius = 0.1 + 0.4 * torch.rand(count, generator=self._generator)
        device = self._x.device
        distance = self._rows[centre.to(device)].T
        weight = torch.sigmoid((distance - radius.to(device)) / 0.05)[:, :, None]
        a, b = self._x[:, first.to(device)], self._x[:, second.to(device)]
        return torch.lerp(a, b, weight)


class _Run:
    """Everything that a checkpoint has to hold."""

    def __init__(
        self,
        network: MeshAutoencoder,
        optimiser: torch.optim.Adam,
        mixer: _Mixer | None,
        generator: torch.Generator,
        stochastic: bool,
        identity: dict[str, Any],
    ) -> None:
        self.network, self.optimiser, self.mixer = network, optimiser, mixer
        self.generator = generator
        self.stochastic = stochastic
        self.identity = identity
        self.mean: Tensor | None = None
        self.epoch = 0
        self.seconds = 0.0
        self.loss = float("inf")
        self.reconstruction = float("inf")
        self.best = {k: v.detach().clone() for k, v in network.state_dict().items()}

    def keep_if_best(self, loss: float, reconstruction: float) -> None:
        if loss < self.loss:
            self.loss, self.reconstruction = loss, reconstruction
            for name, value in self.network.state_dict().items():
                self.best[name].copy_(value)

    def save(self, folder: Path) -> None:
        tensors: dict[str, Tensor] = {}
        for name, value in self.network.state_dict().items():
            tensors[f"network.{name}"] = value
            tensors[f"best.{name}"] = self.best[name]
        for index, state in self.optimiser.state_dict()["state"].items():
            for name, value in state.items():
                tensors[f"adam.{index}.{name}"] = value
        tensors["generator"] = self.generator.get_state()
        status = {
            "epoch": self.epoch,
            "seconds": self.seconds,
            "loss": self.loss,
            "reconstruction": self.reconstruction,
        }
        save_checkpoint(folder, self.identity, status, tensors)

    def load(self, folder: Path | None) -> None:
        status, tensors = load_checkpoint(folder, self.identity)
        state: dict[int, dict[str, Tensor]] = {}
        for name, value in tensors.items():
            if name.startswith("adam."):
                _, index, key = name.split(".")
                state.setdefault(int(index), {})[key] = value
        self.network.load_state_dict(_with_prefix(tensors, "network."))
        for name, value in _with_prefix(tensors, "best.").items():
            self.best[name].copy_(value)
        groups = self.optimiser.state_dict()["param_groups"]
        self.optimiser.load_state_dict({"state": state, "param_groups": groups})
        self.generator.set_state(tensors["generator"])
        self.epoch, self.seconds = status["epoch"], status["seconds"]
        self.loss = status["loss"]
        self.reconstruction = status["reconstruction"]


def _with_prefix(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}


def identity_of(x: FloatArray, config: ModelConfig, seed: int) -> dict[str, Any]:
    """What decides a run on scaled features (N, V, 9); a checkpoint is good for no other."""
    shapes = [*x.shape, float(np.abs(x).sum()), float(x.std())]
    return {"config": config.as_dict(), "seed": seed, "shapes": shapes}


def fit(
    x: FloatArray,
    indptr: IntArray,
    rings: IntArray,
    geodesics: Geodesics,
    config: ModelConfig,
    *,
    seed: int = 0,
    device: str = "auto",
    checkpoint: Path | None = None,
    resume: bool = False,
    on_progress: ProgressCallback | None = None,
) -> TrainingResult:
    """Train a network on scaled features.

    Args:
        x: (N, V, 9) scaled features of the training shapes.
        indptr, rings: one-rings of the reference.
        geodesics: distances over the reference, for Λ and the mixed shapes.
        config: network, loss weights, epochs.
        seed: of the initial weights and the mixed shapes. The same seed gives the same network
            on one machine with one number of threads.
        device: "cpu", "cuda", "mps" or "auto".
        checkpoint: folder written every half minute and on interruption, or None.
        resume: continue from `checkpoint`; every number comes out as without the stop.
        on_progress: called after every epoch.

    Returns:
        The network (on the CPU): with the lowest loss seen where every step sees all shapes, else
        the newest. Ctrl-C ends the training early, after the step under way; the checkpoint is
        saved and the network so far returned.
    """
    target = resolve_device(device)
    torch.manual_seed(seed)
    network = MeshAutoencoder(indptr, rings, config.components, config.layers).to(target)
    optimiser = torch.optim.Adam(network.parameters(), lr=config.learning_rate, fused=True)
    shapes = torch.as_tensor(np.swapaxes(x, 0, 1), dtype=torch.float32).contiguous().to(target)
    identity = identity_of(x, config, seed)
    generator = torch.Generator().manual_seed(seed)
    mixer = _Mixer(shapes, geodesics, generator) if config.mixed_shapes and len(x) > 1 else None
    if config.initial == "pca" and not resume:
        network.start_from_components(_with_mixed(shapes, mixer, _INITIAL_MIXED))
    stochastic = mixer is not None or 0 < config.batch < len(x)
    run = _Run(network, optimiser, mixer, generator, stochastic, identity)
    if not stochastic:  # every step sees the same shapes: their ring mean is taken once
        with torch.no_grad():
            run.mean = network.mean(shapes)
    if resume:
        run.load(checkpoint)
    locality = losses.Locality(geodesics, config.d_min, config.d_max)
    saved = begun = time.monotonic()
    spent_before = run.seconds
    interrupted = False
    try:
        with DeferredInterrupt() as interrupt:
            while run.epoch < config.epochs and not interrupt.asked:
                terms = _step(run, shapes, config, locality)
                run.epoch += 1
                run.seconds = spent_before + time.monotonic() - begun
                if on_progress is not None:
                    loss = sum(terms)
                    on_progress(
                        TrainingProgress("training", run.epoch, config.epochs, loss, *terms)
                    )
                if checkpoint is not None and time.monotonic() - saved > CHECKPOINT_SECONDS:
                    run.save(checkpoint)
                    saved = time.monotonic()
        interrupted = interrupt.asked
    except KeyboardInterrupt:  # from the callback: between two steps, too
        interrupted = True
    if interrupted and checkpoint is not None:
        run.save(checkpoint)
    if not run.stochastic:
        network.load_state_dict(run.best)
    return TrainingResult(
        network.cpu().eval(),
        run.loss,
        run.reconstruction,
        run.epoch,
        run.seconds,
        interrupted,
    )


def _step(
    run: _Run, shapes: Tensor, config: ModelConfig, locality: losses.Locality
) -> tuple[float, float, float]:
    """One step on all shapes; returns the three weighted terms before the step."""
    network, N = run.network, shapes.shape[1]
    batch = shapes
    if 0 < config.batch < N:
        drawn = torch.randperm(N, generator=run.generator)[: config.batch]
        batch = shapes[:, drawn.to(shapes.device)]
    batch = _with_mixed(batch, run.mixer, config.mixed_shapes)
    for group in run.optimiser.param_groups:
        group["lr"] = _learning_rate(config, run.epoch)
    run.optimiser.zero_grad(set_to_none=True)
    estimate, z = network(batch, run.mean)
    error = losses.reconstruction(batch, estimate)
    sparse = config.sparsity * losses.sparsity(network.C, locality.update(network.C))
    spread = config.range_weight * losses.latent_range(z, config.range_limit)
    loss = error + sparse + spread
    loss.backward()
    terms = error.item(), sparse.item(), spread.item()
    if run.stochastic:
        # The loss of one batch does not tell which weights are best; the newest are kept.
        run.loss, run.reconstruction = sum(terms), terms[0]
    elif run.epoch % _BEST_EVERY == 0 or run.epoch == config.epochs - 1:
        run.keep_if_best(sum(terms), terms[0])
    run.optimiser.step()
    return terms


def _with_mixed(x: Tensor, mixer: _Mixer | None, count: int) -> Tensor:
    return x if mixer is None else torch.cat([x, mixer(count)], dim=1)


def _learning_rate(config: ModelConfig, epoch: int) -> float:
    if config.schedule == "constant":
        return config.learning_rate
    fall = 0.5 * (1.0 + math.cos(math.pi * epoch / config.epochs))
    return config.learning_rate * (0.01 + 0.99 * fall) * min(1.0, (epoch + 1) / _WARM_UP)
