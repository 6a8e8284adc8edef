"""The mirror plane of handles: the body's symmetry plane, or one that the user names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

import deformer
from deformer import DeformationModel, Mesh, Symmetry

Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = ("x", "y", "z")

# Misfit of mirror images, in bounding diagonals, up to which a body counts as symmetric.
_SYMMETRIC = 0.02
# Examples that are tried, evenly spread, if the reference is not posed symmetrically.
_EXAMPLES = 12
# Share of vertices that are their own mirror images from which a plane separates no sides.
_FLAT = 0.5


class MirrorPlane:
    """The mirror plane of a body.

    Sides are those of a rest shape, whatever the pose that is shown: the reference or, if that is
    not posed symmetrically, the most symmetric example.

    Args:
        model: the model of the body.

    Attributes:
        across: the axis of `set_across`; None for the body's symmetry plane.
    """

    def __init__(self, model: DeformationModel) -> None:
        """Store the model; its plane is found at the first use."""
        self.across: Axis | None = None
        self._model = model
        self._found: tuple[Symmetry, Mesh] | None = None

    @property
    def symmetry(self) -> Symmetry:
        """The plane and the vertex opposite each vertex; found at the first use."""
        return self._symmetry_and_rest()[0]

    @property
    def is_known(self) -> bool:
        """True once the plane has been found; the first use takes seconds for some bodies."""
        return self._found is not None

    @property
    def is_symmetric(self) -> bool:
        """True if the two sides of the plane are nearly each other's mirror images."""
        return self.symmetry.error <= _SYMMETRIC

    def find(self) -> None:
        """Use the body's symmetry plane, in place of any plane set before."""
        self._found = self.across = None

    def set_across(self, axis: Axis) -> None:
        """Mirror about the plane through the middle of the body across an axis."""
        self._found, self.across = (self._across(axis), self._model.reference), axis

    def mirrored_pose(self, vertices: ArrayLike) -> NDArray[np.float64]:
        """Return the mirror image (V, 3) of a pose (V, 3), see `deformer.mirrored_pose`."""
        symmetry, rest = self._symmetry_and_rest()
        own = None if rest is self._model.reference else rest
        return deformer.mirrored_pose(self._model, vertices, symmetry, own)

    def mirrored_code(self, code: ArrayLike) -> tuple[float, ...]:
        """Return the latent code (K,) of the mirror image of a code's shape."""
        image = self._model.encode(self.mirrored_pose(self._model.decode(code)))
        return tuple(image.tolist())

    def asymmetry(self, vertices: NDArray[np.float64]) -> float:
        """Return how far a pose (V, 3) is from its own mirror image, as a share of the body's size.

        It is the root mean square distance between the two as they lie best on each other.
        """
        symmetry = self.symmetry
        image = symmetry.mirror(vertices)[symmetry.opposite]
        apart = deformer.vertex_errors(vertices, image, "rigid")
        return float(np.sqrt((apart**2).mean())) / self._model.reference.bounding_diagonal

    def side(self, vertices: Sequence[int]) -> float:
        """Return the signed distance from the plane of the middle of vertices on the rest."""
        symmetry, rest = self._symmetry_and_rest()
        middle = rest.vertices[list(vertices)].mean(axis=0)
        return float((middle - symmetry.point) @ symmetry.normal)

    def apart(self, vertices: Sequence[int], others: Sequence[int]) -> float:
        """Return how far the mirror image of vertices is from other vertices.

        The distance is that between the middles of both on the rest, in bounding diagonals.
        """
        symmetry, rest = self._symmetry_and_rest()
        image = symmetry.mirror(rest.vertices[list(vertices)]).mean(axis=0)
        gap = image - rest.vertices[list(others)].mean(axis=0)
        return float(np.sqrt(gap @ gap)) / rest.bounding_diagonal

    def _across(self, axis: Axis) -> Symmetry:
        vertices = self._model.reference.vertices
        middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        return deformer.symmetry_about(self._model.reference, middle, np.eye(3)[AXES.index(axis)])

    def _symmetry_and_rest(self) -> tuple[Symmetry, Mesh]:
        if self._found is None:
            self._found = self._find()
        return self._found

    def _find(self) -> tuple[Symmetry, Mesh]:
        model, reference = self._model, self._model.reference
        found = deformer.find_symmetry(reference), reference
        if _is_flat(found[0]):
            # A sheet is its own mirror image in its own plane, which has no sides.
            planes = [plane for plane in map(self._across, AXES) if not _is_flat(plane)]
            return min(planes, key=lambda plane: plane.error, default=found[0]), reference
        if found[0].error > _SYMMETRIC:
            for code in model.codes[:: max(len(model.codes) // _EXAMPLES, 1)]:
                rest = Mesh(model.decode(code), reference.faces)
                found = min(
                    found, (deformer.find_symmetry(rest), rest), key=lambda pair: pair[0].error
                )
        return found


def _is_flat(plane: Symmetry) -> bool:
    return float((plane.opposite == np.arange(len(plane.opposite))).mean()) >= _FLAT
