"""Configuration of a training, and the presets "default" and "paper"."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, ClassVar

from deformer.checks import (
    LARGEST,
    checked_choice,
    checked_flag,
    checked_integer,
    checked_number,
    checked_text,
    shortened,
)
from deformer.errors import InputError

FEATURES = 9
# The names of checkpoints have seven digits for the epoch.
MOST_EPOCHS = 9_999_999


@dataclass(frozen=True)
class AdamSettings:
    """Training of the whole network by Adam; the defaults are the paper's.

    Tan et al. 2018, training (at the end of section "Network Architecture"). What the paper does
    not say, the start and the number of steps, is that of its authors' public code.

    Args:
        layers: output width of each graph convolution of the encoder; the last is the paper's μ.
        epochs: number of steps.
        sparsity: λ₁, weight of Ω(C).
        range_weight: λ₂, weight of V(Z).
        range_limit: θ, the latent magnitude up to which V(Z) is 0.
        learning_rate: Adam's learning rate; the peak if `schedule` is "cosine".
        schedule: course of the learning rate: "constant" (the paper), or "cosine", which rises over
            the first steps and falls to a hundredth.
        batch: number of examples drawn for every step; 0 uses all of them (the paper).
        mixed_shapes: number of shapes, each mixed from two examples region by region, that are
            added to every step; 0 trains on the examples alone (the paper).
        initial: "random", all weights from a normal distribution of deviation 0.02 and zero biases
            (the paper's authors), or "pca": principal components of the convolved features.
        pruning: after training, weights ‖C_k^i‖ below this share of component k's largest are set
            to zero, which bounds the supports; 0 keeps all weights (the paper).
        encoder: how the trained model encodes shapes: "network" is the network's own encoder (the
            paper); "projection", for one layer, is least squares in front of the decoder's tanh
            (`Decoder.project`).

    Raises:
        InputError: a value out of its range.
    """

    method: ClassVar[str] = "adam"

    layers: tuple[int, ...] = (FEATURES,)
    epochs: int = 2000
    sparsity: float = 0.5
    range_weight: float = 0.5
    range_limit: float = 5.0
    learning_rate: float = 1e-3
    schedule: str = "constant"
    batch: int = 0
    mixed_shapes: int = 0
    initial: str = "random"
    pruning: float = 0.0
    encoder: str = "network"

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not isinstance(self.layers, tuple | list) or not self.layers:
            raise InputError(f"layers: expected positive widths, got {shortened(self.layers)}")
        widths = tuple(checked_integer(width, "layers", least=1) for width in self.layers)
        object.__setattr__(self, "layers", widths)
        checked_integer(self.epochs, "epochs", least=1, most=MOST_EPOCHS)
        for name in ("sparsity", "range_weight", "range_limit"):
            checked_number(getattr(self, name), name, least=0, most=LARGEST)
        for name in ("batch", "mixed_shapes"):
            checked_integer(getattr(self, name), name, least=0)
        checked_number(self.learning_rate, "learning_rate", above=0, most=LARGEST)
        checked_choice(self.schedule, "schedule", ("constant", "cosine"))
        checked_choice(self.initial, "initial", ("random", "pca"))
        checked_choice(self.encoder, "encoder", ("network", "projection"))
        if self.encoder == "projection" and len(self.layers) > 1:
            raise InputError(
                f"encoder: 'projection' needs one layer, got layers {self.layers}; use 'network'"
            )
        if checked_number(self.pruning, "pruning", least=0, most=1) == 1:
            raise InputError("pruning: expected 0 or more and below 1, got 1; correct it")


@dataclass(frozen=True)
class FactorisationSettings:
    """Training by alternating minimisation over codes, centres and components.

    The network has one layer, and shapes are encoded by projection (`Decoder.project`).

    Args:
        epochs: rounds of codes, centres and components.
        sparsity: λ₁, for data of unit variance; at distances from d_max on it is at least 2. None
            chooses λ₁ by cross-validation: by the errors of held-out examples that are recovered
            from a few of their vertices.

    Raises:
        InputError: a value out of its range.
    """

    method: ClassVar[str] = "factorisation"
    layers: ClassVar[tuple[int, ...]] = (FEATURES,)
    encoder: ClassVar[str] = "projection"

    epochs: int = 50
    sparsity: float | None = None

    def __post_init__(self) -> None:
        """Check the ranges."""
        checked_integer(self.epochs, "epochs", least=1, most=MOST_EPOCHS)
        if self.sparsity is not None:
            checked_number(self.sparsity, "sparsity", least=0, most=LARGEST)


_SETTINGS = {settings.method: settings for settings in (AdamSettings, FactorisationSettings)}


@dataclass(frozen=True)
class ModelConfig:
    """Everything that the result of a training depends on, beside the shapes and the seed.

    Args:
        name: "paper", "default", or a name of one's own.
        components: K, the dimension of the latent code.
        training: settings of the training method: Adam (the paper) or a factorisation.
        d_min: geodesic distance, divided by the largest, up to which Λ is 0.
        d_max: the one from which Λ is 1; between the two it rises linearly.
        denoised: remove the examples' noise first, if there is any (`remove_noise`); False is the
            paper.
        mirrored: train also on the examples' mirror images, if they help to explain the examples
            (`images_explain`); False is the paper.
        align: remove each shape's rigid motion against the reference before anything else.

    Raises:
        InputError: a value out of its range.
    """

    name: str = "default"
    components: int = 50
    training: AdamSettings | FactorisationSettings = field(default_factory=FactorisationSettings)
    d_min: float = 0.2
    d_max: float = 0.4
    denoised: bool = True
    mirrored: bool = True
    align: bool = False

    def __post_init__(self) -> None:
        """Check the ranges."""
        checked_text(self.name, "name")
        checked_integer(self.components, "components", least=1)
        methods = tuple(_SETTINGS.values())
        if not isinstance(self.training, methods):
            names = " or ".join(method.__name__ for method in methods)
            raise InputError(f"training: expected {names}, got {shortened(self.training)}")
        low = checked_number(self.d_min, "d_min", least=0)
        high = checked_number(self.d_max, "d_max", above=0, most=LARGEST)
        if not low < high:
            raise InputError(f"d_min < d_max expected, got {self.d_min} and {self.d_max}")
        for name in ("denoised", "mirrored", "align"):
            checked_flag(getattr(self, name), name)

    @property
    def layers(self) -> tuple[int, ...]:
        """Output width of each graph convolution of the encoder."""
        return self.training.layers

    @property
    def projects(self) -> bool:
        """True if shapes are encoded by projection, false if the network encodes them."""
        return self.training.encoder == "projection"

    def with_training(self, **changes: Any) -> ModelConfig:
        """A copy with other values for some fields of `training`.

        Args:
            changes: field → value.

        Raises:
            InputError: a value out of its range.
            TypeError: the method has no such field.
        """
        return replace(self, training=replace(self.training, **changes))

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; the inverse of `from_dict`."""
        training = {"method": self.training.method, **asdict(self.training)}
        if isinstance(self.training, AdamSettings):
            training["layers"] = list(self.training.layers)
        return {**asdict(self), "training": training}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> ModelConfig:
        """The configuration that `as_dict` wrote.

        Raises:
            InputError: an unknown method, a value out of its range, a missing or unknown key.
        """
        training = _complete(values, "training", cls)
        if not isinstance(training, dict) or "method" not in training:
            raise InputError(
                f"training: expected an object with 'method', got {shortened(training)}"
            )
        settings = _SETTINGS[checked_choice(training["method"], "method", tuple(_SETTINGS))]
        training = {key: value for key, value in training.items() if key != "method"}
        _complete(training, "epochs", settings)
        return cls(**{**values, "training": settings(**training)})


