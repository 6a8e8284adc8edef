"""Training by gradients: Adam on the whole network."""

from __future__ import annotations

import atexit
import math
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deformer.errors import InputError
from deformer.geometry import FloatArray, Geodesics, IntArray, SiteGeodesics
from deformer.linalg import resolve_device
from deformer.network import AdamSettings, MeshAutoencoder, ModelConfig, NetworkWeights, losses
from deformer.training.loop import (
    ProgressCallback,
    State,
    TrainingResult,
    identity_of,
    run_training,
)
from deformer.training.ranks import Ranks

# The best weights are updated every so many steps: on small sets a copy costs a third of a step.
_BEST_EVERY = 10
# Number of mixed shapes, beside the examples, for the initial principal components.
_INITIAL_MIXED = 128
# Steps over which the learning rate rises.
_WARM_UP = 30


class _Mixer:
    """New training shapes from pairs of examples: one inside a region, the other outside.

    The region is a geodesic disc about a random vertex with a soft rim; features blend linearly.
    """

    def __init__(
        self, x: Tensor, geodesics: Geodesics | SiteGeodesics, generator: torch.Generator
    ) -> None:
        self._x = x
        V = x.shape[0]
        # 200 fixed centres bound the number of geodesic rows.
        vertices = torch.randperm(V, generator=generator)[:200]
        rows = np.array([geodesics.normalised_row(int(i)) for i in vertices])
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


