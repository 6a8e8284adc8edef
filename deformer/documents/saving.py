"""Meshes written like the file that their shapes came from."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, runtime_checkable

from deformer.checks import checked_instance, checked_path, shortened
from deformer.documents.document import Document, load_document
from deformer.errors import InputError
from deformer.geometry import Mesh
from deformer.io import MESH_SUFFIXES, atomic_path, save_mesh as save_bare_mesh


@runtime_checkable
class HasDocument(Protocol):
    """An object, such as a model, that may have a document."""

    @property
    def document(self) -> Document | None:
        """The document."""
        ...


Like = Document | HasDocument | str | Path


def save_mesh(path: str | Path, mesh: Mesh, like: Like | None = None) -> None:
    """Write one mesh in the format of the suffix; an existing file is replaced once all is written.

    Args:
        path: the file, named .obj, .ply, .off, .stl or .glb. STL and GLB round positions to
            float32; STL also loses vertex numbers and vertices without a face.
        mesh: the mesh.
        like: what the file has beside positions and triangles: a document, a model with its
            document, or the path of a file or directory of shapes. None, or one without anything
            more, writes positions and triangles alone.

    Raises:
        InputError: an unknown suffix, a directory that is missing or not writable, or a document
            of another mesh.
    """
    target = checked_path(path, "path")
    checked_instance(mesh, "mesh", Mesh, remedy="make one of vertices and faces")
    document = document_of(like)
    if document is None or target.suffix.lower() not in MESH_SUFFIXES:
        save_bare_mesh(target, mesh)
        return
    document.check_fits(len(mesh.vertices), mesh.faces)
    with atomic_path(target) as temporary:
        temporary.write_bytes(document.write(mesh.vertices, target.suffix))


def document_of(like: object) -> Document | None:
    """The document that `like` of `save_mesh` stands for.

    Raises:
        InputError: something else, or a file that cannot be read.
    """
    if like is None or isinstance(like, Document):
        return like
    if isinstance(like, str | Path):
        return load_document(like)
    if isinstance(like, HasDocument):
        return like.document
    raise InputError(
        f"like: expected a document, a model or the path of a file of shapes, got "
        f"{shortened(like)}; give one of them"
    )
