"""Warnings of targets that are most likely a mistake."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from deformer.editing.handles import Kind, Point, closed_point
from deformer.editing.units import unit_warning
from deformer.geometry import FloatArray
from deformer.model import DeformationModel

_log = logging.getLogger("deformer")

# Targets that are no farther apart, in bounding diagonals, are one.
_SAME_TARGET = 1e-9
# Moves, in bounding diagonals, after which the units are examined anew.
_DRAGGED = 0.1


class TargetWarnings:
    """Logs what is most likely wrong with targets, unless the targets before had the same warning.

    Args:
        model: the model whose points are to be at the targets.
    """

    def __init__(self, model: DeformationModel) -> None:
        """Begin without a warning."""
        self._model = model
        self._last: dict[str, str | None] = {}
        # Points and targets that were examined last.
        self._examined: tuple[list[Point], FloatArray] = [], np.zeros((0, 3))

    def of_units(self, points: Sequence[Point], targets: FloatArray) -> None:
        """Log the `unit_warning` of targets; short moves of them change no units."""
        before, there = self._examined
        near = _DRAGGED * self._model.reference.bounding_diagonal
        same = list(points) == before and targets.shape == there.shape
        if same and (np.abs(targets - there) <= near).all():
            return
        self._examined = list(points), targets.copy()
        self._tell("units", unit_warning(self._model, points, targets))

    def of_contradictions(
        self, points: Sequence[Point], targets: FloatArray, kinds: Sequence[Kind]
    ) -> None:
        """Log the `contradiction` of handles."""
        self._tell("contradiction", contradiction(self._model, points, targets, kinds))

    def _tell(self, about: str, warning: str | None) -> None:
        if warning is not None and warning != self._last.get(about):
            _log.warning(warning)
        self._last[about] = warning


def contradiction(
    model: DeformationModel, points: Sequence[Point], targets: FloatArray, kinds: Sequence[Kind]
) -> str | None:
    """A warning if exact handles at one place of the surface have different targets; else None.

    Args:
        model: the model whose points they are.
        points: H checked points.
        targets: (H, 3) positions.
        kinds: H kinds.
    """
    first: dict[Point, int] = {}
    for h, point in enumerate(points):
        if kinds[h] == "soft":
            continue
        other = first.setdefault(closed_point(model, point), h)
        apart = float(np.linalg.norm(targets[h] - targets[other]))
        if apart > _SAME_TARGET * model.reference.bounding_diagonal:
            return (
                f"handles {other} and {h}, at {points[other]} and {points[h]}, are one point of "
                f"the surface, but their targets are {apart:.3g} apart; it goes to their mean"
            )
    return None