class _Descent:
    """Steps of Adam on all shapes, and the best weights so far."""

    def __init__(
        self,
        network: MeshAutoencoder,
        shapes: Tensor,
        mixer: _Mixer | None,
        generator: torch.Generator,
        locality: losses.Locality,
        settings: AdamSettings,
        ranks: Ranks,
    ) -> None:
        self._network, self._shapes, self._settings = network, shapes, settings
        self._ranks, self._parallel = ranks, ranks.parallel(network)
        self._told = ranks.count == 1 or ranks.rank > 0  # do the others have this state?
        self._optimiser = torch.optim.Adam(
            network.parameters(), lr=settings.learning_rate, fused=True
        )
        self._mixer, self._generator, self._locality = mixer, generator, locality
        self._stochastic = mixer is not None or 0 < settings.batch < shapes.shape[1]
        self._mean: Tensor | None = None
        if not self._stochastic:  # every step has the same shapes: their ring mean is constant
            with torch.no_grad():
                self._mean = network.mean(ranks.own(shapes))
        self.loss = float("inf")
        self.reconstruction = float("inf")
        self._best = {k: v.detach().clone() for k, v in network.state_dict().items()}

    def start(self) -> None:
        if self._settings.initial == "pca":
            x = _with_mixed(self._shapes, self._mixer, _INITIAL_MIXED)
            self._network.start_from_components(x)

    def step(self, epoch: int) -> tuple[float, ...]:
        """Take one step; returns the three weighted terms of the loss before it."""
        if self._ranks.rank == 0:
            if not self._told:
                self._ranks.tell(self.state())
                self._told = True
            self._ranks.tell(epoch)
        network, settings, N = self._network, self._settings, self._shapes.shape[1]
        batch = self._shapes
        if 0 < settings.batch < N:
            drawn = torch.randperm(N, generator=self._generator)[: settings.batch]
            batch = batch[:, drawn.to(batch.device)]
        batch = _with_mixed(batch, self._mixer, settings.mixed_shapes)
        for group in self._optimiser.param_groups:
            group["lr"] = _learning_rate(settings, epoch)
        self._optimiser.zero_grad(set_to_none=True)
        own = self._ranks.own(batch)
        estimate, z = self._parallel(own, self._mean)
        loss = losses.loss(
            own,
            estimate,
            z,
            network.C,
            self._locality.update(network.C),
            sparsity_weight=settings.sparsity,
            range_weight=settings.range_weight,
            range_limit=settings.range_limit,
        )
        loss = self._ranks.loss(
            loss, z, batch.shape[1], settings.range_weight, settings.range_limit
        )
        loss.total.backward()
        terms = self._ranks.terms(loss)
        if self._stochastic:
            # Losses of different batches cannot be compared: the newest weights are the result.
            self.loss, self.reconstruction = sum(terms), terms[0]
        elif epoch % _BEST_EVERY == 0 or epoch == settings.epochs - 1:
            self._update_best(sum(terms), terms[0])
        self._optimiser.step()
        return terms

    def weights(self) -> NetworkWeights:
        """The weights of the least loss if every step has all shapes; else the newest."""
        if not self._stochastic:
            self._network.load_state_dict(self._best)
        return self._network.weights

    def _update_best(self, loss: float, reconstruction: float) -> None:
        if loss < self.loss:
            self.loss, self.reconstruction = loss, reconstruction
            for name, value in self._network.state_dict().items():
                self._best[name].copy_(value)

    def state(self) -> State:
        tensors: dict[str, Tensor] = {}
        for name, value in self._network.state_dict().items():
            tensors[f"network.{name}"] = value
            tensors[f"best.{name}"] = self._best[name]
        for index, state in self._optimiser.state_dict()["state"].items():
            for name, value in state.items():
                tensors[f"adam.{index}.{name}"] = value
        tensors["generator"] = self._generator.get_state()
        arrays = {name: value.detach().cpu().numpy() for name, value in tensors.items()}
        for index, weights in enumerate(self._optimiser.param_groups[0]["params"]):
            # Before the first step the optimiser has none of them.
            for name in ("exp_avg", "exp_avg_sq"):
                arrays.setdefault(f"adam.{index}.{name}", np.zeros(weights.shape, np.float32))
            arrays.setdefault(f"adam.{index}.step", np.zeros((), np.float32))
        terms = {"loss": self.loss, "reconstruction": self.reconstruction}
        return {k: v if np.isfinite(v) else None for k, v in terms.items()}, arrays

    def restore(self, status: dict[str, Any], arrays: dict[str, NDArray]) -> None:
        tensors = {name: torch.tensor(array) for name, array in arrays.items()}
        state: dict[int, dict[str, Tensor]] = {}
        for name, value in tensors.items():
            if name.startswith("adam."):
                _, index, key = name.split(".")
                state.setdefault(int(index), {})[key] = value
        self._network.load_state_dict(_with_prefix(tensors, "network."))
        for name, value in _with_prefix(tensors, "best.").items():
            self._best[name].copy_(value)
        groups = self._optimiser.state_dict()["param_groups"]
        self._optimiser.load_state_dict({"state": state, "param_groups": groups})
        self._generator.set_state(tensors["generator"])
        terms = (np.inf if status[k] is None else status[k] for k in ("loss", "reconstruction"))
        self.loss, self.reconstruction = terms


def _with_prefix(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}


