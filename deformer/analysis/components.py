"""Component analysis: what each latent component of a model does, where, and with which others."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deformer.analysis.activations import Activations
from deformer.errors import InputError
from deformer.geometry import FloatArray, Mesh, vertex_errors
from deformer.model import DeformationModel

# A component acts where its weights are at least this share of its largest.
SUPPORTED = 0.1


@dataclass(frozen=True)
class Component:
    """What is known of one component.

    Args:
        index: k, the entry of the latent code.
        label: its name, or "component 3".
        strength: distance of its representative shape's features from the reference's, in the
            network's units; see `Activations`.
        motion: largest distance of a vertex of the representative shape from the reference as it
            is decoded, in the data's own units.
        low, high, reference, extreme: least and greatest activation among the training codes, that
            of the reference, and that of the representative shape.
        centre: vertex with the largest weights.
        support: vertices with at least a tenth of them.
        extent: greatest geodesic distance from the centre to one of those, as a share of the
            mesh's own extent; vertices that no path leads to are left out.
        partner: component whose activations go most with this one's over the training codes, and
            −1 where there is none.
        sharing: their correlation, −1 to 1.
        users: training shapes whose activation is farthest from the reference's, the farthest
            first: indices into the shapes that the model was trained from.
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
    sharing: float
    users: tuple[int, ...]


class ComponentAnalysis:
    """All components of a model, measured when they are asked for.

    Args:
        model: the prior.
        users: how many training shapes to name for each component.

    Attributes:
        activations: extremes, strengths and supports.

    Raises:
        InputError: `users` is negative.
    """

    def __init__(self, model: DeformationModel, users: int = 3) -> None:
        """Find extremes and strengths."""
        if users < 0:
            raise InputError(f"users: expected 0 or more training shapes, got {users}")
        self.model = model
        self.activations = Activations(model)
        self._users = users

    @cached_property
    def sharing(self) -> FloatArray:
        """Correlations (K, K) of activations over the training codes; 0 where one never changes."""
        return activation_sharing(self.model.codes)

    @cached_property
    def rest(self) -> Mesh:
        """The reference as it is decoded, from which motions are measured."""
        return self._mesh(self.activations.reference)

    def shape(self, component: int) -> Mesh:
        """The representative shape of a component."""
        return self._mesh(self.activations.representative(component))

    def ranked(self, count: int | None = None) -> list[Component]:
        """The `count` strongest components, or all, from the strongest to the weakest."""
        return [self.describe(int(k)) for k in self.activations.order[:count]]

    def describe(self, component: int) -> Component:
        """What is known of one component.

        Raises:
            InputError: no such component.
        """
        k, acts, model = component, self.activations, self.model
        weights = acts.support(k)
        centre = int(weights.argmax())
        acting = np.flatnonzero(weights >= SUPPORTED)
        away = model.geodesics.normalised_row(centre)[acting]
        shared = np.abs(self.sharing[k])
        shared[k] = 0.0
        partner = int(shared.argmax()) if shared.any() else -1
        use = np.abs(model.codes[:, k] - acts.reference[k])
        farthest = np.argsort(-use, kind="stable")[: self._users]
        moved = vertex_errors(self.rest.vertices, self.shape(k).vertices)
        return Component(
            index=k,
            label=model.label(k),
            strength=float(acts.strength[k]),
            motion=float(moved.max()),
            low=float(acts.low[k]),
            high=float(acts.high[k]),
            reference=float(acts.reference[k]),
            extreme=float(acts.extreme[k]),
            centre=centre,
            support=len(acting),
            extent=float(away[np.isfinite(away)].max()),
            partner=partner,
            sharing=float(self.sharing[k, partner]) if partner >= 0 else 0.0,
            users=tuple(int(model.split["train"][row]) for row in farthest),
        )

    def _mesh(self, z: FloatArray) -> Mesh:
        return Mesh(self.model.decode(z), self.model.reference.faces)


def activation_sharing(codes: FloatArray) -> FloatArray:
    """Correlations (K, K) of the columns of latent codes (N, K); 0 where one never changes."""
    away = codes - codes.mean(axis=0)
    length = np.linalg.norm(away, axis=0)
    # What is left of a constant by rounding is no change.
    changes = length > 1e-9 * np.linalg.norm(codes)
    unit = np.divide(away, length, out=np.zeros_like(away), where=changes)
    return unit.T @ unit
