"""Read meshes and sequences of shapes.

Vertex count and order are always the file's own: nothing is merged, split or sorted. STL has no
vertices at all, so corners with equal positions are welded (see `load_shapes`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn, TypeVar, overload

import numpy as np

from deformer.checks import checked_instance, checked_path, shortened
from deformer.errors import InputError
from deformer.geometry import (
    FARTHEST,
    FloatArray,
    IntArray,
    Mesh,
    MeshSequence,
    ShapeSequence,
    StoredShapes,
    axes_text,
    axis_turn,
    shape_sequence,
)
from deformer.io.atomic import PathLike, check_file, read_bytes
from deformer.io.file_kinds import SHAPE_SUFFIXES, wrong_kind
from deformer.io.gltf import read_gltf
from deformer.io.gltf_shapes import GltfReader, read_shapes as read_gltf_shapes
from deformer.io.npz import read_npz, read_rows_of
from deformer.io.obj import ObjReader
from deformer.io.off import read_off
from deformer.io.ply import read_ply
from deformer.io.point_caches import CACHE_SUFFIXES, base_of, read_cache
from deformer.io.polygons import Polygons
from deformer.io.sampling import checked_fps
from deformer.io.stl import StlReader
from deformer.io.usd import UsdReader, read_usd_shapes
from deformer.workspace import Empty, Workspace, blocks, in_memory

_log = logging.getLogger("deformer")
_Reader = Callable[[bytes, str], tuple[FloatArray, Polygons]]
_Clip = str | int | None
T = TypeVar("T")

# Readers keep state from file to file of one sequence: every sequence gets a new one.
_READERS: dict[str, Callable[[], _Reader]] = {
    ".obj": ObjReader,
    ".ply": lambda: read_ply,
    ".off": lambda: read_off,
    ".stl": StlReader,
    ".glb": GltfReader,
    ".gltf": GltfReader,
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), UsdReader),
}
# Of files that may hold several shapes each.
_SEQUENCE_READERS: dict[str, Callable[[Path, float | None, _Clip, Empty], ShapeSequence]] = {
    ".glb": lambda path, fps, clip, empty: read_gltf_shapes(read_gltf(path), fps, clip, empty),
    ".gltf": lambda path, fps, clip, empty: read_gltf_shapes(read_gltf(path), fps, clip, empty),
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), read_usd_shapes),
}
_SUFFIX_LIST = ", ".join(SHAPE_SUFFIXES)


@overload
def load_shapes(
    path: PathLike,
    progress: Callable[[int, int], None] | None = None,
    *,
    fps: float | None = None,
    clip: str | int | None = None,
    workspace: None = None,
) -> MeshSequence: ...


@overload
def load_shapes(
    path: PathLike,
    progress: Callable[[int, int], None] | None = None,
    *,
    fps: float | None = None,
    clip: str | int | None = None,
    workspace: Workspace,
) -> ShapeSequence: ...


def load_shapes(
    path: PathLike,
    progress: Callable[[int, int], None] | None = None,
    *,
    fps: float | None = None,
    clip: str | int | None = None,
    workspace: Workspace | None = None,
) -> ShapeSequence:
    """Load shapes that share one connectivity.

    The names of the shapes are those of the files without suffixes, of the morph targets, or the
    times of the frames ("walk 0.25 s"); shapes of an NPZ have none.

    Polygons are cut into triangles by the first shape's positions, alike in all shapes: as fans
    around their first corners, concave ones by ear clipping. STL corners that coincide exactly in
    the first shape are welded in all shapes. Files that have the same faces in another order, or
    from another corner on, are taken with the first file's order, and the log says so.

    Positions of GLB and glTF are those of the scene, with y up; those of a file that this program
    wrote of data with z up are the data's own.

    Args:
        path: a directory of OBJ, PLY, OFF, STL, GLB, glTF or USD files of one format, in natural
            order of their names (2 before 10; other and hidden files are ignored), one shape each;
            or one NPZ with `vertices` (N, V, 3) or (V, 3) and `faces` (F, 3); or one mesh file. One
            GLB, glTF or USD file with morph targets (blend shapes) gives the shape without them,
            "base", then that with each, and last "default" if the file shows other weights than
            0; with an animation of points, weights, nodes or a skin it gives its frames. Or a
            point cache, MDD or PC2, beside one mesh file of the same stem, which has its faces; a
            directory may hold both.
        progress: called with the numbers of files read and of all files.
        fps: frames a second at which an animation is sampled; None is 24, and the file's own rate
            of USD and of a GLB clip of `deformer.save_shapes`.
        clip: the animation's name or number; None takes the clip of `deformer.save_shapes`, else
            morph targets if there are some, else the first animation.
        workspace: decides whether positions are in memory or, read some shapes at a time, in a
            temporary file; the result is then `StoredShapes`, for `examine` and `train`. None keeps
            them in memory.

    Raises:
        InputError: a file is missing, broken or of another kind, or differs from the first in
            vertex count or faces; there is no such clip; or no room for a temporary file.
    """
    source = checked_path(path, "path")
    fps = None if fps is None else checked_fps(fps)
    if clip is not None and (isinstance(clip, bool) or not isinstance(clip, str | int)):
        raise InputError(f"clip: expected a name or a number, got {shortened(clip)}; correct it")
    if workspace is not None:
        checked_instance(workspace, "workspace", Workspace, remedy="make one, or leave it out")
    shapes = _load(source, progress, fps, clip, workspace)
    if isinstance(shapes, StoredShapes):
        for part in blocks(shapes.vertices):
            for n, vertices in enumerate(shapes.vertices[part], start=part.start):
                _check_finite(vertices, f"{path}, shape {n}")
    return shapes


def _load(
    source: Path,
    progress: Callable[[int, int], None] | None,
    fps: float | None,
    clip: _Clip,
    workspace: Workspace | None,
) -> ShapeSequence:
    """Do what `load_shapes` does, whose arguments are checked."""
    empty = in_memory if workspace is None else workspace.doubles
    files = _shape_files(source) if source.is_dir() else [source]
    suffix = files[0].suffix.lower()
    if len(files) == 1 and suffix in _SEQUENCE_READERS:
        check_file(files[0])
        shapes = _guarded(files[0], lambda: _SEQUENCE_READERS[suffix](files[0], fps, clip, empty))
        if not shapes.names:
            shapes = replace(shapes, names=(files[0].stem,))
        if progress:
            progress(1, 1)
        return shapes
    if suffix in CACHE_SUFFIXES and clip is None:
        shapes = _load_cache(files[0], empty)
        if progress:
            progress(1, 1)
        return shapes
    if clip is not None:
        what = "several files, of which each gives one shape" if len(files) > 1 else "no animation"
        raise InputError(
            f"{source}: got clip {shortened(clip)} for {what}, expected one GLB, glTF or USD file; "
            "leave the clip out or name the file"
        )
    if suffix == ".npz":
        shapes = _load_npz(source, workspace)
        if progress:
            progress(1, 1)
        return shapes
    if suffix not in _READERS and files[0].exists():
        raise _unknown_suffix(files[0], (*SHAPE_SUFFIXES, ".npz"))
    return _load_files(files, progress, empty)


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


def load_mesh(path: PathLike, like: Mesh | None = None) -> Mesh:
    """Load one OBJ, PLY, OFF, STL, GLB, glTF or USD file.

    Of a file with morph targets, a skin or animations the mesh is as the file shows it: with its
    default weights and transforms, before any animation.

    Args:
        path: the file; its suffix is that of the format.
        like: a mesh of the same connectivity, whose triangles the result has: programs write
            faces in another order, or from another corner on, and polygons may be cut otherwise.
            Where the result is turned from it by 90° or 180° about an axis, the log says so.

    Raises:
        InputError: the file is missing, broken or of another kind, or a mesh of another
            connectivity than `like`.
    """
    file = checked_path(path, "path")
    if like is None:
        return _load_files([file], None, in_memory).mesh(0)
    checked_instance(like, "like", Mesh, remedy="load one with load_mesh")
    vertices, polygons = _read_file(file, _reader(file))
    _check_finite(vertices, str(file))
    faces = _guarded(file, lambda: polygons.triangles(vertices, str(file)))
    V = len(like.vertices)
    if len(vertices) == V and (np.array_equal(faces, like.faces) or polygons.covers(like.faces)):
        turn = axis_turn(vertices[None], like.vertices[None])
        if turn is not None:
            _log.warning(
                f"{file}: is turned from the other shapes, as if another axis pointed up; if so, "
                f"write it with their axes: {axes_text(turn)} in place of x, y, z"
            )
        return Mesh(vertices, like.faces)
    same = len(vertices) == V and len(faces) == len(like.faces)
    raise InputError(
        f"{file}: {len(vertices)} vertices and {len(faces)} triangles, expected the connectivity "
        f"of the other shapes, {V} and {len(like.faces)}"
        + (", and has other triangles" if same else "")
        + "; export it from the same mesh, vertices in the same order"
    )


def _shape_files(directory: Path) -> list[Path]:
    files = [
        entry
        for entry in directory.iterdir()
        if entry.suffix.lower() in SHAPE_SUFFIXES and not entry.name.startswith(".")
        if not entry.is_dir()
    ]
    caches = sorted(file for file in files if file.suffix.lower() in CACHE_SUFFIXES)
    if len(caches) > 1:
        raise InputError(
            f"{directory}: holds the point caches {caches[0].name} and {caches[1].name}, expected "
            "one; name the one to read"
        )
    # Its base mesh is beside it.
    files = caches or files
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


def _reader(file: Path) -> _Reader:
    """A reader of the files of one sequence, of which this is the first."""
    suffix = file.suffix.lower()
    if suffix in CACHE_SUFFIXES:
        raise InputError(
            f"{file}: is a point cache, expected one mesh; read its frames with load_shapes"
        )
    if suffix not in _READERS:
        if not file.exists():
            raise InputError(f"{file}: does not exist; check the path")
        raise _unknown_suffix(file, tuple(_READERS))
    return _READERS[suffix]()


def _load_files(
    files: list[Path], progress: Callable[[int, int], None] | None, empty: Empty
) -> ShapeSequence:
    first = files[0]
    read = _reader(first)
    vertices, polygons = _read_file(first, read)
    _check_finite(vertices, str(first))
    faces = _guarded(first, lambda: polygons.triangles(vertices, str(first)))
    all_vertices, first_vertices = empty((len(files), len(vertices), 3)), vertices
    reordered: list[str] = []
    for i, file in enumerate(files):
        if i > 0:
            vertices, others = _read_file(file, read)
            _check_finite(vertices, str(file))
            if len(vertices) != all_vertices.shape[1]:
                raise InputError(
                    f"{file}: {len(vertices)} vertices, expected {all_vertices.shape[1]} as in "
                    f"{first.name}; export all shapes with one connectivity"
                )
            if not others.equals(polygons) and not _alike(
                file, others, first, polygons, faces, first_vertices
            ):
                reordered.append(file.name)
        all_vertices[i : i + 1] = vertices[None]
        if progress:
            progress(i + 1, len(files))
    if reordered:
        _log.warning(
            f"{first.parent}: {len(reordered)} files, e.g. {reordered[0]}, have the faces of "
            f"{first.name} in another order or from another corner on; the order of {first.name} "
            "is used"
        )
    return shape_sequence(all_vertices, faces, tuple(file.stem for file in files))


def _alike(
    file: Path,
    found: Polygons,
    first: Path,
    polygons: Polygons,
    faces: IntArray,
    vertices: FloatArray,
) -> bool:
    """True if a file has the triangles of the first one, false if it has them in another order.

    Args:
        file: the file.
        found: its polygons.
        first: the first file.
        polygons: those of the first file.
        faces: triangles (F, 3) of the first file.
        vertices: positions (V, 3) of the first file.

    Raises:
        InputError: it has other ones.
    """
    if found.same_faces(polygons):
        return False
    # Such as quads that are cut already; with the first shape's positions, as the first file's.
    cut = _guarded(file, lambda: found.triangles(vertices, str(file)))
    if np.array_equal(cut, faces):
        return True
    if Polygons.of_triangles(cut).same_faces(Polygons.of_triangles(faces)):
        return False
    _raise_other_faces(file, cut, first, faces)


def _read_file(file: Path, read: _Reader) -> tuple[FloatArray, Polygons]:
    data = read_bytes(file)
    return _guarded(file, lambda: read(data, str(file)))


def _guarded(file: Path, read: Callable[[], T]) -> T:
    """What a reader of a file returns; InputError that names the file if it fails."""
    try:
        # Overflow gives infinite positions, which are refused by name.
        with np.errstate(all="ignore"):
            return read()
    except InputError as error:
        if str(file) in str(error):
            raise
        raise InputError(f"{file}: {error}") from None
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
        known = {_from_least(face) for face in shared.tolist()}
        lost = (i for i, face in enumerate(faces.tolist()) if _from_least(face) not in known)
        # Without one, some triangle comes more often than in the first file.
        i = next(lost, int(np.flatnonzero((faces != shared).any(axis=1))[0]))
        difference = f"triangle {i} is {faces[i].tolist()}, expected {shared[i].tolist()}"
    raise InputError(
        f"{file}: {difference} as in {first.name}; export all shapes with one connectivity and "
        "vertex order"
    )


def _from_least(face: list[int]) -> tuple[int, ...]:
    """Corners of a triangle from the least on, in its own direction."""
    at = face.index(min(face))
    return (*face[at:], *face[:at])


def _check_finite(vertices: FloatArray, name: str) -> None:
    bad = np.flatnonzero(~(np.abs(vertices) <= FARTHEST).all(axis=1))
    if len(bad):
        raise InputError(
            f"{name}, vertex {bad[0]}: found {vertices[bad[0]].tolist()}, expected a position "
            f"within ±{FARTHEST:g}; repair or remove it"
        )


def _unknown_suffix(path: Path, known: Sequence[str]) -> InputError:
    return wrong_kind(path, "shapes") or InputError(
        f"{path}: suffix {path.suffix!r}, expected one of {', '.join(known)}; convert the file or "
        "correct its name"
    )


def _load_cache(path: Path, empty: Empty) -> ShapeSequence:
    vertices, names = _guarded(path, lambda: read_cache(path, empty))
    base = base_of(path, tuple(_READERS))
    mesh = load_mesh(base)
    if len(mesh.vertices) != vertices.shape[1]:
        raise InputError(
            f"{path}: {vertices.shape[1]} points, expected {len(mesh.vertices)} as the vertices of "
            f"{base.name}; export both from one mesh, without modifiers that add vertices"
        )
    return _guarded(path, lambda: shape_sequence(vertices, mesh.faces, names))


def _load_npz(path: Path, workspace: Workspace | None) -> ShapeSequence:
    if workspace is not None:
        faces = read_npz(path, ("faces",))["faces"]
        vertices = read_rows_of(path, "vertices", workspace.doubles)
        if vertices.ndim == 3:
            return _guarded(path, lambda: shape_sequence(vertices, faces))
    arrays = read_npz(path, ("vertices", "faces"))
    vertices, faces = arrays["vertices"], arrays["faces"]
    if vertices.dtype.kind not in "fiu":
        raise InputError(f"{path}: vertices of type {vertices.dtype}, expected floats; cast them")
    try:
        return MeshSequence(vertices[None] if vertices.ndim == 2 else vertices, faces)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
