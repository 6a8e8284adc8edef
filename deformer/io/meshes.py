"""Write meshes and sequences of shapes.

Vertex count and order are always the shapes' own: nothing is merged, split or sorted. OBJ, OFF, PLY
and NPZ keep float64 exactly; the formats GLB and STL have float32; STL has no vertices at all.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from deformer.checks import checked_instance, checked_path, checked_text, shortened
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, Mesh, MeshSequence, ShapeSequence
from deformer.io.atomic import PathLike, atomic_path, check_output_file
from deformer.io.directories import atomic_directory, check_directory
from deformer.io.glb import write_glb
from deformer.io.locks import locked
from deformer.io.obj import write_obj
from deformer.io.off import write_off
from deformer.io.ply import write_ply
from deformer.io.stl import write_stl
from deformer.workspace import StoredArray, blocks

_WRITERS: dict[str, Callable[[FloatArray, IntArray], bytes]] = {
    ".obj": write_obj,
    ".ply": write_ply,
    ".off": write_off,
    ".stl": write_stl,
    ".glb": write_glb,
}
MESH_SUFFIXES = tuple(_WRITERS)
"""Suffixes of the mesh files that this package writes."""
_SUFFIX_LIST = ", ".join(MESH_SUFFIXES)
_WITH_DOCUMENT = (".usd", ".usda", ".usdc")  # written by functions that are given
_WAIT = 30.0  # seconds for another process that writes the same directory
_WRITTEN_NAME = re.compile(r"\d{4,}\.(obj|ply|off|stl|glb|usd|usda|usdc)")


def save_mesh(path: PathLike, mesh: Mesh) -> None:
    """Write one mesh in the format of the suffix; an existing file is replaced once all is written.

    Args:
        path: the file, named .obj, .ply, .off, .stl or .glb. STL and GLB round positions to
            float32; STL also loses vertex numbers and vertices without a face.
        mesh: the mesh.

    Raises:
        InputError: an unknown suffix, or a directory that is missing or not writable.
    """
    target = checked_path(path, "path")
    checked_instance(mesh, "mesh", Mesh, remedy="make one of vertices and faces")
    if target.suffix.lower() not in _WRITERS:
        raise _unknown_suffix(target)
    with atomic_path(target) as temporary:
        temporary.write_bytes(mesh_bytes(mesh, target.suffix))


def mesh_bytes(mesh: Mesh, suffix: str) -> bytes:
    """Contents of a file with the positions and triangles of a mesh.

    Args:
        mesh: the mesh.
        suffix: suffix of the format, as of `save_mesh`.

    Raises:
        InputError: an unknown suffix.
    """
    checked_instance(mesh, "mesh", Mesh, remedy="make one of vertices and faces")
    writer = _WRITERS.get(checked_text(suffix, "suffix").lower())
    if writer is None:
        raise InputError(
            f"suffix: expected one of {_SUFFIX_LIST}, got {shortened(suffix)}; choose one"
        )
    return writer(mesh.vertices, mesh.faces)


def save_shapes(path: PathLike, shapes: MeshSequence, format: str = "ply") -> None:
    """Write a sequence as one NPZ, or as a directory of files 0000, 0001, ….

    Args:
        path: a file named .npz, or a directory. An existing directory is replaced as a whole if
            this function has written all its files.
        shapes: the sequence.
        format: "obj", "ply", "off", "stl" or "glb", for a directory; see `save_mesh` on precision.

    Raises:
        InputError: an unknown format, a directory with other contents, or a parent that is
            missing or not writable.
    """
    target = checked_path(path, "path")
    checked_instance(shapes, "shapes", MeshSequence, remedy="make one of vertices and faces")
    checked_text(format, "format")
    check_shapes_output(target)
    if target.suffix.lower() == ".npz":
        write_npz(target, {"vertices": shapes.vertices, "faces": shapes.faces})
    else:
        save_shape_files(target, shapes, format)


def save_shape_files(
    path: PathLike,
    shapes: ShapeSequence,
    format: str,
    write: Callable[[FloatArray, str], bytes] | None = None,
) -> None:
    """Write a sequence as a directory of files, as `save_shapes` does.

    Args:
        path: the directory.
        shapes: the sequence.
        format: as of `save_shapes`.
        write: contents of a file of vertices (V, 3) and a suffix; None for positions and triangles
            alone.

    Raises:
        InputError: as of `save_shapes`.
    """
    target = checked_path(path, "path")
    suffix = f".{format.lower().removeprefix('.')}"
    if suffix not in (_WRITERS if write is None else (*_WRITERS, *_WITH_DOCUMENT)):
        raise InputError(f"{target}: format {format!r}, expected one of {_SUFFIX_LIST}; choose one")
    digits = max(4, len(str(len(shapes) - 1)))
    with locked(target, _WAIT), atomic_directory(target, _is_written) as work:
        for i, vertices in enumerate(shapes.vertices):
            content = (
                _WRITERS[suffix](vertices, shapes.faces)
                if write is None
                else write(vertices, suffix)
            )
            (work / f"{i:0{digits}d}{suffix}").write_bytes(content)


def check_shapes_output(path: PathLike) -> None:
    """Check, before there are shapes, that `save_shapes` can write them to `path`.

    Raises:
        InputError: as `save_shapes` would raise.
    """
    target = checked_path(path)
    if target.suffix.lower() == ".npz":
        check_output_file(target)
    elif target.suffix.lower() in MESH_SUFFIXES:
        raise InputError(
            f"{target}: names one mesh file, expected a directory or .npz for a sequence; leave "
            "the suffix out"
        )
    else:
        check_directory(target, _is_written)


def _is_written(entry: Path) -> bool:
    return _WRITTEN_NAME.fullmatch(entry.name) is not None


def write_npz(path: PathLike, arrays: Mapping[str, Any]) -> None:
    """Write arrays as a compressed NPZ; an existing file is replaced once all is written.

    `load_shapes` reads the arrays `vertices` and `faces` and ignores all others.

    Args:
        path: the file; its directory must exist.
        arrays: name → array of numbers or text, written with its own dtype.

    Raises:
        InputError: the directory is missing or not writable.
    """
    checked_instance(arrays, "arrays", Mapping, remedy="give a dict")
    with (
        atomic_path(path) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                _write_member(member, array)


def _write_member(member: IO[bytes], array: Any) -> None:
    """Write an array in numpy's format; one in a file some rows at a time."""
    if not isinstance(array, StoredArray):
        np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
        return
    header = {
        "descr": np.lib.format.dtype_to_descr(array.dtype),
        "fortran_order": False,
        "shape": array.shape,
    }
    np.lib.format.write_array_header_1_0(member, header)
    for part in blocks(array):
        member.write(array[part].tobytes())


def _unknown_suffix(path: Path) -> InputError:
    return InputError(
        f"{path}: suffix {path.suffix!r}, expected one of {_SUFFIX_LIST}; give the file one of them"
    )
