"""Meshes written like the file that their shapes came from."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, runtime_checkable

from deformer.checks import checked_choice, checked_instance, checked_path, shortened
from deformer.documents.document import USD_SUFFIXES, Document, load_document
from deformer.documents.glb_axes import upright_glb
from deformer.documents.usd import write_usd
from deformer.errors import InputError
from deformer.geometry import Mesh
from deformer.io import (
    MESH_SUFFIXES,
    atomic_path,
    check_output_file,
    mesh_bytes,
    save_mesh as save_bare_mesh,
    usd_library,
)


@runtime_checkable
class HasDocument(Protocol):
    """An object, such as a model, that may have a document."""

    @property
    def document(self) -> Document | None:
        """The document."""
        ...


Like = Document | HasDocument | str | Path


def save_mesh(
    path: str | Path, mesh: Mesh, like: Like | None = None, *, up: str | None = None
) -> None:
    """Write one mesh in the format of the suffix; an existing file is replaced once all is written.

    Args:
        path: the file, named .obj, .ply, .off, .stl, .glb, .usd, .usda or .usdc. STL, GLB and USD
            round positions to float32; STL also loses vertex numbers and vertices without a face.
            USD needs the extra "usd".
        mesh: the mesh.
        like: what the file has beside positions and triangles: a document, a model with its
            document, or the path of a file or directory of shapes. None, or one without anything
            more, writes positions and triangles alone.
        up: "y" or "z", the axis that points up, unless the document is GLB or USD, which say so
            themselves; None is that of a model given as `like`, else y. USD says which; GLB has y
            up, so that files of other documents have a node that turns z up, which `load_shapes`
            and `load_mesh` leave out. Coordinates stay.

    Raises:
        InputError: an unknown suffix, a directory that is missing or not writable, or a document
            of another mesh.
    """
    target = checked_path(path, "path")
    checked_instance(mesh, "mesh", Mesh, remedy="make one of vertices and faces")
    up = up_of(like, up)
    document = document_of(like)
    suffix = target.suffix.lower()
    turned = suffix == ".glb" and up == "z"
    if suffix not in USD_SUFFIXES and (
        (document is None and not turned) or suffix not in MESH_SUFFIXES
    ):
        save_bare_mesh(target, mesh)
        return
    if document is not None:
        document.check_fits(len(mesh.vertices), mesh.faces)
    if suffix in USD_SUFFIXES:
        usd_library(target)
    with atomic_path(target) as temporary:
        if suffix in USD_SUFFIXES:
            shapes = mesh.vertices[None]
            write_usd(temporary, shapes, mesh.faces, document, name=target.stem, up=up)
            return
        temporary.write_bytes(_mesh_bytes(mesh, suffix, document, up))


def _mesh_bytes(mesh: Mesh, suffix: str, document: Document | None, up: str) -> bytes:
    points = mesh.vertices
    data = mesh_bytes(mesh, suffix) if document is None else document.write(points, suffix)
    return upright_glb(data, up, document) if suffix == ".glb" else data


def check_mesh_output(path: str | Path) -> None:
    """Check, before there is a mesh, that `save_mesh` can write it to `path`.

    Raises:
        InputError: as `save_mesh` would raise.
    """
    target = checked_path(path, "path")
    known = (*MESH_SUFFIXES, *USD_SUFFIXES)
    if target.suffix.lower() not in known:
        raise InputError(
            f"{target}: got suffix {target.suffix!r}, expected one of {', '.join(known)} for a "
            "single mesh; correct the name"
        )
    if target.suffix.lower() in USD_SUFFIXES:
        usd_library(target)
    check_output_file(target)


def up_of(like: object, up: str | None) -> str:
    """The axis that points up, "y" or "z": the given one, else that of a model, else y.

    Args:
        like: as of `save_mesh`.
        up: "y", "z" or None.

    Raises:
        InputError: another axis.
    """
    if up is None:
        # Objects that have a document need not say it; models do.
        return getattr(like, "up", "y") if isinstance(like, HasDocument) else "y"
    return checked_choice(up, "up", ("y", "z"))


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
