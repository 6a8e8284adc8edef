"""The handles of a whole sequence, in memory or in files, which gives those of some frames."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer.checks import LARGEST, checked_array, checked_instance
from deformer.editing.batch_numba import Boolean
from deformer.editing.floor import Floor
from deformer.editing.handles import (
    Kind,
    Point,
    check_handles,
    check_kinds,
    check_points,
    closed_point,
)
from deformer.editing.orientations import checked_orientations
from deformer.editing.tracks import Tracks
from deformer.errors import InputError
from deformer.geometry import FloatArray
from deformer.model import DeformationModel
from deformer.workspace import Rows, StoredArray, slices

# Frames that are checked at once.
_PART = 512


@dataclass(frozen=True, eq=False)
class TrackSource:
    """H handles in F frames; `part` gives the handles of some frames.

    Args:
        points: the handles, on the surface without seams.
        targets: (F, H, 3).
        gaps: (F, H, 3), or None for zeros.
        weights: (F, H).
        exact: (F, H).
        orientations: (F, H, 3, 3), or None for none.
        orientation_weights: (H,).
        seen: (F,) number of handles that each frame sees.
        always, ever: as in `Tracks`.
        floor: targets under it count as if they were on it; None is none.
    """

    points: list[Point]
    targets: Rows
    gaps: Rows | None
    weights: Rows
    exact: Rows
    orientations: Rows | None
    orientation_weights: FloatArray
    seen: NDArray[np.int64]
    always: Boolean
    ever: Boolean
    floor: Floor | None = None

    def __len__(self) -> int:
        """Count the frames."""
        return len(self.targets)

    def above(self, floor: Floor | None) -> TrackSource:
        """The same handles, with targets that are not under a floor."""
        return replace(self, floor=floor)

    def part(self, frames: slice) -> Tracks:
        """The handles of the frames of a slice."""
        weights = np.asarray(self.weights[frames])
        F, H = weights.shape
        targets = np.where(weights[..., None] == 0, 0.0, self.targets[frames])
        if self.floor is not None:
            targets = self.floor.above(targets)
        return Tracks(
            self.points,
            targets,
            np.zeros((F, H, 3)) if self.gaps is None else np.asarray(self.gaps[frames]),
            weights,
            (weights > 0) & np.asarray(self.exact[frames]),
            np.full((F, H, 3, 3), np.nan)
            if self.orientations is None
            else np.asarray(self.orientations[frames]),
            self.orientation_weights,
            self.always,
            self.ever,
        )

    def frames(self, numbers: Sequence[int]) -> tuple[FloatArray, Boolean]:
        """Targets (n, H, 3) of single frames, and where they are seen (n, H)."""
        parts = [self.part(slice(n, n + 1)) for n in numbers]
        targets = np.concatenate([part.targets for part in parts])
        return targets, np.concatenate([part.weights for part in parts]) > 0

    def digest(self) -> str:
        """SHA-256 of all that the handles are."""
        found = hashlib.sha256(f"{self.points} {self.orientation_weights.tolist()}".encode())
        for frames in slices(len(self), _PART):
            part = self.part(frames)
            for values in (part.targets, part.gaps, part.weights, part.exact, part.orientations):
                found.update(np.ascontiguousarray(values).data)
        return found.hexdigest()


def checked_tracks(
    model: DeformationModel,
    vertices: ArrayLike | Sequence[Point],
    targets: ArrayLike | StoredArray,
    weights: ArrayLike | StoredArray | None,
    hard: ArrayLike | StoredArray,
    kinds: Kind | Sequence[Kind] | None,
    orientations: Any,
    orientation_weights: ArrayLike | None,
    gaps: ArrayLike | StoredArray | None,
) -> TrackSource:
    """Check the arguments of `fit_sequence`, which names what is raised."""
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    goals = _array(targets, "targets")
    index = check_points(model, vertices)
    H = len(index)
    if goals.ndim != 3 or goals.shape[1:] != (H, 3) or len(goals) == 0:
        raise InputError(f"targets: expected (F, {H}, 3), one frame or more, got {goals.shape}")
    F = len(goals)
    factors = np.ones(H) if weights is None else _array(weights, "weights")
    if factors.shape not in ((H,), (F, H)):
        raise InputError(f"weights: expected ({F}, {H}) or ({H},), got {factors.shape}")
    factors = _spread(factors, (F, H))
    seen = np.zeros(F, dtype=np.int64)
    for frames in slices(F, _PART):
        seen[frames] = _count_seen(frames.start, goals[frames], factors[frames])
    first = np.where(np.asarray(factors[:1])[..., None] == 0, 0.0, goals[:1])[0]
    check_handles(model, index, first, None, False)
    closed = [closed_point(model, point) for point in index]
    if len(set(closed)) < H:
        repeated = next(p for p, c in zip(index, closed, strict=True) if closed.count(c) > 1)
        raise InputError(f"vertex {repeated} is given twice; a sequence wants different vertices")
    exact = hard
    if not isinstance(exact, StoredArray):
        exact = check_kinds(exact, kinds, (F, H)) != "soft"
    elif kinds is not None:
        raise InputError("kinds: expected them or hard, got both; leave one out")
    elif exact.shape != (F, H):
        raise InputError(f"hard: expected ({F}, {H}), got {exact.shape}; give one a frame")
    turns, turn_weights, always, ever = _checked_turns(orientations, orientation_weights, F, H)
    apart = _checked_gaps(gaps, F, H)
    return TrackSource(
        closed, goals, apart, factors, exact, turns, turn_weights, seen, always, ever
    )


def _array(values: Any, name: str) -> Rows:
    return values if isinstance(values, StoredArray) else checked_array(values, name, finite=False)


def _spread(values: Rows, shape: tuple[int, ...]) -> Rows:
    """Values of all frames, where one frame's were given for all."""
    return values if isinstance(values, StoredArray) else np.broadcast_to(values, shape)


