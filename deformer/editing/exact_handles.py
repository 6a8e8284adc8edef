"""Exact handles of a decoded surface: its shape with the handles at their targets."""

from __future__ import annotations

import numpy as np

from deformer.editing.exact_rows import schur_inverse
from deformer.editing.lifted_surface import Surface
from deformer.geometry import FloatArray, SurfacePoints

# Newton steps that correct handles, the misfit, in bounding diagonals, that needs none, and the
# shares of a step that are tried in turn.
_CORRECTIONS, _MISFIT = 30, 1e-13
_SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)
# Step of differences, in bounding diagonals.
_DIFFERENCE = 1e-6


class ExactHandles:
    """The exact handles among a model's handles.

    Args:
        points: the n handles.
        rows: (n, V) `PoissonSystem.bending_rows`: how a unit load at each moves all vertices.
        diagonal: bounding diagonal of the reference.
    """

    def __init__(self, points: SurfacePoints, rows: FloatArray, diagonal: float) -> None:
        """Store the rows, and their block at the handles."""
        self.points, self.rows = points, rows
        self._diagonal = diagonal
        self.block = np.einsum("hm,ghm->gh", points.weights, rows[:, points.index])

    def __len__(self) -> int:
        """Count the handles."""
        return len(self.points.index)

    def solve(
        self, surface: Surface, Q: FloatArray, origin: FloatArray, targets: FloatArray
    ) -> FloatArray:
        """Positions (V, 3) of a surface by its present rotations, the handles at their targets.

        Args:
            surface: has these exact handles and the gradients of a code.
            Q: (3, 3) rotation of the shape about its centroid.
            origin: (3,) position of the centroid.
            targets: (n, 3).
        """
        surface.solve()
        goals, points = targets, self.points
        if len(points.ring) or len(points.frames):
            before = surface.positions(Q, origin)
            goals = points.feet(before[points.ring], points.stretched(points.at(before), targets))
        surface.move_to_targets((goals - origin) @ Q)
        vertices = surface.positions(Q, origin)
        self.correct(vertices, targets)
        return vertices

    def correct(self, vertices: FloatArray, targets: FloatArray) -> None:
        """Remove, in place, what rounding and turned normals leave between handles and targets.

        Args:
            vertices: (V, 3) positions.
            targets: (n, 3).
        """
        points, n = self.points, len(self)
        targets = points.stretched(points.at(vertices), targets) if len(points.frames) else targets
        if len(points.ring):
            rows = np.vstack([self.rows[:, points.ring], np.ones((1, len(points.ring)))])
            change = self._correction(vertices[points.ring], rows, targets)
        elif not points.is_vertex.all():
            misfit = np.vstack([targets - points.at(vertices), np.zeros((1, 3))])
            change = schur_inverse(self.block) @ misfit
        else:
            change = None
        if change is not None:
            vertices += self.rows.T @ change[:n] + change[n]
        vertices[points.index[points.is_vertex, 0]] = targets[points.is_vertex]

    def _correction(self, ring: FloatArray, rows: FloatArray, targets: FloatArray) -> FloatArray:
        """Loads of the handles, and a translation, (n+1, 3), that bring points to their targets.

        Normals turn with the surface: Newton's method, with differences for the derivative.

        Args:
            ring: (R, 3) positions of `SurfacePoints.ring`.
            rows: (n+1, R) how a unit load at each handle, and a translation, moves them.
            targets: (n, 3).
        """
        n, h = len(self), _DIFFERENCE * self._diagonal
        # Each load's largest motion, so that all differences are alike.
        scale = 1.0 / np.maximum(np.abs(rows).max(axis=1), np.finfo(float).tiny)
        probes = h * (scale[:, None] * rows)[:, None, :, None] * np.eye(3)[None, :, None, :]
        free = np.tile(np.eye(3), n + 1) * np.repeat(np.append(scale[:n], 0.0), 3)
        change = np.zeros((n + 1, 3))
        misfit = targets - self.points.at_ring(ring)
        for _ in range(_CORRECTIONS):
            off = np.abs(misfit).max()
            if off <= _MISFIT * self._diagonal:
                break
            here = targets - misfit
            J = (self.points.at_ring(ring + probes) - here).reshape(3 * (n + 1), -1).T / h
            system = np.vstack([J, free])  # the loads sum to zero
            right = np.append(misfit.ravel(), np.zeros(3))
            step = np.linalg.lstsq(system, right, rcond=1e-12)[0].reshape(n + 1, 3)
            step *= scale[:, None]
            for share in _SHARES:
                moved = ring + share * (rows.T @ step)
                left = targets - self.points.at_ring(moved)
                if np.abs(left).max() < off:
                    break
            else:
                break
            ring, misfit, change = moved, left, change + share * step
        return change
