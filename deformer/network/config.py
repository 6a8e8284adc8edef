"""Configuration of a training, and the presets "default" and "paper"."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar

from deformer.errors import InputError

FEATURES = 9


@dataclass(frozen=True)
class AdamSettings:
    """Training of the whole network by Adam; the defaults are the paper's.

    Tan et al. 2018, training (at the end of section "Network Architecture").

    Args:
        layers: output width of each graph convolution of the encoder; the last is the paper's μ.
        epochs: number of steps.
        sparsity: λ₁, weight of Ω(C).
        range_weight: λ₂, weight of V(Z).
        range_limit: θ, the latent magnitude up to which V(Z) is 0.
        learning_rate: Adam's learning rate; the peak if `schedule` is "cosine".
        schedule: course of the learning rate after a short rise: "constant" (the paper), or
            "cosine", which falls to a hundredth.
        batch: number of examples drawn for every step; 0 uses all of them (the paper).
        mixed_shapes: number of shapes, each mixed from two examples region by region, that are
            added to every step; 0 trains on the examples alone (the paper).
        initial: "random" weights, or "pca": principal components of the convolved features; the
            paper does not say.
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
    epochs: int = 3000
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
        object.__setattr__(self, "layers", tuple(int(width) for width in self.layers))
        if not self.layers or min(self.layers) < 1:
            raise InputError(f"layers: expected positive widths, got {self.layers}")
        _check_at_least(self, 1, "epochs")
        _check_at_least(self, 0, "sparsity", "range_weight", "range_limit")
        _check_at_least(self, 0, "batch", "mixed_shapes")
        if not self.learning_rate > 0:
            raise InputError(f"learning_rate: expected above 0, got {self.learning_rate}")
        for name, allowed in (
            ("schedule", ("constant", "cosine")),
            ("initial", ("random", "pca")),
            ("encoder", ("network", "projection")),
        ):
            if getattr(self, name) not in allowed:
                raise InputError(
                    f"{name}: expected one of {', '.join(allowed)}, got {getattr(self, name)!r}"
                )
        if self.encoder == "projection" and len(self.layers) > 1:
            raise InputError(
                f"encoder: 'projection' needs one layer, got layers {self.layers}; use 'network'"
            )
        if not 0 <= self.pruning < 1:
            raise InputError(f"pruning: expected 0 or more and below 1, got {self.pruning}")


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
        _check_at_least(self, 1, "epochs")
        if self.sparsity is not None:
            _check_at_least(self, 0, "sparsity")


_SETTINGS = {settings.method: settings for settings in (AdamSettings, FactorisationSettings)}


@dataclass(frozen=True)
class ModelConfig:
    """Everything that the result of a training depends on, beside the shapes and the seed.

    Args:
        name: "paper", "default", or a name of one's own.
        components: K, the dimension of the latent code.
        training: settings of the training method: Adam (the paper) or a factorisation.
        d_min, d_max: geodesic distances, divided by the largest, between which Λ rises from 0
            to 1.
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
        _check_at_least(self, 1, "components")
        if not 0 <= self.d_min < self.d_max:
            raise InputError(f"d_min < d_max expected, got {self.d_min} and {self.d_max}")

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
            InputError: an unknown method, or a value out of its range.
            KeyError, TypeError: the values are not those of `as_dict`.
        """
        training = dict(values["training"])
        method = training.pop("method")
        if method not in _SETTINGS:
            raise InputError(f"method: expected one of {', '.join(_SETTINGS)}, got {method!r}")
        return cls(**{**values, "training": _SETTINGS[method](**training)})


def _check_at_least(settings: object, least: int, *names: str) -> None:
    for name in names:
        if not getattr(settings, name) >= least:
            raise InputError(f"{name}: expected at least {least}, got {getattr(settings, name)}")


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
    if isinstance(config, str):
        if config not in PRESETS:
            raise InputError(f"config: expected one of {', '.join(PRESETS)}, got {config!r}")
        config = PRESETS[config]
    if epochs is not None:
        config = config.with_training(epochs=epochs)
    changes = {"components": components, "align": align}
    return replace(config, **{k: v for k, v in changes.items() if v is not None})
