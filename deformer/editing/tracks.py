"""The handles of some frames of a sequence: targets, weights and orientations in each frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deformer.editing.batch_numba import Boolean
from deformer.editing.handles import Point
from deformer.editing.orientations import LocalFrames, turned_by
from deformer.geometry import FloatArray, IntArray, RowPoint


@dataclass(frozen=True, eq=False)
class Rows:
    """What the energy of F frames has of their handles.

    Args:
        points: R points.
        targets: (F, R, 3) their targets.
        gaps: (F, R, 3) vectors to the targets from where the codes' shapes are to be.
        weights: (F, R) factors on their squared distances; 0 where a frame has none.
        exact: (F, R) true where a frame has the point at its target exactly.
        used: (F, R) true where the point is one by which the frame has a handle, seen or not: the
            handle's own point, or, in frames that turn it, those of its local frame.
    """

    points: list[RowPoint]
    targets: FloatArray
    gaps: FloatArray
    weights: FloatArray
    exact: Boolean
    used: Boolean

    def with_contacts(self, vertices: list[int]) -> tuple[Rows, IntArray]:
        """Return rows with some vertices, which no frame sees, and the indices of their points."""
        points = list(dict.fromkeys([*self.points, *vertices]))
        more = len(points) - len(self.points)

        def padded(values: NDArray) -> NDArray:
            return np.pad(values, [(0, 0), (0, more), *[(0, 0)] * (values.ndim - 2)])

        names = ("targets", "gaps", "weights", "exact", "used")
        arrays = {name: padded(getattr(self, name)) for name in names}
        index = np.array([points.index(vertex) for vertex in vertices], dtype=np.int64)
        return Rows(points, **arrays), index


@dataclass(frozen=True, eq=False)
class Tracks:
    """H handles in F frames, which may be some of a longer sequence.

    Args:
        points: the handles, on the surface without seams.
        targets: (F, H, 3) positions.
        gaps: (F, H, 3) vectors to them from where the codes' shapes are to be, as in `Handle`.
        weights: (F, H) factors on squared distances; 0 where a handle is not seen.
        exact: (F, H) true where a handle is at its target exactly.
        orientations: (F, H, 3, 3) rotations, NaN where a handle has none.
        orientation_weights: (H,) factors on squared errors of the orientations.
        always, ever: (H,) true for handles with an orientation in all frames of the sequence, and
            in any.
    """

    points: list[Point]
    targets: FloatArray
    gaps: FloatArray
    weights: FloatArray
    exact: Boolean
    orientations: FloatArray
    orientation_weights: FloatArray
    always: Boolean
    ever: Boolean

    @property
    def turns(self) -> Boolean:
        """True where a handle has an orientation, (F, H)."""
        return ~np.isnan(self.orientations[..., 0, 0])

    def rows(self, frames: LocalFrames) -> Rows:
        """The points of all handles: each itself, or its local frame in frames that turn it.

        The points are the same for all frames of a sequence.
        """
        turns, points = self.turns, list[RowPoint]()
        targets, weights, owners, used = [], [], [], []
        for h, point in enumerate(self.points):
            turned = turns[:, h]
            if not self.always[h]:
                points.append(point)
                targets.append(self.targets[:, h])
                weights.append(np.where(turned, 0.0, self.weights[:, h]))
                owners.append(h)
                used.append(~turned)
            if self.ever[h]:
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
        gaps = self.gaps[:, owners].reshape(F, R, 3)
        return Rows(points, goals, gaps, w, exact, np.array(used, dtype=bool).reshape(R, F).T)

    def turned(self, frames: LocalFrames, vertices: FloatArray) -> FloatArray:
        """Angles (F, H) from the rotation of shapes (F, V, 3) at each handle to its orientation.

        NaN where a handle has no orientation.
        """
        found = np.full(self.weights.shape, np.nan)
        turns = self.turns
        for h in np.flatnonzero(turns.any(axis=0)):
            frame, f = frames.of(self.points[h]), turns[:, h]
            found[f, h] = turned_by(frame.rotation(vertices)[f], self.orientations[f, h])
        return found
