"""The compared methods by name; trains each, or loads it from an earlier run."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from deformer.baselines import METHODS, Autoencoder, LinearComponents, PosingMethod
from deformer.geometry import MeshSequence
from deformer.model import DeformationModel, load_model
from deformer.network import resolve_config
from deformer.training import has_checkpoint, remove_checkpoint, train


@dataclass(frozen=True)
class Setting:
    """Changes of a network's configuration, or a trained model; other methods have neither.

    Args:
        epochs: number of training steps; None is the configuration's.
        lambdas: weights λ₁ of sparsity and λ₂ of the latent range (Tan et al. 2018, equation 8);
            None is the configuration's.
        model: directory or name of a trained model that is used in place of training.
        digest: hash of that model's weights.
    """

    epochs: int | None = None
    lambdas: tuple[float, float] | None = None
    model: str | None = None
    digest: str | None = None

    @classmethod
    def of_model(cls, model: str) -> Setting:
        """The setting of a trained model.

        Args:
            model: directory or name of the model.

        Raises:
            InputError: there is no such model.
        """
        loaded = load_model(model).closed
        digest = hashlib.sha256()
        for array in loaded.weights.arrays.values():
            digest.update(array.tobytes())
        return cls(model=model, digest=digest.hexdigest()[:16])

    @property
    def label(self) -> str:
        """Description in progress lines: λ₁ and λ₂, or empty if they are the configuration's."""
        return "λ {:g} {:g}".format(*self.lambdas) if self.lambdas else ""


@dataclass(frozen=True)
class NetworkMethod:
    """A method that poses meshes with a trained network.

    Args:
        config: name of the network's configuration; methods with the same one share a network.
        make: creates the method from the trained model.
        sees_shapes: true if the method itself also learns from the training shapes.
    """

    config: str
    make: Callable[[DeformationModel], PosingMethod]
    sees_shapes: bool = False


# Methods with a network by name, in the order of tables; those of `deformer.baselines` come after.
NETWORKS = {
    "autoencoder": NetworkMethod("default", Autoencoder),
    "autoencoder-paper": NetworkMethod("paper", Autoencoder),
    "linear-components": NetworkMethod("paper", LinearComponents, sees_shapes=True),
}


def known_methods() -> tuple[str, ...]:
    """Names of all methods, in the order of tables."""
    return (*NETWORKS, *METHODS)


def has_components(method: str) -> bool:
    """True if a method has components. Methods without can only pose a mesh by control points."""
    return method in NETWORKS or method == "model" or METHODS[method]().space != "none"


def is_trained(cache: Path) -> bool:
    """True if the directory of a network's model has it."""
    return (cache / "model.json").is_file()


def train_method(
    method: str,
    shapes: MeshSequence,
    components: int,
    seed: int,
    setting: Setting,
    cache: Path | None,
) -> tuple[PosingMethod, float]:
    """Train a method, or load it.

    Args:
        method: a name of `known_methods`, or "model" for the trained model of `setting`.
        shapes: training shapes; shape 0 is the reference.
        components: number K of components.
        seed: seed of the training.
        setting: settings of a network's training.
        cache: directory of a network's model. If it has none, training resumes from a checkpoint
            beside it or starts, and saves the model there. None for methods without a network,
            which are always trained.

    Returns:
        The trained method, and the seconds that its training took.

    Raises:
        KeyboardInterrupt: training was interrupted; its checkpoint is saved.
    """
    if setting.model is not None:
        model = load_model(setting.model).closed
        return Autoencoder(model), float(model.summary["seconds"])
    begun = time.perf_counter()
    if cache is None:
        return METHODS[method]().fit(shapes, components, seed), time.perf_counter() - begun
    entry, before = NETWORKS[method], 0.0
    if is_trained(cache):
        model = load_model(cache).closed
        before = float(model.summary["seconds"])
    else:
        model = _train_network(entry.config, shapes, components, seed, setting, cache)
        before = max(0.0, float(model.summary["seconds"]) - (time.perf_counter() - begun))
    poser = entry.make(model)
    if entry.sees_shapes:
        poser = poser.fit(shapes, components, seed)
    return poser, before + time.perf_counter() - begun


def _train_network(
    config: str,
    shapes: MeshSequence,
    components: int,
    seed: int,
    setting: Setting,
    cache: Path,
) -> DeformationModel:
    settings = resolve_config(config)
    if setting.lambdas is not None:
        sparsity, range_weight = setting.lambdas
        settings = settings.with_training(sparsity=sparsity, range_weight=range_weight)
    checkpoint = cache.with_name(cache.name + ".checkpoint")
    model = train(
        shapes,
        components,
        config=settings,
        epochs=setting.epochs,
        seed=seed,
        # A run may continue on a machine without a GPU, and must compute the same numbers there.
        device="cpu",
        checkpoint=checkpoint,
        resume=has_checkpoint(checkpoint),
    )
    if model.summary["interrupted"]:
        raise KeyboardInterrupt
    model.save(cache)
    remove_checkpoint(checkpoint)
    return model
