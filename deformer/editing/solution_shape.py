"""The shape of a solution, without the solver that has found it."""

from __future__ import annotations

from numpy.typing import ArrayLike

from deformer.checks import LARGEST, checked_array, checked_instance
from deformer.geometry import FloatArray, log_to_rotation
from deformer.model import DeformationModel


def posed_shape(
    model: DeformationModel, z: ArrayLike, rotation: ArrayLike, translation: ArrayLike
) -> FloatArray:
    """Vertices (V, 3) of a code's shape after a rigid motion, in the data's units.

    It is the surface of a `Pose` with that code and motion, up to what exact handles and a floor
    add, and takes the time of a decoding, where `HandleSolver.restore` needs a prepared solver.

    Args:
        model: the pose's model.
        z: (K,) latent code.
        rotation: (3,) rotation vector about the reference's centroid, in radians.
        translation: (3,) in the data's units.

    Raises:
        InputError: another shape of an array, or a number that is not finite.
    """
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    code = checked_array(z, "z", (model.components,), largest=LARGEST)
    omega = checked_array(rotation, "rotation", (3,), largest=LARGEST)
    t = checked_array(translation, "translation", (3,), largest=LARGEST)
    centroid = model.closed.poisson.centroid
    return (model.decode(code) - centroid) @ log_to_rotation(omega).T + centroid + t
