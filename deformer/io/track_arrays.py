"""The handles of a sequence as arrays, with a row for each frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deformer.geometry import FloatArray, SurfacePoint
from deformer.io.handle_files import HandleTarget
from deformer.workspace import Rows, Workspace, slices

# Frames whose arrays are made at once.
_PART = 1024


@dataclass(frozen=True, eq=False)
class HandleTracks:
    """H handles in F frames: arguments of `fit_sequence` and of `fit_sequence_parts`.

    Args:
        points: the H points that have a handle in any frame, in the order in which they first do.
        targets: (F, H, 3).
        weights: (F, H); 0 where a frame has no handle at the point.
        hard: (F, H) true for exact handles and pins.
        orientations: (F, H, 3, 3), NaN for none; None where no handle has one.
        orientation_weights: (H,), those of the last frames that have one.
        gaps: (F, H, 3); None where all are 0.
    """

    points: list[int | SurfacePoint]
    targets: Rows
    weights: Rows
    hard: Rows
    orientations: Rows | None
    orientation_weights: FloatArray
    gaps: Rows | None

    def seen(self, frames: slice) -> FloatArray:
        """Targets (n, H, 3) of frames, NaN where a handle is not seen."""
        return np.where(self.weights[frames][..., None] > 0, self.targets[frames], np.nan)


def handle_tracks(
    frames: Sequence[tuple[HandleTarget, ...]], workspace: Workspace | None = None
) -> HandleTracks:
    """Arrays of the handles of frames.

    Args:
        frames: of a `HandleFile`, gone through twice.
        workspace: where the arrays are; None has them in memory.
    """
    found: dict[int | SurfacePoint, int] = {}
    turned = apart = False
    for frame in frames:
        for handle in frame:
            found.setdefault(handle.vertex, len(found))
            turned |= handle.orientation is not None
            apart |= any(handle.gap)
    F, H = len(frames), len(found)
    empty = np.empty if workspace is None else workspace.empty
    targets, weights = empty((F, H, 3), np.float64), empty((F, H), np.float64)
    hard, factors = empty((F, H), np.bool_), np.ones(H)
    turns = empty((F, H, 3, 3), np.float64) if turned else None
    gaps = empty((F, H, 3), np.float64) if apart else None
    for part in slices(F, _PART):
        n = part.stop - part.start
        goals, w, exact = np.zeros((n, H, 3)), np.zeros((n, H)), np.zeros((n, H), dtype=bool)
        R, g = np.full((n, H, 3, 3), np.nan), np.zeros((n, H, 3))
        for f, frame in enumerate(frames[part]):
            for handle in frame:
                h = found[handle.vertex]
                goals[f, h], w[f, h], g[f, h] = handle.position, handle.weight, handle.gap
                exact[f, h] = handle.kind != "soft"
                if handle.orientation is not None:
                    R[f, h], factors[h] = handle.orientation, handle.orientation_weight
        targets[part], weights[part], hard[part] = goals, w, exact
        if turns is not None:
            turns[part] = R
        if gaps is not None:
            gaps[part] = g
    return HandleTracks(list(found), targets, weights, hard, turns, factors, gaps)
