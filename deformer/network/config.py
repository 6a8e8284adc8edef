"""What decides a training, and the two configurations that come with the program."""

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
        epochs: steps of Adam.
        sparsity: λ₁, weight of Ω(C).
        range_weight: λ₂, weight of V(Z).
        range_limit: θ, the latent magnitude that V(Z) leaves free.
        learning_rate: of Adam; its peak where `schedule` is "cosine".
        schedule: after a short rise "constant" (the paper), or "cosine": down to a hundredth.
        batch: examples drawn for every step; 0 takes all of them (the paper).
        mixed_shapes: shapes mixed from two examples, region by region, that are added to every
            step; 0 trains on the examples alone (the paper).
        initial: "random" weights, or "pca": the principal components of the first layer's output;
            the paper does not say.
        pruning: after training, weights ‖C_k^i‖ below this share of component k's largest become
            zero, so that supports end somewhere; 0 keeps all (the paper).
        encoder: of shapes, once the network is trained: the "network"'s own (the paper), or, for
            one layer, "projection": the code of least squares in front of the decoder's tanh
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
    """Training that alternates between codes and components, each the best for the other.

    The network has one layer, and shapes are encoded by projection (`Decoder.project`).

    Args:
        epochs: rounds of codes, centres and components.
        sparsity: λ₁ for data of unit variance, of which at least 2 is charged from d_max on; None
            has it chosen by how well examples left out are recovered from a few of their vertices.

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
    """Everything that decides what a training run gives, beside the shapes and the seed.

    Args:
        name: "paper", "default", or a name of one's own.
        components: K, dimensions of the latent code.
        training: the method, Adam (the paper) or a factorisation, and what it alone needs.
        d_min, d_max: geodesic distances, divided by the largest, between which Λ rises from 0
            to 1.
        denoised: take the examples' noise off first, where there is any (`remove_noise`); False is
            the paper.
        mirrored: train on the examples' mirror images, too, where the body is symmetric and they
            help to explain the examples (`images_explain`); False is the paper.
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
        """True where shapes are encoded by projection, False where the network encodes them."""
        return self.training.encoder == "projection"

    def with_training(self, **changes: Any) -> ModelConfig:
        """The same configuration with other values for some fields of `training`.

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
    """A preset by name, or a config, with other values for what is not None.

    Args:
        config: "default", "paper" or a ModelConfig.
        components: K, as in `ModelConfig`.
        epochs: of its training.
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
