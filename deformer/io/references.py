"""The reference of a set of shapes, named on the command line or given as a file of its own."""

from __future__ import annotations

from pathlib import Path
from typing import overload

from deformer.checks import checked_instance, checked_integer, is_unicode, shortened
from deformer.errors import InputError
from deformer.geometry import (
    MeshSequence,
    ShapeSequence,
    StoredShapes,
    joined_shapes,
    shape_sequence,
)
from deformer.io.loading import load_mesh
from deformer.workspace import Workspace, in_memory


@overload
def with_reference(
    shapes: MeshSequence, reference: str | int | Path, workspace: None = None
) -> tuple[MeshSequence, int]: ...


@overload
def with_reference(
    shapes: ShapeSequence, reference: str | int | Path, workspace: Workspace
) -> tuple[ShapeSequence, int]: ...


def with_reference(
    shapes: ShapeSequence, reference: str | int | Path, workspace: Workspace | None = None
) -> tuple[ShapeSequence, int]:
    """Shapes with their reference, and its index.

    Args:
        shapes: the shapes.
        reference: a shape's name; or its index, as a number or as text where no shape has it as its
            name; or a mesh file, which becomes shape 0 before the others.
        workspace: where the shapes are then, as of `load_shapes`; None keeps them in memory.

    Returns:
        the shapes, one more if it is a file; and the index of the reference.

    Raises:
        InputError: no such shape or file, or a mesh of another connectivity.
    """
    if workspace is not None:
        checked_instance(workspace, "workspace", Workspace, remedy="make one, or leave it out")
    if workspace is None or not isinstance(shapes, StoredShapes):
        checked_instance(shapes, "shapes", MeshSequence, remedy="load some with load_shapes")
    if not isinstance(reference, str | Path) or isinstance(reference, bool):
        number = checked_integer(reference, "reference")
        shapes.mesh(number)
        return shapes, number % len(shapes)
    text = str(reference)
    if text in shapes.names:
        return shapes, shapes.names.index(text)
    if text.isdecimal() and len(text) < 10 and int(text) < len(shapes):
        return shapes, int(text)
    if "\0" in text or not is_unicode(text) or not _is_file(Path(text)):
        names = f"one of {shortened(list(shapes.names))}, " if shapes.names else ""
        raise InputError(
            f"reference: expected {names}a number of 0…{len(shapes) - 1} or a mesh file, got "
            f"{shortened(text)}; give one of them"
        )
    mesh = load_mesh(text, like=shapes.mesh(0))
    names = (Path(text).stem, *shapes.names) if shapes.names else ()
    empty = in_memory if workspace is None else workspace.doubles
    vertices = joined_shapes(mesh.vertices[None], shapes, mesh.vertices[None][:0], empty)
    return shape_sequence(vertices, shapes.faces, names), 0


def _is_file(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a name that is too long
        return False
