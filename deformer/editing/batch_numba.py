"""Handle positions, their derivatives and shapes of many frames: the interface, and with numba."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from deformer.editing.green_functions import HandleBasis
from deformer.editing.relaxation import relaxation
from deformer.geometry import FloatArray
from deformer.linalg import over_parts

Boolean = NDArray[np.bool_]


class Frames(Protocol):
    """A model with handles, evaluated at m latent codes at once; arrays are float64.

    Handle positions are those before the rigid motion, relative to the shape's centroid, in the
    data's units.
    """

    def by_landmarks(self, z: FloatArray) -> FloatArray:
        """Handle positions (m, H, 3) of codes z (m, K) by the landmarks alone."""
        ...

    def jacobians(self, z: FloatArray) -> FloatArray:
        """Derivatives (m, H, 3, K) of `by_landmarks` with respect to the codes z (m, K)."""
        ...

    def by_all(self, z: FloatArray) -> FloatArray:
        """Handle positions (m, H, 3) of codes z (m, K) by all vertices."""
        ...

    def shapes(
        self,
        z: FloatArray,
        Q: FloatArray,
        origin: FloatArray,
        targets: FloatArray,
        exact: Boolean,
        rounds: int,
        out: FloatArray,
    ) -> None:
        """Write the shape of each code, rigidly moved and with its exact handles at their targets.

        Args:
            z: (m, K) latent codes.
            Q: (m, 3, 3) rotations of the shapes about their centroids.
            origin: (m, 3) positions of the centroids.
            targets: (m, H, 3) positions of the handles.
            exact: (m, H) true where a handle of a frame is at its target exactly.
            rounds: rounds of rigid relaxation of the frames with exact handles.
            out: (m, V, 3) positions that are written.
        """
        ...


class NumbaFrames:
    """`Frames` on all cores; each core computes some of the frames.

    Args:
        basis: the model's handles; they must not change while the frames are in use.
    """

    def __init__(self, basis: HandleBasis) -> None:
        """Prepare the handle positions by landmarks."""
        self._basis = basis
        self._handles = basis.landmark_positions()
        self._count = len(basis.points)

    def by_landmarks(self, z: FloatArray) -> FloatArray:
        """Handle positions (m, H, 3) of codes z (m, K) by the landmarks alone."""
        out = np.empty((len(z), self._count, 3))

        def evaluate(part: range) -> None:
            for m in part:
                out[m] = self._handles.at(z[m]).positions

        over_parts(evaluate, len(z))
        return out

    def jacobians(self, z: FloatArray) -> FloatArray:
        """Derivatives (m, H, 3, K) of `by_landmarks` with respect to the codes z (m, K)."""
        out = np.empty((len(z), self._count, 3, z.shape[1]))

        def differentiate(part: range) -> None:
            for m in part:
                out[m] = self._handles.at(z[m]).derivative()

        over_parts(differentiate, len(z))
        return out

    def by_all(self, z: FloatArray) -> FloatArray:
        """Handle positions (m, H, 3) of codes z (m, K) by all vertices."""
        out = np.empty((len(z), self._count, 3))

        def decode(part: range) -> None:
            surface = self._basis.surface.copy()
            for m in part:
                out[m] = surface.decode(z[m])

        over_parts(decode, len(z))
        return out

    def shapes(
        self,
        z: FloatArray,
        Q: FloatArray,
        origin: FloatArray,
        targets: FloatArray,
        exact: Boolean,
        rounds: int,
        out: FloatArray,
    ) -> None:
        """Write the shape of each code, rigidly moved, exact handles at their targets."""
        basis = self._basis

        def rebuild(part: range) -> None:
            surface = basis.surface.copy()
            surface.set_handles_by_block([])
            handles = None
            for m in part:
                if handles is None or (exact[m] != exact[m - 1]).any():
                    handles = basis.set_exact(
                        [basis.points[h] for h in np.flatnonzero(exact[m])], surface
                    )
                frame = Q[m], origin[m], targets[m, exact[m]]
                surface.reset()
                surface.decode(z[m])
                for positions in relaxation(
                    surface,
                    lambda handles=handles, frame=frame: handles.solve(surface, *frame),
                    rounds if len(handles) else 0,
                ):
                    out[m] = positions

        over_parts(rebuild, len(z))
