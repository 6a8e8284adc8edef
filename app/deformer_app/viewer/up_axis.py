"""Which axis of example shapes most likely points up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import Document, Mesh, io

# Files that hold many shapes and no single mesh.
_SEQUENCES = (".npz", ".mdd", ".pc2")
# Part of a shape's height from its lowest point to the origin, at most, if it stands there.
_STANDS = 0.03


def first_shape(source: Path) -> Mesh:
    """Load the first of the shapes that `deformer.load_shapes` loads from a path.

    Raises:
        InputError: as `deformer.load_shapes` raises.
    """
    file = io.shape_files(source)[0]
    if file.suffix.lower() in _SEQUENCES:
        return deformer.load_shapes(source).mesh(0)
    return deformer.load_mesh(file)


def up_axis_of(mesh: Mesh, document: Document | None) -> str:
    """Return the axis that points up in shapes: what their file says, or else `likely_up`.

    Args:
        mesh: the first shape.
        document: of the shapes, as of `deformer.load_document`.
    """
    return (document and document.up) or likely_up(mesh.vertices)


def likely_up(vertices: NDArray[np.float64]) -> str:
    """Return "y" or "z", the up axes of most programs: that along which a shape seems to stand.

    If it stands on the plane through the origin along one of them alone, that one; otherwise the
    one along which it is longer, as most figures are.

    Args:
        vertices: (V, 3) a shape.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = high - low
    stands = np.abs(low) <= _STANDS * extent
    if stands[1] != stands[2]:
        return "y" if stands[1] else "z"
    return "z" if extent[2] > extent[1] else "y"
