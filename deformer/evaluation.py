"""Protocols that measure a model on shapes it has not seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deformer.geodesics import farthest_points
from deformer.handles import HandleSolver, Pose
from deformer.mesh import FloatArray, IntArray
from deformer.metrics import e_rms


@dataclass(frozen=True, eq=False)
class SparseControl:
    """What one run of the sparse-control protocol gave.

    Args:
        vertices: (count,) control vertices.
        errors: (N,) E_rms of each shape over all vertices, nothing aligned.
        poses: the fitted poses.
    """

    vertices: IntArray
    errors: FloatArray
    poses: list[Pose]

    @property
    def e_rms(self) -> float:
        """E_rms over all shapes together."""
        return float(np.sqrt((self.errors**2).mean()))


def sparse_control(
    solver: HandleSolver, shapes: ArrayLike, count: int, seed: int = 0, hard: bool = True
) -> SparseControl:
    """Recover whole shapes from the positions of a few control vertices.

    The first control vertex is drawn with `seed`, each next one is the farthest in geodesic
    distance (Voronoi sampling). The solver sees only their positions on the unseen shape; nothing
    is aligned, the control vertices fix the frame.

    Args:
        solver: the method.
        shapes: (N, V, 3) shapes that the model was not trained on.
        count: control vertices.
        seed: of the first control vertex.
        hard: control positions are met exactly.
    """
    vertices = farthest_points(solver.model.geodesics, count, seed)
    poses = list(_fits(solver, np.asarray(shapes, dtype=np.float64), vertices, hard))
    errors = [
        e_rms(shape, pose.vertices, "none")
        for shape, pose in zip(np.asarray(shapes), poses, strict=True)
    ]
    return SparseControl(vertices, np.array(errors), poses)


def _fits(
    solver: HandleSolver, shapes: FloatArray, vertices: IntArray, hard: bool
) -> Iterator[Pose]:
    for shape in shapes:
        solver.set_handles(vertices, shape[vertices], hard=hard)
        yield solver.solve()
