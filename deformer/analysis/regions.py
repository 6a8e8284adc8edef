"""Regions: groups of a model's components that act on the same part of the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from deformer.analysis.activations import Activations
from deformer.analysis.components import SUPPORT_THRESHOLD
from deformer.checks import checked_instance, checked_number
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.model import DeformationModel


@dataclass(frozen=True, eq=False)
class ComponentRegion:
    """Components that act on the same part of the surface.

    Args:
        components: their indices, from the strongest to the weakest.
        support: (V,) the largest of their weights at every vertex, 0 to 1.
        centre: (3,) mean of the reference's vertices, weighted by the sum of their weights.
    """

    components: tuple[int, ...]
    support: FloatArray
    centre: FloatArray


def component_regions(
    model: DeformationModel, activations: Activations | None = None, overlap: float = 0.4
) -> list[ComponentRegion]:
    """Groups of components whose supports overlap; every component is in exactly one.

    The overlap of two components is the cosine between their weights at all vertices, of which
    those below a tenth count as zero: 1 for equal supports, 0 for disjoint ones. Groups are merged
    in order of their average overlap (average linkage) while it is at least `overlap`.

    Args:
        model: the prior.
        activations: of that model; None measures them.
        overlap: the smallest average overlap within a group, above 0 and up to 1.

    Returns:
        The regions, in order of their strongest components.

    Raises:
        InputError: `overlap` is out of range, or the activations are another model's.
    """
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    checked_number(overlap, "overlap", above=0, most=1)
    if activations is None:
        activations = Activations(model)
    checked_instance(activations, "activations", Activations, remedy="make them of the model")
    order = activations.order.tolist()
    if len(order) != model.components or len(activations.support(0)) != len(
        model.reference.vertices
    ):
        raise InputError("activations: expected those of this model, got another model's")
    supports = np.stack([activations.support(k) for k in order])
    supports[supports < SUPPORT_THRESHOLD] = 0.0
    labels = _groups(supports, overlap)
    regions = []
    for label in dict.fromkeys(labels.tolist()):  # in order of their strongest components
        rows = np.flatnonzero(labels == label)
        total = supports[rows].sum(axis=0)
        weights = total / total.sum() if total.any() else np.full(len(total), 1.0 / len(total))
        regions.append(
            ComponentRegion(
                tuple(order[row] for row in rows),
                supports[rows].max(axis=0),
                weights @ model.reference.vertices,
            )
        )
    return regions


def _groups(supports: FloatArray, overlap: float) -> IntArray:
    """Labels (K,) of components with weights (K, V), equal within a group."""
    if len(supports) < 2:
        return np.zeros(len(supports), dtype=np.int64)
    length = np.linalg.norm(supports, axis=1, keepdims=True)
    unit = np.divide(supports, length, out=np.zeros_like(supports), where=length > 0)
    distance = np.clip(1.0 - unit @ unit.T, 0.0, 1.0)
    np.fill_diagonal(distance, 0.0)
    tree = linkage(squareform(distance, checks=False), "average")
    # Rounding must not separate components of equal supports.
    return fcluster(tree, 1.0 - overlap + 1e-9, "distance")