def fit(
    x: FloatArray,
    indptr: IntArray,
    rings: IntArray,
    geodesics: Geodesics | SiteGeodesics,
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
        indptr, rings: one-rings of the reference, as `deformer.geometry.one_rings` returns them.
        geodesics: distances over the reference, for Λ and the mixed shapes.
        config: configuration, whose `training` is an `AdamSettings`.
        seed: seed of the initial weights and the mixed shapes. The same seed gives the same network
            on one machine with one number of threads.
        device: "cpu", "cuda", "mps" or "auto"; each process of a `torchrun` has a GPU of its own.
        checkpoint: folder written every half minute and at the end, or None.
        resume: continue from `checkpoint`; the result is that of an uninterrupted training.
        on_progress: called after every epoch.

    Returns:
        The weights of the lowest loss if every step has all shapes, else the newest. Ctrl-C ends
        the training after the current step; the checkpoint is then saved and the weights so far are
        returned.

    Raises:
        InputError: the config is of another method, or the device or checkpoint cannot be used.
    """
    settings = config.training
    if not isinstance(settings, AdamSettings):
        raise InputError(f"config: expected training by Adam, got {settings.method!r}")
    resolve_device(device)
    ranks = Ranks()
    try:
        # Its network is gone before the connection that averages the gradients.
        found = _lead(
            x,
            indptr,
            rings,
            geodesics,
            config,
            settings,
            seed,
            device,
            ranks,
            checkpoint=checkpoint,
            resume=resume,
            on_progress=on_progress,
        )
        ranks.meet()
    finally:
        ranks.leave()
    return found


def _lead(
    x: FloatArray,
    indptr: IntArray,
    rings: IntArray,
    geodesics: Geodesics | SiteGeodesics,
    config: ModelConfig,
    settings: AdamSettings,
    seed: int,
    device: str,
    ranks: Ranks,
    **options: Any,
) -> TrainingResult:
    """Take the steps, and tell them to the other processes."""
    ranks.tell((x, indptr, rings, geodesics, config, seed, device))
    descent = _prepared(x, indptr, rings, geodesics, config, seed, device, ranks=ranks)
    identity = identity_of(x, config, seed)
    outcome = run_training(descent, settings.epochs, identity, **options)
    ranks.tell(None)  # the others have no more to do
    weights = descent.weights().pruned(settings.pruning)
    return TrainingResult(weights, descent.loss, descent.reconstruction, *outcome)


def assist() -> None:
    """Take the steps of `fit` in another process of a `torchrun`, until it ends.

    Ctrl-C is for the other process, which lets this one finish the step.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    ranks = Ranks()
    try:
        _follow(ranks)  # its network is gone before the connection that averages the gradients
        ranks.meet()
    finally:
        ranks.leave()
    # Now and then threads of torch abort a process that ends, and torchrun then ends the first one,
    # which may still be saving what was trained.
    atexit.register(_end_at_once)


def _end_at_once() -> None:
    """End the process without what C++ libraries do at its end."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def _follow(ranks: Ranks) -> None:
    """Take the steps that rank 0 tells."""
    descent = _prepared(*ranks.tell(), ranks=ranks)
    while (told := ranks.tell()) is not None:
        if isinstance(told, int):
            descent.step(told)
        else:
            descent.restore(*told)


def _prepared(
    x: FloatArray,
    indptr: IntArray,
    rings: IntArray,
    geodesics: Geodesics | SiteGeodesics,
    config: ModelConfig,
    seed: int,
    device: str,
    *,
    ranks: Ranks,
) -> _Descent:
    """The training before its first step; arguments as in `fit`."""
    settings = config.training
    assert isinstance(settings, AdamSettings)
    target = ranks.device(device)
    torch.manual_seed(seed)
    network = MeshAutoencoder(indptr, rings, config.components, settings.layers).to(target)
    shapes = torch.as_tensor(np.swapaxes(x, 0, 1), dtype=torch.float32).contiguous().to(target)
    generator = torch.Generator().manual_seed(seed)
    mixer = _Mixer(shapes, geodesics, generator) if settings.mixed_shapes and len(x) > 1 else None
    locality = losses.Locality(geodesics, config.d_min, config.d_max)
    return _Descent(network, shapes, mixer, generator, locality, settings, ranks)


def _with_mixed(x: Tensor, mixer: _Mixer | None, count: int) -> Tensor:
    return x if mixer is None else torch.cat([x, mixer(count)], dim=1)


def _learning_rate(settings: AdamSettings, epoch: int) -> float:
    if settings.schedule == "constant":
        return settings.learning_rate
    # Adam's first steps change all entries of C by the same amount: if the mean of the features is
    # far from zero, full steps would saturate every tanh for good.
    rise = min(1.0, (epoch + 1) / _WARM_UP)
    fall = 0.5 * (1.0 + math.cos(math.pi * epoch / settings.epochs))
    return settings.learning_rate * (0.01 + 0.99 * fall) * rise
