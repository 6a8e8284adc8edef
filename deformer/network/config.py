"""What decides a training, and the two configurations that come with the program."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from deformer.errors import InputError

FEATURES = 9


@dataclass(frozen=True)
class ModelConfig:
    """Everything that decides what a training run gives, beside the shapes and the seed.

    Args:
        name: "paper", "default", or a name of one's own.
        components: K, dimensions of the latent code.
        layers: output width of each graph convolution of the encoder; the last is the paper's μ.
        range_weight: λ₂, weight of V(Z).
        range_limit: θ, the latent magnitude that V(Z) leaves free.
        d_min, d_max: normalised geodesic distances between which Λ rises from 0 to 1.
        method: "factorisation" alternates between codes and components, each the best for the
            other (`factoring.factor`); "gradients" is Adam on the whole network (the paper).
        epochs: steps of Adam, or rounds of the factorisation.
        sparsity: λ₁, weight of Ω(C); a factorisation's is for data of unit variance, and None has
            it chosen by how well examples left out are recovered from a few of their vertices. From
            d_max on a factorisation charges at least 2.
        learning_rate: of Adam, as `range_weight` and all from here to `initial` are; its peak
            where `schedule` is "cosine".
        schedule: after a short rise "constant" (the paper), or "cosine": down to a hundredth.
        batch: examples drawn for every step; 0 takes all of them (the paper).
        mixed_shapes: shapes mixed from two examples, region by region, that are added to every
            step; 0 trains on the examples alone (the paper).
        initial: "random" weights, or "pca": the principal components of the first layer's output;
            the paper does not say.
        pruning: after training, weights ‖C_k^i‖ below this share of component k's largest become
            zero, so that supports end somewhere; 0 keeps all (the paper).
        encoder: of shapes, once the network is trained: the "network"'s own (the paper), or
            "projection": the code of least squares in front of the decoder's tanh
            (`Decoder.project`). Networks of several layers have no such and use their own.
        denoised: take the examples' noise off first, where there is any (`remove_noise`); False is
            the paper.
        mirrored: train on the examples' mirror images, too, where the body is symmetric and they
            help to explain the examples (`mirroring.images_explain`); False is the paper.
        align: remove each shape's rigid motion against the reference before anything else.
    """

    name: str = "default"
    components: int = 50
    layers: tuple[int, ...] = (9,)
    method: str = "gradients"
    sparsity: float | None = 2.0
    range_weight: float = 0.5
    range_limit: float = 5.0
    d_min: float = 0.2
    d_max: float = 0.4
    learning_rate: float = 3e-3
    schedule: str = "cosine"
    epochs: int = 1500
    batch: int = 16
    mixed_shapes: int = 24
    initial: str = "pca"
    pruning: float = 0.01
    encoder: str = "projection"
    denoised: bool = True
    mirrored: bool = True
    align: bool = False

    def __post_init__(self) -> None:
        """Check the ranges."""
        object.__setattr__(self, "layers", tuple(int(width) for width in self.layers))
        if self.components < 1:
            raise InputError(f"components: expected at least 1, got {self.components}")
        if not self.layers or min(self.layers) < 1:
            raise InputError(f"layers: expected positive widths, got {self.layers}")
        if self.epochs < 1:
            raise InputError(f"epochs: expected at least 1, got {self.epochs}")
        if not 0 <= self.d_min < self.d_max:
            raise InputError(f"d_min < d_max expected, got {self.d_min} and {self.d_max}")
        for field, allowed in (
            ("method", ("gradients", "factorisation")),
            ("schedule", ("constant", "cosine")),
            ("initial", ("random", "pca")),
            ("encoder", ("network", "projection")),
        ):
            if getattr(self, field) not in allowed:
                raise InputError(
                    f"{field}: expected one of {', '.join(allowed)}, got {getattr(self, field)!r}"
                )
        if self.method == "factorisation" and not (self.projects and self.layers == (FEATURES,)):
            raise InputError(
                f"method: a factorisation has layers ({FEATURES},) and the encoder 'projection', "
                f"got {self.layers} and {self.encoder!r}; use 'gradients'"
            )
        if not 0 <= self.pruning < 1:
            raise InputError(f"pruning: expected 0 or more and below 1, got {self.pruning}")
        if self.sparsity is None and self.method != "factorisation":
            raise InputError("sparsity: only a factorisation chooses it, got None; give a number")
        for field in ("sparsity", "range_weight", "range_limit", "batch", "mixed_shapes"):
            if (getattr(self, field) or 0) < 0:
                raise InputError(f"{field}: expected 0 or more, got {getattr(self, field)}")

    @property
    def projects(self) -> bool:
        """Whether shapes are encoded by projection."""
        return self.encoder == "projection" and len(self.layers) == 1

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {**asdict(self), "layers": list(self.layers)}


PRESETS: dict[str, ModelConfig] = {
    "default": ModelConfig(method="factorisation", epochs=50, sparsity=None, pruning=0.0),
    "paper": ModelConfig(
        name="paper",
        sparsity=0.5,
        learning_rate=1e-3,
        schedule="constant",
        epochs=3000,
        batch=0,
        mixed_shapes=0,
        initial="random",
        pruning=0.0,
        encoder="network",
        denoised=False,
        mirrored=False,
    ),
}


def resolve_config(config: str | ModelConfig, **changes: Any) -> ModelConfig:
    """A preset by name, or a config, with `changes` that are not None applied."""
    if isinstance(config, str):
        if config not in PRESETS:
            raise InputError(f"config: expected one of {', '.join(PRESETS)}, got {config!r}")
        config = PRESETS[config]
    return replace(config, **{k: v for k, v in changes.items() if v is not None})
