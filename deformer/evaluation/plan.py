"""The plan of an evaluation: trainings, and the measurements of each trained method.

The plan is complete before anything runs. The key of a measurement is a hash of everything that its
result rows depend on. An interrupted run continues with the missing keys; a changed option
recomputes only the measurements that depend on it.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from deformer.errors import InputError
from deformer.evaluation.methods import NETWORKS, Setting, has_components, known_methods
from deformer.evaluation.sources import Source
from deformer.evaluation.splits import Split, limit_test_shapes, random_split, sequence_split
from deformer.network import PRESETS

Protocol = Literal["reconstruction", "sparse_control", "layout", "sensitivity", "noise", "rotation"]
PROTOCOLS: tuple[Protocol, ...] = (
    "reconstruction",
    "sparse_control",
    "layout",
    "sensitivity",
    "noise",
    "rotation",
)
"""Names of what can be measured."""
Kind = Literal["training", "reconstruction", "rotation", "sparse_control", "example"]

# The settings of (λ₁, λ₂) that the paper compares with (0.5, 0.5) (Tan et al. 2018, table
# "diff_lambda").
LAMBDAS = ((0.4, 0.4), (0.6, 0.6), (0.4, 0.6), (0.6, 0.4))
LAMBDA_METHOD = "autoencoder-paper"
"""The method whose network is also trained with other (λ₁, λ₂) than (0.5, 0.5)."""
# The method whose network lays out the control points of the protocol "layout".
LAYOUT_METHOD = "autoencoder"
# Standard deviations of the noise protocol, per coordinate, in bounding diagonals of the reference.
NOISE = (0.005, 0.01, 0.02)
# Number of control points of the example meshes that pictures show.
EXAMPLE_COUNT = 20
# To be incremented whenever the same options give other result rows than before.
_VERSION = 6


@dataclass(frozen=True)
class Study:
    """The measurements of several methods on one data set.

    Args:
        source: the data set.
        methods: names of the methods to compare, from `known_methods` or "model".
        protocols: names of the protocols, from `PROTOCOLS`.
        components: numbers K of components in the protocol "reconstruction".
        at: number K of components in the other protocols and in the pictures.
        counts: numbers of control points.
        splits: number of splits to draw, or the splits themselves.
        seeds: number of random first control points for each split.
        epochs: upper bound on a network's number of training steps; None is its configuration's.
        tests: upper bound on the number of test shapes; None is all.
        model: settings of the method "model", which is a trained model; None is no such method.
        pictures: true to save an example mesh of each method.
        layout: control vertices of the protocol "layout"; None has them chosen by the network
            `LAYOUT_METHOD` of the split, or by the trained model.

    Raises:
        InputError: an unknown method or protocol, none of either, or a number below 1.
    """

    source: Source
    methods: tuple[str, ...]
    protocols: tuple[Protocol, ...] = ("reconstruction", "sparse_control", "rotation")
    components: tuple[int, ...] = (50,)
    at: int = 50
    counts: tuple[int, ...] = (5, 10, 20, 40, 80)
    splits: int | tuple[Split, ...] = 1
    seeds: int = 1
    epochs: int | None = None
    tests: int | None = None
    model: Setting | None = None
    pictures: bool = True
    layout: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        """Check names and ranges before anything runs."""
        known = (*known_methods(), *(("model",) if self.model else ()))
        for name, given, allowed in (
            ("methods", self.methods, known),
            ("protocols", self.protocols, PROTOCOLS),
        ):
            unknown = [entry for entry in given if entry not in allowed]
            if unknown or not given:
                raise InputError(
                    f"{name}: got {unknown[0]!r}, expected some of {', '.join(allowed)}"
                    if unknown
                    else f"{name}: got none, expected some of {', '.join(allowed)}"
                )
        numbers = {"components": (*self.components, self.at), "counts": self.counts}
        numbers |= {"seeds": (self.seeds,), "tests": (self.tests or 1,)}
        for name, values in numbers.items():
            if not values or min(values) < 1:
                raise InputError(f"{name}: expected numbers of at least 1, got {list(values)}")

    def drawn_splits(self) -> tuple[Split, ...]:
        """The given splits, or, if `splits` is a number, as many with the seeds 0, 1, …

        All train on the source's reference.
        """
        splits = self.splits
        if isinstance(splits, int):
            draw = sequence_split if self.source.ordered else random_split
            splits = tuple(draw(self.source.count, seed) for seed in range(splits))
        return tuple(self.source.with_reference(split) for split in splits)


@dataclass(frozen=True)
class Training:
    """One training of one method.

    Args:
        source: the data set.
        split: indices of the training shapes and of the test shapes.
        number: index of the split, which is also the seed of the training.
        method: name of the method.
        components: number K of components; 0 for a method without components.
        noise: standard deviation of the noise that is added to each coordinate of the training
            shapes, in bounding diagonals of the reference.
        setting: settings of a network's training; other methods have none.
    """

    source: Source
    split: Split
    number: int
    method: str
    components: int
    noise: float = 0.0
    setting: Setting = field(default_factory=Setting)

    @property
    def key(self) -> str:
        """Hash of everything that the trained method depends on."""
        return _digest(method=self.method, **self._identity())

    @property
    def network(self) -> str | None:
        """Hash of everything that the method's network depends on; None if it trains no network.

        Methods with the same hash share a network, which only one process may train at a time.
        """
        if self.method not in NETWORKS:
            return None
        return _digest(config=NETWORKS[self.method].config, **self._identity())

    def _identity(self) -> dict[str, Any]:
        """Training shapes and settings, as values that JSON can store."""
        return {
            "source": [self.source.fingerprint, self.source.align],
            "train": self.split.train,
            "components": self.components,
            "seed": self.number,
            "noise": self.noise,
            "setting": asdict(self.setting),
        }

    @property
    def label(self) -> str:
        """Description in progress lines and messages of failures."""
        parts = [self.source.name, self.method]
        parts += [f"K {self.components}"] if self.components else []
        parts += [f"noise {self.noise:.1%}"] if self.noise else []
        parts += [self.setting.label] if self.setting.label else []
        return ", ".join([*parts, f"split {self.number}"])


@dataclass(frozen=True)
class Measurement:
    """One measurement of a trained method; its result has one or several rows.

    Args:
        kind: what is measured.
        test: indices of the test shapes.
        count: number of control points; for kinds without control points, number K of components.
        seed: seed that the rows name; it also draws the first control point.
        noise: standard deviation of the noise that is added to each coordinate of the control
            points, in bounding diagonals of the reference; the method is told it.
        layout: the control vertices, or the training of the network that chooses them; None for
            Voronoi sampling.
    """

    kind: Kind
    test: tuple[int, ...]
    count: int
    seed: int
    noise: float = 0.0
    layout: tuple[int, ...] | Training | None = None

    def key(self, training: Training) -> str:
        """Hash of everything that the rows of this measurement after a training depend on."""
        source, layout = training.source, self.layout
        return _digest(
            training=training.key,
            measurement=asdict(replace(self, layout=None)),
            layout=layout.key if isinstance(layout, Training) else layout,
            name=source.name,
            ordered=source.ordered,
        )

    def protocol(self, training: Training) -> str:
        """Name of the protocol in the rows, without the suffix of a part ("/encoder", "/fit")."""
        name: str = self.kind if self.layout is None else f"layout/{self.kind}"
        if training.setting.lambdas:
            tried = "sensitivity({:g},{:g})".format(*training.setting.lambdas)
            return tried if name == "reconstruction" else f"{tried}/{name}"
        if self.noise:
            name = f"noisy_control({self.noise:g})/{name}"
        return f"noise({training.noise:g})/{name}" if training.noise else name


@dataclass(frozen=True)
class Job:
    """A training, and the measurements of the method that it trains."""

    training: Training
    measurements: tuple[Measurement, ...]

    @property
    def networks(self) -> set[str]:
        """`Training.network` of all networks that the job trains or loads."""
        layouts = (measurement.layout for measurement in self.measurements)
        trainings = {self.training, *(one for one in layouts if isinstance(one, Training))}
        return {training.network for training in trainings if training.network is not None}


def make_plan(studies: list[Study]) -> list[Job]:
    """Jobs of all studies.

    Args:
        studies: what is to be measured: shapes, methods, protocols, splits.

    Returns:
        One job a training, with the measurements of every protocol and study that needs it.
    """
    measurements: dict[Training, dict[Measurement, None]] = {}
    for study in studies:
        for training, measurement in _measurements(study):
            measurements.setdefault(training, {})[measurement] = None
    return [
        Job(training, (Measurement("training", (), training.components, training.number), *found))
        for training, found in measurements.items()
    ]


def _measurements(study: Study) -> list[tuple[Training, Measurement]]:
    found: list[tuple[Training, Measurement]] = []
    for number, split in enumerate(study.drawn_splits()):
        test = limit_test_shapes(split.test, study.tests, study.source.ordered)
        for method in study.methods:
            components = study.at if has_components(method) else 0
            setting = _setting(study, method)
            base = Training(study.source, split, number, method, components, setting=setting)
            found += _measurements_of_method(study, base, test)
    return found


def _measurements_of_method(
    study: Study, base: Training, test: tuple[int, ...]
) -> list[tuple[Training, Measurement]]:
    encodes, K, number = has_components(base.method), base.components, base.number
    found: list[tuple[Training, Measurement]] = []

    def add(training: Training, kind: Kind, count: int, seed: int = number, **options: Any):
        found.append((training, Measurement(kind, test, count, seed, **options)))

    def control(
        training: Training, counts: tuple[int, ...] = study.counts, noise: float = 0.0
    ) -> None:
        for draw in range(study.seeds):
            # Seeds of different splits differ: split n of S has the seeds n, n + S, n + 2 S, …
            seed = number + draw * len(study.drawn_splits())
            for count in counts:
                add(training, "sparse_control", count, seed, noise=noise)

    for protocol in study.protocols:
        if protocol == "reconstruction" and encodes:
            for k in (K,) if base.method == "model" else study.components:
                add(replace(base, components=k), protocol, k)
        elif protocol == "rotation" and encodes:
            add(base, protocol, K)
        elif protocol == "sparse_control":
            control(base)
        elif protocol == "layout":
            counts = (len(study.layout),) if study.layout else study.counts
            control(base, counts)
            for count in counts:
                layout = study.layout or _chooser(study, base)
                add(base, "sparse_control", count, layout=layout)
        elif protocol == "noise":
            for noise in NOISE:
                if base.method != "model":
                    noisy = replace(base, noise=noise)
                    if encodes:
                        add(noisy, "reconstruction", K)
                    control(noisy)
                control(base, noise=noise)
        elif protocol == "sensitivity" and base.method == LAMBDA_METHOD:
            add(base, "reconstruction", K)
            for lambdas in LAMBDAS:
                tried = replace(base, setting=replace(base.setting, lambdas=lambdas))
                add(tried, "reconstruction", K)
    if study.pictures and number == 0:
        add(base, "example", EXAMPLE_COUNT)
    return found


def _chooser(study: Study, base: Training) -> Training:
    """The training whose model chooses the control vertices of a training's split."""
    method = LAYOUT_METHOD if study.model is None else "model"
    return replace(base, method=method, components=study.at, setting=_setting(study, method))


def _setting(study: Study, method: str) -> Setting:
    if method == "model" and study.model is not None:
        return study.model
    if method not in NETWORKS or study.epochs is None:
        return Setting()
    default = PRESETS[NETWORKS[method].config].training.epochs
    return Setting(epochs=study.epochs if study.epochs < default else None)


def _digest(**facts: Any) -> str:
    text = json.dumps({"version": _VERSION, **facts}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:20]
