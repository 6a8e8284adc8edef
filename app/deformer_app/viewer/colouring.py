"""Colourings of the surface: values, captions and limits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import DeformationModel, Pose, Uncertainty, vertex_errors

# Name → title for the user.
COLOURINGS = {
    "plain": "Plain",
    "displacement": "Displacement",
    "stretch": "Stretch",
    "component": "Component",
    "error": "Error against the target",
    "uncertainty": "Next handle",
}


@dataclass(frozen=True, eq=False)
class Paint:
    """Values that colour the surface.

    Args:
        values: (V,) of vertices or (F,) of faces.
        on: "vertices" or "faces", the elements that have the values.
        title: caption, with the unit.
        limits: values at the ends of the scale.
        diverging: true where the middle of the scale means zero.
    """

    values: NDArray[np.float64]
    on: Literal["vertices", "faces"]
    title: str
    limits: tuple[float, float]
    diverging: bool = False


def component_paint(activations: deformer.Activations, number: int, label: str) -> Paint:
    """Return the colours of a component's support."""
    return Paint(activations.support(number), "vertices", label, (0.0, 1.0))


class Colouring:
    """Colours of poses of one model, by name; "component:3" is the support of component 3."""

    def __init__(self, model: DeformationModel) -> None:
        """Store the model; each colouring is prepared at its first use."""
        self._model = model

    @cached_property
    def _strain(self) -> deformer.FaceStrain:
        return deformer.FaceStrain(self._model.reference)

    def __call__(
        self,
        name: str,
        pose: Pose,
        target: NDArray[np.float64] | None = None,
        activations: deformer.Activations | None = None,
        component_label: str = "",
    ) -> Paint | None:
        """Return the colours of a pose, or None where `name` has none for it (yet).

        Args:
            name: see `COLOURINGS`.
            pose: the pose to colour.
            target: vertices (V, 3) from which "error" measures distances.
            activations: supports of the components, for "component:k".
            component_label: name of component k, for people.
        """
        kind, _, number = name.partition(":")
        reference = self._model.reference
        if kind == "displacement":
            moved = vertex_errors(reference.vertices, pose.vertices)
            limit = max(float(moved.max()), 0.05 * reference.bounding_diagonal)
            return Paint(moved, "vertices", "displacement\n(model units)", (0.0, limit))
        if kind == "stretch":
            signed = self._strain.signed(pose.vertices)
            return Paint(signed, "faces", "stretch (log2)", (-1.0, 1.0), diverging=True)
        if kind == "component" and activations is not None:
            return component_paint(activations, int(number), component_label)
        if kind == "error" and target is not None:
            errors = vertex_errors(target, pose.vertices)
            limit = max(float(np.quantile(errors, 0.99)), 1e-3 * reference.bounding_diagonal)
            return Paint(errors, "vertices", "distance to target\n(model units)", (0.0, limit))
        return None

    def of_uncertainty(self, found: Uncertainty) -> Paint:
        """Return the colours of the reduction of uncertainty by another handle at each vertex."""
        percent = 100.0 * found.gain
        return Paint(percent, "vertices", "% uncertainty", (0.0, max(float(percent.max()), 1.0)))
