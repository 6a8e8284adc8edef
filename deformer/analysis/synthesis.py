"""New shapes: from weights of components, drawn from the prior, transferred to another model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from deformer.acap import undisplaced
from deformer.analysis.activations import Activations
from deformer.analysis.familiarity import Familiarity
from deformer.checks import (
    LARGEST,
    check_memory,
    checked_array,
    checked_choice,
    checked_instance,
    checked_integer,
    checked_number,
    shortened,
)
from deformer.errors import InputError
from deformer.geometry import FloatArray
from deformer.model import DeformationModel

BlendSpace = Literal["latent", "features", "linear"]
"""What is linear in the weights: latent codes, features, or vertex positions."""
BLEND_SPACES: tuple[BlendSpace, ...] = ("latent", "features", "linear")

# Component (its index or its name) → weight. The keys are Any, since Mapping is invariant in its
# keys: a dict[int, float] is no Mapping[int | str, float].
Weights = Mapping[Any, float]


class Synthesis:
    """New shapes from a weight for each component (Tan et al. 2018, equation 9).

    Entry k of the code is z_k = start_k + w_k (Z_k,h − Z_k,r). Weight 0 leaves the start as it is;
    with the reference as start, weight 1 gives the component's representative shape.

    Args:
        model: the prior.
        start: (K,) code of the shape to start from; None is the reference's.

    Raises:
        InputError: `start` is not (K,) or not finite.
    """

    def __init__(self, model: DeformationModel, start: ArrayLike | None = None) -> None:
        """Find the components' extremes."""
        self.model = model
        self.activations = Activations(model)
        chosen = self.activations.reference if start is None else start
        self.start = checked_array(chosen, "start", (model.components,), largest=LARGEST).copy()

    def code(self, weights: Weights) -> FloatArray:
        """Latent code (K,) of weights of components.

        Args:
            weights: component (index or name) → weight w_k; the others have the weight 0.

        Raises:
            InputError: no such component, one given twice (by index and by name), a weight that is
                not finite.
        """
        # z_k = start_k + (Z_k,h − Z_k,r) w_k (Tan et al. 2018, equation 9)
        span = self.activations.extreme - self.activations.reference
        return self.start + self._vector(weights) * span

    def shape(self, weights: Weights, space: BlendSpace = "latent") -> FloatArray:
        """Vertices (V, 3) of weights of components.

        Args:
            weights: component (index or name) → weight w_k.
            space: "latent" decodes the code. "features" and "linear" are linear counterparts, for
                comparison: they add w_k times the difference of each representative shape from
                the reference, in features or in vertex positions.

        Raises:
            InputError: as `code`, or an unknown space.
        """
        model, acts = self.model, self.activations
        check_blend_space(space)
        if space == "latent":
            return model.decode(self.code(weights))
        w = self._vector(weights)
        used = np.flatnonzero(w)
        if space == "features":
            q = model.decoder.features(self.start)
            for k in used:
                q = q + w[k] * acts.change(int(k))
            p = model.poisson.reconstruct(q) + model.centroid_offset(self.code(weights))
            return model.seams.open(p)
        p, rest = model.decode(self.start), model.decode(acts.reference)
        for k in used:
            p = p + w[k] * (model.decode(acts.representative(int(k))) - rest)
        return p

    def sweep(
        self,
        component: int | str,
        values: ArrayLike,
        weights: Weights | None = None,
        space: BlendSpace = "latent",
    ) -> FloatArray:
        """Vertices (n, V, 3) for n weights of one component, with the other weights fixed.

        Args:
            component: index or name of the component.
            values: (n,) its weights.
            weights: component (index or name) → weight of the others; None is 0 for all.
            space: as in `shape`.

        Raises:
            InputError: as `shape`.
        """
        k = self.model.component(component)
        given = {} if weights is None else weights
        checked_instance(given, "weights", Mapping, remedy="give a dict")
        fixed = {self.model.component(key): w for key, w in given.items()}
        steps = np.atleast_1d(checked_array(values, "values", (), ("n",), largest=LARGEST))
        V = len(self.model.reference.vertices)
        check_memory(2 * 24 * V * len(steps), f"values: {len(steps)} shapes of {V} vertices")
        check_blend_space(space)
        shapes = [self.shape({**fixed, k: float(w)}, space) for w in steps]
        return np.array(shapes).reshape(-1, V, 3)

    def _vector(self, weights: Weights) -> FloatArray:
        w = np.zeros(self.model.components)
        seen: dict[int, int | str] = {}
        if not isinstance(weights, Mapping):
            raise InputError(
                f"weights: expected component → weight, got {shortened(weights)}; give a dict"
            )
        for key, value in weights.items():
            k = self.model.component(key)
            if k in seen:
                raise InputError(f"weights: {seen[k]!r} and {key!r} are one component; give one")
            seen[k] = key
            w[k] = checked_number(value, f"weight of {key!r}", largest=LARGEST)
        return w


