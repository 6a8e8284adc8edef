"""Read and write meshes, sequences of shapes, splits and handle files.

Vertex count and order are always the file's own: nothing is merged, split or sorted. OBJ, OFF, PLY
and NPZ keep float64 exactly; the formats GLB and STL have float32; STL has no vertices at all, so
corners with equal positions are welded (see `load_shapes`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from deformer.checks import checked_instance, checked_path, checked_text
from deformer.errors import InputError
from deformer.geometry import FARTHEST, FloatArray, IntArray, Mesh, MeshSequence
from deformer.io.atomic import (
    PathLike,
    atomic_path,
    check_file,
    check_output_file,
    read_bytes,
)
from deformer.io.directories import atomic_directory, check_directory
from deformer.io.glb import read_glb, write_glb
from deformer.io.json_files import (
    HandleFile,
    HandleTarget,
    load_handles,
    load_split,
    read_json,
    write_json,
)
from deformer.io.locks import locked
from deformer.io.npz import read_npz
from deformer.io.obj import ObjReader, write_obj
from deformer.io.off import read_off, write_off
from deformer.io.ply import read_ply, write_ply
from deformer.io.stl import StlReader, write_stl

__all__ = [
    "MESH_SUFFIXES",
    "HandleFile",
    "HandleTarget",
    "atomic_directory",
    "atomic_path",
    "check_shapes_output",
    "load_handles",
    "load_mesh",
    "load_shapes",
    "load_split",
    "read_json",
    "save_mesh",
    "save_shapes",
    "shape_files",
    "write_json",
    "write_npz",
]

_Reader = Callable[[bytes, str], tuple[FloatArray, IntArray]]

# Readers keep state from file to file of one sequence: every sequence gets a new one.
_READERS: dict[str, Callable[[], _Reader]] = {
    ".obj": ObjReader,
    ".ply": lambda: read_ply,
    ".off": lambda: read_off,
    ".stl": StlReader,
    ".glb": lambda: read_glb,
}
_WRITERS: dict[str, Callable[[FloatArray, IntArray], bytes]] = {
    ".obj": write_obj,
    ".ply": write_ply,
    ".off": write_off,
    ".stl": write_stl,
    ".glb": write_glb,
}
MESH_SUFFIXES = tuple(_READERS)
_SUFFIX_LIST = ", ".join(MESH_SUFFIXES)
_WAIT = 30.0  # seconds for another process that writes the same directory
_WRITTEN_NAME = re.compile(r"\d{4,}\.(obj|ply|off|stl|glb)")


def load_shapes(path: PathLike, progress: Callable[[int, int], None] | None = None) -> MeshSequence:
    """Load shapes that share one connectivity.

    STL corners that coincide exactly in the first shape are welded in all shapes.

    Args:
        path: a directory of OBJ, PLY, OFF, STL or GLB files of one format, read in natural order
            of their names (2 before 10; other and hidden files are ignored); or one NPZ with
            `vertices` (N, V, 3) or (V, 3) and `faces` (F, 3); or one mesh file.
        progress: called with the numbers of files read and of all files.

    Raises:
        InputError: a file is missing, broken or of another kind, or differs from the first in
            vertex count or faces.
    """
    source = checked_path(path, "path")
    if source.is_dir():
        return _load_files(_shape_files(source), progress)
    if source.suffix.lower() == ".npz":
        shapes = _load_npz(source)
        if progress:
            progress(1, 1)
        return shapes
    return _load_files([source], progress)


def shape_files(path: PathLike) -> list[Path]:
    """The files that `load_shapes` reads, in its order.

    Args:
        path: as of `load_shapes`.

    Raises:
        InputError: a directory without meshes, with several formats, or with something named as a
            mesh that is no file.
    """
    source = checked_path(path)
    return _shape_files(source) if source.is_dir() else [source]


def load_mesh(path: PathLike) -> Mesh:
    """Load one OBJ, PLY, OFF, STL or GLB file.

    Args:
        path: the file; its suffix is that of the format.

    Raises:
        InputError: the file is missing, broken or of another kind.
    """
    return _load_files([checked_path(path, "path")], None).mesh(0)


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
    writer = _WRITERS.get(target.suffix.lower())
    if writer is None:
        raise _unknown_suffix(target)
    with atomic_path(target) as temporary:
        temporary.write_bytes(writer(mesh.vertices, mesh.faces))


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
        return
    suffix = f".{format.lower().removeprefix('.')}"
    if suffix not in _WRITERS:
        raise InputError(f"{target}: format {format!r}, expected one of {_SUFFIX_LIST}; choose one")
    digits = max(4, len(str(len(shapes) - 1)))
    with locked(target, _WAIT), atomic_directory(target, _is_written) as work:
        for i, vertices in enumerate(shapes.vertices):
            content = _WRITERS[suffix](vertices, shapes.faces)
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
    # Through a stream: numpy would append a suffix to a name that has none.
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


def _shape_files(directory: Path) -> list[Path]:
    files = [
        entry
        for entry in directory.iterdir()
        if entry.suffix.lower() in MESH_SUFFIXES and not entry.name.startswith(".")
        if not entry.is_dir()
    ]
    if not files:
        raise InputError(
            f"{directory}: no mesh files, expected {_SUFFIX_LIST}; check the path or put the "
            "shapes there"
        )
    from natsort import natsorted

    files = natsorted(files, key=lambda file: file.name)
    for file in files:
        if not file.is_file():
            check_file(file)
    first = files[0]
    for file in files:
        if file.suffix.lower() != first.suffix.lower():
            raise InputError(
                f"{directory}: holds {first.name} and {file.name}, expected one format; keep the "
                "shapes in one format and move the others away"
            )
    return files


def _load_files(files: list[Path], progress: Callable[[int, int], None] | None) -> MeshSequence:
    first = files[0]
    if first.suffix.lower() not in _READERS:
        if not first.exists():
            raise InputError(f"{first}: does not exist; check the path")
        raise _unknown_suffix(first)
    read = _READERS[first.suffix.lower()]()
    shared: IntArray | None = None
    all_vertices: FloatArray = np.empty((0, 0, 3))
    for i, file in enumerate(files):
        vertices, faces = _read_file(file, read)
        _check_finite(vertices, str(file))
        if shared is None:
            shared = faces
            all_vertices = np.empty((len(files), *vertices.shape))
        if len(vertices) != all_vertices.shape[1]:
            raise InputError(
                f"{file}: {len(vertices)} vertices, expected {all_vertices.shape[1]} as in "
                f"{first.name}; export all shapes with one connectivity"
            )
        if faces is not shared and not np.array_equal(faces, shared):
            _raise_other_faces(file, faces, first, shared)
        all_vertices[i] = vertices
        if progress:
            progress(i + 1, len(files))
    return MeshSequence(all_vertices, shared if shared is not None else np.empty((0, 3), int))


def _read_file(file: Path, read: _Reader) -> tuple[FloatArray, IntArray]:
    data = read_bytes(file)
    try:
        # Overflow gives infinite positions, which are refused by name.
        with np.errstate(all="ignore"):
            return read(data, str(file))
    except InputError:
        raise
    # Readers refuse what they know; a damaged file can break them in ways nobody thought of.
    except Exception as error:
        raise InputError(
            f"{file}: damaged in a way that stops the reader ({type(error).__name__}); export the "
            "file again"
        ) from error


def _raise_other_faces(file: Path, faces: IntArray, first: Path, shared: IntArray) -> NoReturn:
    if len(faces) != len(shared):
        difference = f"{len(faces)} triangles, expected {len(shared)}"
    else:
        i = int(np.flatnonzero((faces != shared).any(axis=1))[0])
        difference = f"triangle {i} is {faces[i].tolist()}, expected {shared[i].tolist()}"
    raise InputError(
        f"{file}: {difference} as in {first.name}; export all shapes with one connectivity and "
        "vertex order"
    )


def _check_finite(vertices: FloatArray, name: str) -> None:
    bad = np.flatnonzero(~(np.abs(vertices) <= FARTHEST).all(axis=1))
    if len(bad):
        raise InputError(
            f"{name}, vertex {bad[0]}: found {vertices[bad[0]].tolist()}, expected a position "
            f"within ±{FARTHEST:g}; repair or remove it"
        )


def _unknown_suffix(path: Path) -> InputError:
    return InputError(
        f"{path}: suffix {path.suffix!r}, expected one of {_SUFFIX_LIST}; convert the file or "
        "correct its name"
    )


def _load_npz(path: Path) -> MeshSequence:
    arrays = read_npz(path, ("vertices", "faces"))
    vertices, faces = arrays["vertices"], arrays["faces"]
    if vertices.dtype.kind not in "fiu":
        raise InputError(f"{path}: vertices of type {vertices.dtype}, expected floats; cast them")
    try:
        return MeshSequence(vertices[None] if vertices.ndim == 2 else vertices, faces)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