def _complete(values: Any, key: str, kind: type) -> Any:
    """The value of a key, if `values` has all fields of the dataclass `kind` and none else."""
    names = {field.name for field in fields(kind)}
    if not isinstance(values, dict) or set(values) != names:
        differing = sorted(set(values) ^ names)[0] if isinstance(values, dict) else values
        raise InputError(
            f"{kind.__name__}: expected {', '.join(sorted(names))}, not so {shortened(differing)}"
        )
    return values[key]


PRESETS: dict[str, ModelConfig] = {
    "default": ModelConfig(),
    "paper": ModelConfig(name="paper", training=AdamSettings(), denoised=False, mirrored=False),
}


def resolve_config(
    config: str | ModelConfig,
    *,
    components: int | None = None,
    epochs: int | None = None,
    align: bool | None = None,
) -> ModelConfig:
    """A preset by name, or a config, changed by the arguments that are not None.

    Args:
        config: "default", "paper" or a ModelConfig.
        components: K, as in `ModelConfig`.
        epochs: as in its `training`.
        align: as in `ModelConfig`.

    Raises:
        InputError: no such preset, or a value out of its range.
    """
    if not isinstance(config, ModelConfig):
        config = PRESETS[checked_choice(config, "config", tuple(PRESETS))]
    if epochs is not None:
        config = config.with_training(epochs=epochs)
    changes = {"components": components, "align": align}
    return replace(config, **{k: v for k, v in changes.items() if v is not None})
