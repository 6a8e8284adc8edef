"""How far exact handles have deformed the shape of a pose's code."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import checked_indices, checked_instance
from deformer.editing.handles import Pose
from deformer.editing.solution_shape import posed_shape
from deformer.geometry import FloatArray
from deformer.model import DeformationModel

# Shorter ones, in bounding diagonals, are rounding: the surface is computed in single precision.
_LEAST = 1e-5


def surface_gaps(model: DeformationModel, pose: Pose, vertices: ArrayLike) -> FloatArray:
    """Vectors (n, 3) from the shape of a pose's code to its surface, in the data's units.

    They are zero unless exact handles, or the model's own error, deform the shape. A handle that is
    set at a vertex of the surface with this gap (`Handle.gap`) leaves the pose as it is.

    Args:
        model: the pose's model.
        pose: a solver's.
        vertices: (n,) vertex indices.

    Raises:
        InputError: an index out of range.
    """
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    checked_instance(pose, "pose", Pose, remedy="solve for one")
    index = checked_indices(vertices, "vertices", len(model.reference.vertices))
    if not len(index):
        return np.zeros((0, 3))
    shape = posed_shape(model, pose.z, pose.rotation, pose.translation)
    gaps = pose.vertices[index] - shape[index]
    long = np.linalg.norm(gaps, axis=1) > _LEAST * model.reference.bounding_diagonal
    return np.where(long[:, None], gaps, 0.0)
