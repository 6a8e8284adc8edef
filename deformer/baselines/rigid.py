"""As-rigid-as-possible deformation with exact handles, by libigl."""

from __future__ import annotations

from typing import Any, ClassVar

import igl
import numpy as np

from deformer.baselines._examples import Bending
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray

# libigl runs so many iterations a round. Rounds end when no vertex moves by more than the tolerance
# (relative to the shape's size), or after the largest number of rounds.
_ITERATIONS = 10
_TOLERANCE = 1e-4
_ROUNDS = 20


class Arap(Bending):
    """Deforms the reference as rigidly as possible (Sorkine and Alexa, SGP 2007)."""

    name: ClassVar[str] = "arap"

    def _prepare(self, rest: FloatArray, vertices: IntArray) -> tuple[Any, float]:
        data = igl.ARAPData()
        data.max_iter = _ITERATIONS
        igl.arap_precomputation(
            np.array(rest), np.array(self._shapes.faces), 3, vertices.astype(np.int32), data
        )
        return data, float(np.linalg.norm(np.ptp(rest, axis=0)))

    def _bend(
        self, prepared: Any, start: FloatArray, vertices: IntArray, targets: FloatArray
    ) -> FloatArray:
        data, size = prepared
        pose = start
        for _ in range(_ROUNDS):
            last, pose = pose, igl.arap_solve(np.ascontiguousarray(targets), data, pose)
            if not np.isfinite(pose).all():
                raise InputError(f"{self.name}: libigl gave positions that are not finite")
            if np.abs(pose - last).max() < _TOLERANCE * size:
                break
        return np.array(pose)


class NearestArap(Arap):
    """Deforms the training shape whose control points are nearest to the targets."""

    name: ClassVar[str] = "arap-nearest"
    nearest: ClassVar[bool] = True
