"""Shapes whose axes are mixed up: what brings them back is a signed permutation of x, y and z."""

from __future__ import annotations

import numpy as np

from deformer.geometry import (
    PROPER_AXES,
    FloatArray,
    IntArray,
    closest_rotations,
    rotation_to_log,
)
from deformer.preflight.local_rotations import LocalRotations, rotation_angles
from deformer.preflight.neighbours import around
from deformer.preflight.statistics import evenly

# A shape's axes are mixed up if undoing it multiplies the distance of its local rotations from
# those of the nearest shape by less than _MUCH_CLOSER, and at most _FEW of all shapes are so.
_MUCH_CLOSER = 0.4
_FEW = 0.3
_LEFT_OVER = np.radians(20.0)
# A shape that is odd turns by more than this to all its neighbours, and they by less to the next.
_ODD = np.radians(45.0)
# Cosine of the angle between axes of turns that are alike.
_ALIKE = 0.7
_COMPARED = 200


def undoing(local: LocalRotations, good: IntArray, mirrored: IntArray) -> dict[int, FloatArray]:
    """The signed permutation that brings a shape back, for shapes that need one.

    Args:
        local: of all shapes; of mirrored ones after x → −x.
        good: shapes that are not mirrored.
        mirrored: shapes that are.
    """
    if len(good) < 3:
        return {n: np.eye(3) for n in mirrored.tolist()}
    near = _Nearness(local, good, good)
    undone: dict[int, FloatArray] = {}
    while True:
        gain, P = near.best()
        # The oddest first: a shape that is right may look odd only beside one that is not.
        row = int(np.where(gain < _MUCH_CLOSER, near.oddness(), -1.0).argmax())
        if gain[row] >= _MUCH_CLOSER:
            break
        undone[int(good[row])] = P[row]
        near.remove(row)
        if len(undone) > _FEW * len(good):
            # Many orientations: shapes that turn as a whole, by steps or all the way.
            undone = {}
            break
    # Beside one that is not right, its neighbour looked odd; beside the rest it does not.
    if undone:
        chosen = np.array(sorted(undone))
        rest = np.setdiff1d(good, chosen)
        gain, P = _Nearness(local, chosen, rest).best()
        undone = {
            int(n): P[k]
            for k, n in enumerate(chosen)
            if gain[k] < _MUCH_CLOSER
            and is_odd(local, int(n), around(rest, n))
            and not _turn_so(local, rest, P[k])
        }
    # A mirrored shape is always brought back, by what brings it nearest.
    if len(mirrored):
        others = np.setdiff1d(good, list(undone))
        _, axes = _Nearness(local, mirrored, others).best()
        undone |= dict(zip(mirrored.tolist(), axes, strict=True))
    return undone


def is_odd(local: LocalRotations, n: int, near: IntArray) -> bool:
    """True if all shapes `near` turn by over 45° to n, and mostly less from one to the next."""
    if len(near) < 2:
        return False
    steps = local.angles(near[:-1], near[1:])
    return bool(np.median(steps) < _ODD < local.angles(n, near).min())


def _turn_so(local: LocalRotations, shapes: IntArray, P: FloatArray) -> bool:
    """True if some of the shapes turn by over 45° about the axis of P (3, 3): dancers do."""
    shapes = shapes[evenly(len(shapes), _COMPARED)]
    turns = rotation_to_log(local.between(shapes, int(shapes[0]))[1])
    angles = np.linalg.norm(turns, axis=1)
    far = turns[angles > _ODD] / angles[angles > _ODD, None]
    axis = rotation_to_log(P)
    return bool((np.abs(far @ axis) > _ALIKE * np.linalg.norm(axis)).any())


class _Nearness:
    """Distances 1 − tr(P C_nm) / 3 of local rotations of shapes n, after P, from those of m.

    Args:
        local: as in `undoing`.
        chosen: (n,) shapes.
        others: the shapes to compare with: evenly chosen ones, and the next on either side.
    """

    def __init__(self, local: LocalRotations, chosen: IntArray, others: IntArray) -> None:
        spaced = others[evenly(len(others), _COMPARED)]
        place = np.searchsorted(others, chosen)
        beside = others[np.clip(place[:, None] + [-1, 1], 0, len(others) - 1)]
        self._compared = np.column_stack([np.tile(spaced, (len(chosen), 1)), beside])
        self._chosen = chosen
        # C_mn (n, m, 3, 3) with m first, the transpose of C_nm.
        f, count = local.frames.astype(np.float32), local.count
        among = f[spaced].reshape(-1, f.shape[2]) @ f[chosen].reshape(-1, f.shape[2]).T
        among = among.reshape(len(spaced), 3, len(chosen), 3).transpose(2, 0, 1, 3)
        next_to = f[beside] @ f[chosen].transpose(0, 2, 1)[:, None]
        C = np.concatenate([among, next_to], axis=1)
        C /= np.minimum(count[self._compared], count[chosen][:, None])[..., None, None]
        axes = PROPER_AXES.astype(np.float32).reshape(24, 9)
        self._distance = 1.0 - np.tensordot(axes, C.reshape(*C.shape[:2], 9), axes=(1, 2)) / 3.0
        self._C = C
        self._distance[:, self._compared == chosen[:, None]] = np.inf

    def remove(self, row: int) -> None:
        """Compare neither the shape of a row nor others with it."""
        self._distance[:, self._compared == self._chosen[row]] = np.inf
        self._distance[0, row] = 0.0

    def best(self) -> tuple[FloatArray, FloatArray]:
        """For each shape how much nearer the best P (n, 3, 3) brings it, as a quotient (n,).

        The quotient is 1 where a turn as a whole remains, so that it was not of the axes.
        """
        least = np.maximum(self._distance.min(axis=2), 1e-6)
        q, rows = least.argmin(axis=0), np.arange(len(self._chosen))
        P, gain = PROPER_AXES[q], least.min(axis=0) / least[0]
        nearest = self._distance[q, rows].argmin(axis=1)
        remaining = closest_rotations(self._C[rows, nearest] @ P.transpose(0, 2, 1))
        gain[rotation_angles(remaining) > _LEFT_OVER] = 1.0
        return gain, P

    def oddness(self) -> FloatArray:
        """Median distance (n,) of each shape as it is from the others."""
        return np.median(self._distance[0], axis=1)
