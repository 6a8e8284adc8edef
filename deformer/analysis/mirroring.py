"""The mirror image of a pose: what the right side does, the left does."""

from __future__ import annotations

from numpy.typing import ArrayLike

from deformer.acap import FeatureExtractor, MirrorMap, PoissonSystem
from deformer.checks import checked_array, checked_instance
from deformer.errors import InputError
from deformer.geometry import FloatArray, Mesh, Symmetry, find_symmetry
from deformer.model import DeformationModel


def mirrored_pose(
    model: DeformationModel,
    vertices: ArrayLike,
    symmetry: Symmetry | None = None,
    rest: Mesh | None = None,
) -> FloatArray:
    """The mirror image of a pose, with the vertices of the same body.

    The pose itself may be as asymmetric as it likes: only the rest has to be symmetric. Where the
    two halves of the rest differ, the image keeps the differences on their sides; so the image of
    the rest is the rest. The code of the image is `model.fit(mirrored_pose(model, vertices))`.

    Args:
        model: the model of the body.
        vertices: (V, 3) or (N, V, 3) poses, in the data's units.
        symmetry: the mirror plane of the rest; None is found (`find_symmetry`).
        rest: the symmetric shape to which `symmetry` belongs; None is the model's reference. Give
            one if the reference is not posed symmetrically.

    Returns:
        (V, 3) or (N, V, 3) float64.

    Raises:
        InputError: another shape of the array, or a rest that is not a shape of the model.
    """
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    V = len(model.reference.vertices)
    poses = checked_array(vertices, "vertices", (V, 3), ("N", V, 3))
    if symmetry is not None:
        remedy = "find it with find_symmetry"
        checked_instance(symmetry, "symmetry", Symmetry, remedy=remedy)
    closed = model.closed
    if rest is None:
        plane = find_symmetry(model.reference) if symmetry is None else symmetry
        images = MirrorMap(closed.extractor, closed.poisson, plane)
    else:
        checked_instance(rest, "rest", Mesh, remedy="make one of vertices and faces")
        if len(rest.vertices) != V:
            raise InputError(f"rest: expected the model's {V} vertices, got {len(rest.vertices)}")
        plane = find_symmetry(rest) if symmetry is None else symmetry
        surface = Mesh(model.seams.close(rest.vertices), closed.reference.faces)
        images = MirrorMap(FeatureExtractor(surface), PoissonSystem(surface), plane)
    found = model.seams.open(images.images(model.seams.close(poses.reshape(-1, V, 3))))
    return found.reshape(poses.shape)