def _count_seen(start: int, goals: FloatArray, factors: FloatArray) -> NDArray[np.int64]:
    """Handles that each frame sees (F,); InputError for weights and targets that are none."""
    wrong = ~((factors >= 0) & (factors <= LARGEST))
    if wrong.any():
        frame, h = np.argwhere(wrong)[0]
        raise InputError(
            f"frame {start + frame}, handle {h}: weight {factors[frame, h]} is not 0 or more"
        )
    unseen = factors == 0
    bad = ~np.isfinite(goals).all(axis=2) & ~unseen
    if bad.any():
        frame, h = np.argwhere(bad)[0]
        raise InputError(
            f"frame {start + frame}, handle {h}: target {goals[frame, h].tolist()} is not finite; "
            "give a marker that is not seen the weight 0"
        )
    return (~unseen).sum(axis=1)


def _checked_turns(
    orientations: Any, weights: ArrayLike | None, F: int, H: int
) -> tuple[Rows | None, FloatArray, Boolean, Boolean]:
    """Orientations (F, H, 3, 3), weights (H,), and who has one in all frames and in any, (H,)."""
    always, ever = np.zeros((2, H), dtype=bool)
    if orientations is None:
        return None, checked_orientations(None, weights, (0, H))[1], always, ever
    if not isinstance(orientations, StoredArray):
        turns, factors = checked_orientations(orientations, weights, (F, H))
        turned = ~np.isnan(turns[..., 0, 0])
        return turns, factors, np.all(turned, axis=0), np.any(turned, axis=0)
    if orientations.shape != (F, H, 3, 3):
        raise InputError(
            f"orientations: expected ({F}, {H}, 3, 3) in a file, got {orientations.shape}; give "
            "rotation matrices"
        )
    factors, always = np.ones(H), np.ones(H, dtype=bool)
    for frames in slices(F, _PART):
        turns, factors = checked_orientations(orientations[frames], weights, (_size(frames), H))
        turned = ~np.isnan(turns[..., 0, 0])
        always = np.logical_and(always, turned.all(axis=0))
        ever = np.logical_or(ever, turned.any(axis=0))
    return orientations, factors, always, ever


def _size(frames: slice) -> int:
    return frames.stop - frames.start


def _checked_gaps(gaps: ArrayLike | StoredArray | None, F: int, H: int) -> Rows | None:
    """Gaps (F, H, 3), of one for all frames (H, 3) or F of them; None stays."""
    if gaps is None:
        return None
    stored = isinstance(gaps, StoredArray)
    apart: Rows = gaps if stored else checked_array(gaps, "gaps", largest=LARGEST)
    if apart.shape not in ((F, H, 3), *(() if stored else ((H, 3),))):
        raise InputError(
            f"gaps: expected ({F}, {H}, 3) or ({H}, 3), one a handle, got {apart.shape}"
        )
    if isinstance(apart, StoredArray):
        for frames in slices(F, _PART):
            checked_array(apart[frames], "gaps", largest=LARGEST)
    return _spread(apart, (F, H, 3))
