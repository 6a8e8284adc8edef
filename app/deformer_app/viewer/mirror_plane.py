"""The mirror plane of handles: the body's symmetry plane, or one that the user names."""

from __future__ import annotations

from typing import Literal

import numpy as np

import deformer
from deformer import Mesh, Symmetry

Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = ("x", "y", "z")


class MirrorPlane:
    """The mirror plane of a mesh.

    Args:
        reference: the undeformed mesh.
    """

    def __init__(self, reference: Mesh) -> None:
        """Store the mesh; its plane is found at the first use."""
        self._reference = reference
        self._symmetry: Symmetry | None = None

    @property
    def symmetry(self) -> Symmetry:
        """The plane and the vertex opposite each vertex; found at the first use."""
        if self._symmetry is None:
            self._symmetry = deformer.find_symmetry(self._reference)
        return self._symmetry

    def find(self) -> None:
        """Use the body's symmetry plane, in place of any plane set before."""
        self._symmetry = None

    def set_across(self, axis: Axis) -> None:
        """Mirror about the plane through the middle of the body across an axis."""
        vertices = self._reference.vertices
        middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        normal = np.eye(3)[AXES.index(axis)]
        self._symmetry = deformer.symmetry_about(self._reference, middle, normal)
