"""The handles of a sequence: targets, weights and orientations of each handle in each frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import LARGEST, checked_array, checked_instance
from deformer.editing.batch_numba import Boolean
from deformer.editing.handles import (
    Kind,
    Point,
    check_handles,
    check_kinds,
    check_points,
    closed_point,
)
from deformer.editing.orientations import LocalFrames, checked_orientations, turned_by
from deformer.errors import InputError
from deformer.geometry import FloatArray, RowPoint
from deformer.model import DeformationModel


@dataclass(frozen=True, eq=False)
class Rows:
    """What the energy of F frames has of their handles.

    Args:
        points: R points.
        targets: (F, R, 3) their targets.
        weights: (F, R) factors on their squared distances; 0 where a frame has none.
        exact: (F, R) true where a frame has the point at its target exactly.
        used: (F, R) true where the point is one by which the frame has a handle, seen or not: the
            handle's own point, or, in frames that turn it, those of its local frame.
    """

    points: list[RowPoint]
    targets: FloatArray
    weights: FloatArray
    exact: Boolean
    used: Boolean


@dataclass(frozen=True, eq=False)
class Tracks:
    """H handles in F frames.

    Args:
        points: the handles, on the surface without seams.
        targets: (F, H, 3) positions.
        weights: (F, H) factors on squared distances; 0 where a handle is not seen.
        exact: (F, H) true where a handle is at its target exactly.
        orientations: (F, H, 3, 3) rotations, NaN where a handle has none.
        orientation_weights: (H,) factors on squared errors of the orientations.
    """

    points: list[Point]
    targets: FloatArray
    weights: FloatArray
    exact: Boolean
    orientations: FloatArray
    orientation_weights: FloatArray

    @property
    def _turns(self) -> Boolean:
        """True where a handle has an orientation, (F, H)."""
        return ~np.isnan(self.orientations[..., 0, 0])

    def rows(self, frames: LocalFrames) -> Rows:
        """The points of all handles: each itself, or its local frame in frames that turn it."""
        turns, points = self._turns, list[RowPoint]()
        targets, weights, owners, used = [], [], [], []
        for h, point in enumerate(self.points):
            turned = turns[:, h]
            if not turned.all():
                points.append(point)
                targets.append(self.targets[:, h])
                weights.append(np.where(turned, 0.0, self.weights[:, h]))
                owners.append(h)
                used.append(~turned)
            if turned.any():
                frame = frames.of(point, float(self.orientation_weights[h]))
                R = np.where(turned[:, None, None], self.orientations[:, h], 0.0)
                goals = frame.targets(self.targets[:, h], R)
                points += frame.points
                targets += list(goals.transpose(1, 0, 2))
                weights += 3 * [np.where(turned, self.weights[:, h] / 3, 0.0)]
                owners += 3 * [h]
                used += 3 * [turned]
        F, R = len(self.weights), len(points)
        w = np.array(weights).reshape(R, F).T.copy()
        exact = self.exact[:, owners].reshape(F, R) & (w > 0)
        goals = np.array(targets).reshape(R, F, 3).transpose(1, 0, 2).copy()
        return Rows(points, goals, w, exact, np.array(used, dtype=bool).reshape(R, F).T)

    def turned(self, frames: LocalFrames, vertices: FloatArray) -> FloatArray:
        """Angles (F, H) from the rotation of shapes (F, V, 3) at each handle to its orientation.

        NaN where a handle has no orientation.
        """
        found = np.full(self.weights.shape, np.nan)
        turns = self._turns
        for h in np.flatnonzero(turns.any(axis=0)):
            frame, f = frames.of(self.points[h]), turns[:, h]
            found[f, h] = turned_by(frame.rotation(vertices)[f], self.orientations[f, h])
        return found


def checked_tracks(
    model: DeformationModel,
    vertices: ArrayLike | Sequence[Point],
    targets: ArrayLike,
    weights: ArrayLike | None,
    hard: ArrayLike,
    kinds: Kind | Sequence[Kind] | None,
    orientations: Any,
    orientation_weights: ArrayLike | None,
) -> Tracks:
    """Check the arguments of `fit_sequence`, which names what is raised."""
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    goals = checked_array(targets, "targets", finite=False)
    index = check_points(model, vertices)
    count = len(index)
    if goals.ndim != 3 or goals.shape[1:] != (count, 3) or len(goals) == 0:
        raise InputError(f"targets: expected (F, {count}, 3), one frame or more, got {goals.shape}")
    F, H, _ = goals.shape
    factors = np.ones(H) if weights is None else checked_array(weights, "weights", finite=False)
    if factors.shape not in ((H,), (F, H)):
        raise InputError(f"weights: expected ({F}, {H}) or ({H},), got {factors.shape}")
    factors = np.broadcast_to(factors, (F, H))
    if not ((factors >= 0) & (factors <= LARGEST)).all():
        frame, h = np.argwhere(~((factors >= 0) & (factors <= LARGEST)))[0]
        raise InputError(f"frame {frame}, handle {h}: weight {factors[frame, h]} is not 0 or more")
    unseen = factors == 0
    bad = ~np.isfinite(goals).all(axis=2) & ~unseen
    if bad.any():
        frame, h = np.argwhere(bad)[0]
        raise InputError(
            f"frame {frame}, handle {h}: target {goals[frame, h].tolist()} is not finite; "
            "give a marker that is not seen the weight 0"
        )
    goals = np.where(unseen[:, :, None], 0.0, goals)
    check_handles(model, index, goals[0], None, False)
    closed = [closed_point(model, point) for point in index]
    if len(set(closed)) < H:
        repeated = next(p for p, c in zip(index, closed, strict=True) if closed.count(c) > 1)
        raise InputError(f"vertex {repeated} is given twice; a sequence wants different vertices")
    exact = ~unseen & (check_kinds(hard, kinds, (F, H)) != "soft")
    turns = checked_orientations(orientations, orientation_weights, (F, H))
    return Tracks(closed, goals, factors, exact, *turns)