def draw_codes(
    model: DeformationModel, count: int, seed: int = 0, bound: float = 1.0
) -> FloatArray:
    """Random latent codes (count, K) from the Gaussian prior, near the examples.

    A draw that is farther than `bound` from every training code is moved straight towards the
    nearest one, up to that distance.

    Args:
        model: the prior.
        count: number of codes.
        seed: of the random generator.
        bound: greatest distance of a code from the nearest example, as of `Familiarity.nearest`: 1
            is as far as unseen examples are, 0 gives training codes.

    Raises:
        InputError: `count` or `bound` is negative.
    """
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    checked_integer(count, "count", least=0)
    checked_integer(seed, "seed", least=0)
    if not (isinstance(bound, float) and bound == np.inf):
        checked_number(bound, "bound", least=0)
    K, V = model.components, len(model.reference.vertices)
    check_memory(8 * count * (K + 6 * V), f"count: {count} shapes of {V} vertices")
    rng = np.random.default_rng(seed)
    prior, familiarity = model.prior, Familiarity(model)
    drawn = prior.mean + rng.normal(size=(count, model.components)) @ prior.factor.T
    for z in drawn:
        row, distance = familiarity.nearest(z)
        if distance > bound:
            example = model.codes[row]
            z[:] = example + bound / distance * (z - example)
    return drawn


def check_blend_space(space: str) -> None:
    """Raise InputError unless `space` is one of `BLEND_SPACES`."""
    checked_choice(space, "space", BLEND_SPACES)


def transfer(source: DeformationModel, target: DeformationModel, z: ArrayLike) -> FloatArray:
    """Reference of one model, deformed as a code of another model deforms that model's reference.

    Args:
        source: model of the code.
        target: model of the same connectivity, whose reference is deformed. Both references should
            be in the same pose, since the deformation relative to the reference is transferred.
        z: (K,) code of `source`.

    Returns:
        Vertices (V, 3) in the target's units; the centroid's offset is scaled by the ratio of the
        bounding diagonals. The target's prior has no influence; `transfer_code` respects it.

    Raises:
        InputError: the connectivities differ, or z is no code of `source`.
    """
    features = _source_features(source, target, z)
    p = target.poisson.reconstruct(features)
    size = target.reference.bounding_diagonal / source.reference.bounding_diagonal
    return target.seams.open(p + size * source.centroid_offset(np.asarray(z, dtype=np.float64)))


def transfer_code(source: DeformationModel, target: DeformationModel, z: ArrayLike) -> FloatArray:
    """Code (K',) with which `target` encodes the deformation of the code z (K,) of `source`.

    Arguments and errors are those of `transfer`.
    """
    features = _source_features(source, target, z)
    return target.encoder.encode(features[None])[0]


def _source_features(
    source: DeformationModel, target: DeformationModel, z: ArrayLike
) -> FloatArray:
    """Features (V+B, 9) of a code of `source`, after a check that the connectivities agree."""
    for name, model in (("source", source), ("target", target)):
        checked_instance(model, name, DeformationModel, remedy="load it with load_model")
    code = checked_array(z, "z", (source.components,), largest=LARGEST)
    if not np.array_equal(source.reference.faces, target.reference.faces):
        raise InputError(
            f"transfer: the models' connectivities differ ({len(source.reference.faces)} and "
            f"{len(target.reference.faces)} faces); both must be of one"
        )
    q = source.decoder.features(code)
    own, other = source.closed.reference, target.closed.reference
    if not np.array_equal(source.seams.closed, target.seams.closed):
        # A row of features is that of any of the vertices at one place.
        rows = source.seams.closed[target.seams.first]
    elif np.array_equal(own.links, other.links):
        return q
    else:
        rows = np.arange(len(own.vertices))
    return undisplaced(other, q[rows])
