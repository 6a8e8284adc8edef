"""The training loop: full-batch Adam, checkpoints, interruption and exact resuming."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from deformer import losses
from deformer.autoencoder import MeshAutoencoder, ModelConfig
from deformer.errors import InputError
from deformer.geodesics import Geodesics
from deformer.io import atomic_path
from deformer.mesh import FloatArray, IntArray

_CHECKPOINT_SECONDS = 30.0
# Copying the weights costs as much as a third of a step on small sets.
_BEST_EVERY = 10
_CHECKPOINT_FORMAT = 1


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
    """The network with the lowest loss and how it came about."""

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

    def __init__(self, x: Tensor, geodesics: Geodesics, seed: int) -> None:
        self._x = x
        V = x.shape[0]
        # A few hundred fixed centres bound the geodesic rows that are ever needed.
        pick = np.random.default_rng(seed)
        vertices = pick.choice(V, size=min(V, 200), replace=False)
        rows = np.array([geodesics.normalised_row(int(i)) for i in vertices])
        rows[~np.isfinite(rows)] = 2.0
        self._rows = torch.as_tensor(rows, dtype=x.dtype, device=x.device)
        self.generator = torch.Generator().manual_seed(seed)

    def __call__(self, count: int) -> Tensor:
        """Mixed shapes (V, count, 9)."""
        N = self._x.shape[1]
        first = torch.randint(N, (count,), generator=self.generator)
        second = torch.randint(N, (count,), generator=self.generator)
        centre = torch.randint(len(self._rows), (count,), generator=self.generator)
        radius = 0.1 + 0.4 * torch.rand(count, generator=self.generator)
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
        identity: dict[str, Any],
    ) -> None:
        self.network, self.optimiser, self.mixer = network, optimiser, mixer
        self.identity = identity
        self.mean: Tensor | None = None
        self.epoch = 0
        self.seconds = 0.0
        self.best_loss = float("inf")
        self.best_reconstruction = float("inf")
        self.best = {k: v.detach().clone() for k, v in network.state_dict().items()}

    def keep_if_best(self, loss: float, reconstruction: float) -> None:
        if loss < self.best_loss:
            self.best_loss, self.best_reconstruction = loss, reconstruction
            for name, value in self.network.state_dict().items():
                self.best[name].copy_(value)

    def save(self, folder: Path) -> None:
        tensors: dict[str, Tensor] = {}
        for name, value in self.network.state_dict().items():
            tensors[f"network.{name}"] = value.contiguous()
            tensors[f"best.{name}"] = self.best[name].contiguous()
        for index, state in self.optimiser.state_dict()["state"].items():
            for name, value in state.items():
                tensors[f"adam.{index}.{name}"] = value.contiguous()
        if self.mixer is not None:
            tensors["generator"] = self.mixer.generator.get_state()
        status = {
            "format": _CHECKPOINT_FORMAT,
            "identity": self.identity,
            "epoch": self.epoch,
            "seconds": self.seconds,
            "best_loss": self.best_loss,
            "best_reconstruction": self.best_reconstruction,
        }
        folder.mkdir(parents=True, exist_ok=True)
        # Both files carry the epoch in their name; the JSON is renamed last and names its tensors,
        # so that a crash between the two leaves the previous pair valid.
        name = f"epoch-{self.epoch:07d}.safetensors"
        with atomic_path(folder / name) as path:
            save_file({k: v.cpu() for k, v in tensors.items()}, path)
        with atomic_path(folder / "checkpoint.json") as path:
            path.write_text(json.dumps({**status, "tensors": name}, indent=1) + "\n")
        for old in folder.glob("epoch-*.safetensors"):
            if old.name != name:
                old.unlink()

    def load(self, folder: Path) -> None:
        where = folder / "checkpoint.json"
        if not where.is_file():
            raise InputError(f"{where}: no checkpoint to resume; start without --resume")
        try:
            status = json.loads(where.read_text())
            tensors = load_file(folder / status["tensors"])
        except (ValueError, KeyError, OSError) as error:
            raise InputError(f"{where}: not a readable checkpoint ({error}); delete it") from error
        if status["format"] != _CHECKPOINT_FORMAT or status["identity"] != self.identity:
            differing = [
                key
                for key, value in self.identity.items()
                if status.get("identity", {}).get(key) != value
            ]
            raise InputError(
                f"{where}: made with other {', '.join(differing) or 'software'}; "
                "resume with the same shapes and options, or delete it"
            )
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
        if self.mixer is not None:
            self.mixer.generator.set_state(tensors["generator"])
        self.epoch, self.seconds = status["epoch"], status["seconds"]
        self.best_loss = status["best_loss"]
        self.best_reconstruction = status["best_reconstruction"]


def _with_prefix(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}


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
        The network (on the CPU) with the lowest loss seen. KeyboardInterrupt ends the training
        early, saves the checkpoint and returns the best so far.
    """
    target = resolve_device(device)
    torch.manual_seed(seed)
    network = MeshAutoencoder(indptr, rings, config.components, config.layers).to(target)
    optimiser = torch.optim.Adam(network.parameters(), lr=config.learning_rate, fused=True)
    shapes = torch.as_tensor(np.swapaxes(x, 0, 1), dtype=torch.float32).contiguous().to(target)
    mixer = _Mixer(shapes, geodesics, seed) if config.mixed_shapes and len(x) > 1 else None
    identity = {
        "config": config.as_dict(),
        "seed": seed,
        "shapes": [*x.shape, float(np.abs(x).sum()), float(x.std())],
    }
    run = _Run(network, optimiser, mixer, identity)
    with torch.no_grad():
        run.mean = network.mean(shapes)
    if resume:
        if checkpoint is None:
            raise InputError("resume: a checkpoint folder is needed")
        run.load(checkpoint)
    locality = losses.Locality(geodesics, config.d_min, config.d_max)
    interrupted = False
    saved = begun = time.monotonic()
    spent_before = run.seconds
    try:
        while run.epoch < config.epochs:
            terms = _step(run, shapes, config, locality)
            run.epoch += 1
            run.seconds = spent_before + time.monotonic() - begun
            if on_progress is not None:
                loss = sum(terms)
                on_progress(TrainingProgress("training", run.epoch, config.epochs, loss, *terms))
            if checkpoint is not None and time.monotonic() - saved > _CHECKPOINT_SECONDS:
                run.save(checkpoint)
                saved = time.monotonic()
    except KeyboardInterrupt:
        interrupted = True
        if checkpoint is not None:
            run.save(checkpoint)
    network.load_state_dict(run.best)
    return TrainingResult(
        network.cpu().eval(),
        run.best_loss,
        run.best_reconstruction,
        run.epoch,
        run.seconds,
        interrupted,
    )


def _step(
    run: _Run, shapes: Tensor, config: ModelConfig, locality: losses.Locality
) -> tuple[float, float, float]:
    """One step on all shapes; returns the three weighted terms before the step."""
    network = run.network
    batch = shapes
    if run.mixer is not None:
        batch = torch.cat([shapes, run.mixer(config.mixed_shapes)], dim=1)
    run.optimiser.zero_grad(set_to_none=True)
    estimate, z = network(batch, run.mean if run.mixer is None else None)
    error = losses.reconstruction(batch, estimate)
    sparse = config.sparsity * losses.sparsity(network.C, locality.update(network.C))
    spread = config.range_weight * losses.latent_range(z, config.range_limit)
    loss = error + sparse + spread
    loss.backward()
    terms = error.item(), sparse.item(), spread.item()
    if run.epoch % _BEST_EVERY == 0 or run.epoch == config.epochs - 1:
        run.keep_if_best(sum(terms), terms[0])
    run.optimiser.step()
    return terms
