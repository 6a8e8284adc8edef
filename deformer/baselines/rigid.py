"""As-rigid-as-possible deformation with exact handles, by libigl."""

from __future__ import annotations

from typing import Any, ClassVar

import igl
import numpy as np

from deformer.baselines._examples import Bending
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray

# libigl's iterations between two looks at whether vertices still move; a vertex moves less than
# the tolerance (a share of the shape's size) at the end, or the rounds are spent.
_ITERATIONS = 10
_TOLERANCE = 1e-4
_ROUNDS = 20


class Arap(Bending):
    """Bends the reference as rigidly as possible (Sorkine and Alexa, SGP 2007)."""

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
    """Bends the training shape that is nearest by its control points."""

    name: ClassVar[str] = "arap-nearest"
    nearest: ClassVar[bool] = True
