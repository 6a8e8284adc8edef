"""Component analysis: the effect of each latent component, where it acts, and its correlations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deformer.analysis.activations import Activations
from deformer.checks import checked_integer
from deformer.geometry import FloatArray, Mesh, vertex_errors
from deformer.model import DeformationModel

# A component's support: the vertices with weights of at least this share of its largest.
SUPPORT_THRESHOLD = 0.1


@dataclass(frozen=True)
class Component:
    """Measures of one component.

    Args:
        index: k, the entry of the latent code.
        label: its name, or "component 3".
        strength: distance of its representative shape's features from the reference's, in the
            network's units; see `Activations`.
        motion: largest distance of a vertex of the representative shape from the decoded
            reference, in the data's own units.
        low: least activation among the training codes.
        high: greatest activation among the training codes.
        reference: activation of the reference.
        extreme: activation of the representative shape.
        centre: vertex with the largest weight.
        support: number of vertices with at least a tenth of the largest weight.
        extent: greatest geodesic distance from the centre to a vertex of the support, as a share
            of the mesh's extent.
        partner: component whose activations correlate most with this one's over the training
            codes, in magnitude; −1 if no other component's do.
        partner_correlation: the correlation with `partner`, −1 to 1; 0 without one.
        extreme_shapes: training shapes whose activation is farthest from the reference's, the
            farthest first: indices into the shapes that the model was trained from.
    """

    index: int
    label: str
    strength: float
    motion: float
    low: float
    high: float
    reference: float
    extreme: float
    centre: int
    support: int
    extent: float
    partner: int
    partner_correlation: float
    extreme_shapes: tuple[int, ...]


class ComponentAnalysis:
    """Measures of all components of a model, each computed on first use.

    Args:
        model: the prior.
        extreme_count: number of training shapes in `Component.extreme_shapes`.

    Attributes:
        activations: extremes, strengths and supports.

    Raises:
        InputError: `extreme_count` is negative.
    """

    def __init__(self, model: DeformationModel, extreme_count: int = 3) -> None:
        """Find extremes and strengths."""
        checked_integer(extreme_count, "extreme_count", least=0)
        self.model = model
        self.activations = Activations(model)
        self._extreme_count = extreme_count

    @cached_property
    def correlations(self) -> FloatArray:
        """Correlations (K, K) of activations over the training codes; 0 for constant ones."""
        return activation_correlations(self.model.codes)

    @cached_property
    def rest(self) -> Mesh:
        """The decoded reference, from which motions are measured."""
        return self._mesh(self.activations.reference)

    def shape(self, component: int) -> Mesh:
        """The representative shape of a component.

        Args:
            component: index k, from 0.

        Raises:
            InputError: no such component.
        """
        return self._mesh(self.activations.representative(component))

    def ranked(self, count: int | None = None) -> list[Component]:
        """The `count` strongest components, or all, from the strongest to the weakest."""
        if count is not None:
            checked_integer(count, "count", least=0)
        return [self.describe(int(k)) for k in self.activations.order[:count]]

    def describe(self, component: int) -> Component:
        """Measures of one component.

        Args:
            component: index k, from 0.

        Raises:
            InputError: no such component.
        """
        k, activations, model = component, self.activations, self.model
        weights = activations.support(k)
        centre = int(weights.argmax())
        support = np.flatnonzero(weights >= SUPPORT_THRESHOLD)
        distances = model.geodesics.normalised_row(int(model.seams.closed[centre]))
        distances = distances[model.seams.closed[support]]
        correlation = np.abs(self.correlations[k])
        correlation[k] = 0.0
        partner = int(correlation.argmax()) if correlation.any() else -1
        difference = np.abs(model.codes[:, k] - activations.reference[k])
        farthest = np.argsort(-difference, kind="stable")[: self._extreme_count]
        motion = vertex_errors(self.rest.vertices, self.shape(k).vertices)
        return Component(
            index=k,
            label=model.label(k),
            strength=float(activations.strength[k]),
            motion=float(motion.max()),
            low=float(activations.low[k]),
            high=float(activations.high[k]),
            reference=float(activations.reference[k]),
            extreme=float(activations.extreme[k]),
            centre=centre,
            support=len(support),
            extent=float(distances.max()),
            partner=partner,
            partner_correlation=float(self.correlations[k, partner]) if partner >= 0 else 0.0,
            extreme_shapes=tuple(int(model.split["train"][row]) for row in farthest),
        )

    def _mesh(self, z: FloatArray) -> Mesh:
        return Mesh(self.model.decode(z), self.model.reference.faces)


def activation_correlations(codes: FloatArray) -> FloatArray:
    """Correlations (K, K) of the columns of latent codes (N, K); 0 for constant columns."""
    deviation = codes - codes.mean(axis=0)
    length = np.linalg.norm(deviation, axis=0)
    # A constant column may differ from its mean by rounding; it still counts as constant.
    changes = length > 1e-9 * np.linalg.norm(codes)
    unit = np.divide(deviation, length, out=np.zeros_like(deviation), where=changes)
    return unit.T @ unit
