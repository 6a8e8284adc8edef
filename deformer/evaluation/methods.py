"""The compared methods by name, and how one is trained, or taken from an earlier run."""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree
from typing import ClassVar

from numpy.typing import ArrayLike

from deformer.autoencoder import resolve_config
from deformer.baselines import METHODS
from deformer.baselines.method import Poser, Space
from deformer.errors import InputError
from deformer.handles import HandleSolver
from deformer.learning import train
from deformer.mesh import FloatArray, MeshSequence
from deformer.model import DeformationModel, load_model
from deformer.training import has_checkpoint

# The project's own networks, by name, and the configuration of each.
NETWORKS = {"autoencoder": "default", "autoencoder-paper": "paper"}


@dataclass(frozen=True)
class Setting:
    """What a network is trained with, beside its configuration; nothing for other methods.

    Args:
        epochs: training steps; None keeps the configuration's.
        lambdas: weights λ₁ of sparsity and λ₂ of the latent range; None keeps them.
        model: directory or name of a trained model, in place of training.
        digest: of that model's files.
    """

    epochs: int | None = None
    lambdas: tuple[float, float] | None = None
    model: str | None = None
    digest: str | None = None

    @classmethod
    def of_model(cls, model: str) -> Setting:
        """The setting of a trained model.

        Raises:
            InputError: there is no such model.
        """
        loaded = load_model(model)
        digest = hashlib.sha256()
        for tensor in loaded.network.state_dict().values():
            digest.update(tensor.numpy().tobytes())
        return cls(model=model, digest=digest.hexdigest()[:16])

    @property
    def label(self) -> str:
        """For progress."""
        return "λ {:g} {:g}".format(*self.lambdas) if self.lambdas else ""


class Network:
    """A trained model as one of the compared methods."""

    name: ClassVar[str] = "autoencoder"
    space: ClassVar[Space] = "acap"

    def __init__(self, model: DeformationModel) -> None:
        """Prepare to pose the model."""
        self.model = model
        self._solver: HandleSolver | None = None

    def fit(self, shapes: MeshSequence, components: int, seed: int = 0) -> Network:
        """Refuse: this one is trained."""
        raise InputError(f"{self.name}: is trained already; train another with deformer.train")

    def encode(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) by the encoder."""
        return self.model.encode(vertices)

    def fit_codes(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) by a search."""
        return self.model.fit(vertices)

    def decode(self, codes: ArrayLike) -> FloatArray:
        """Shapes (N, V, 3)."""
        return self.model.decode(codes)

    def fit_handles(self, vertices: ArrayLike, targets: ArrayLike) -> FloatArray:
        """The mesh (V, 3) with exact handles, found anew, whatever was asked before."""
        if self._solver is None:
            self._solver = HandleSolver(self.model)
        self._solver.set_handles(vertices, targets, hard=True)
        return self._solver.solve().vertices


def known_methods() -> tuple[str, ...]:
    """Names that can be compared, in the order of tables."""
    return (*NETWORKS, *METHODS)


def offers_codes(method: str) -> bool:
    """Whether a method has components; one without only poses by control points."""
    return method in NETWORKS or method == "model" or METHODS[method]().space != "none"


def trained(
    method: str,
    shapes: MeshSequence,
    components: int,
    seed: int,
    setting: Setting,
    cache: Path,
) -> tuple[Poser, float]:
    """A trained method, and the seconds that its training took.

    Args:
        method: a known name, or "model" for the setting's model.
        shapes: to learn from; shape 0 is the reference.
        components: K.
        seed: of the training.
        setting: of a network.
        cache: where a network is kept. Its model is taken from there, or training goes on from a
            checkpoint beside it. Other methods are quick to train and are not kept.

    Raises:
        KeyboardInterrupt: training was interrupted; the checkpoint is saved.
    """
    if setting.model is not None:
        model = load_model(setting.model)
        return Network(model), float(model.summary.get("seconds", 0.0))
    begun = time.perf_counter()
    if method not in NETWORKS:
        return METHODS[method]().fit(shapes, components, seed), time.perf_counter() - begun
    if (cache / "model.json").is_file():
        model = load_model(cache)
        return Network(model), float(model.summary["seconds"])
    model = _train_network(method, shapes, components, seed, setting, cache)
    seconds = max(time.perf_counter() - begun, float(model.summary["seconds"]))
    return Network(model), seconds


def _train_network(
    method: str,
    shapes: MeshSequence,
    components: int,
    seed: int,
    setting: Setting,
    cache: Path,
) -> DeformationModel:
    sparsity, range_weight = setting.lambdas or (None, None)
    config = resolve_config(NETWORKS[method], sparsity=sparsity, range_weight=range_weight)
    checkpoint = cache.with_name(cache.name + ".checkpoint")
    model = train(
        shapes,
        components,
        config=config,
        epochs=setting.epochs,
        seed=seed,
        # The same numbers on every machine that goes on with a run.
        device="cpu",
        checkpoint=checkpoint,
        resume=has_checkpoint(checkpoint),
    )
    if model.summary["interrupted"]:
        raise KeyboardInterrupt
    cache.parent.mkdir(parents=True, exist_ok=True)
    model.save(cache)
    rmtree(checkpoint, ignore_errors=True)
    return model
