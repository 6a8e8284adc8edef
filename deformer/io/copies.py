"""Copies of sets of shapes with changed positions or connectivity, in the files they came in."""

from __future__ import annotations

import shutil
from collections.abc import Collection
from pathlib import Path

import numpy as np

from deformer.checks import checked_path
from deformer.errors import InputError
from deformer.geometry import IntArray, Mesh, MeshSequence
from deformer.io.atomic import PathLike
from deformer.io.directories import atomic_directory, check_directory
from deformer.io.loading import shape_files
from deformer.io.meshes import save_mesh, write_npz
from deformer.io.npz import read_npz
from deformer.io.point_caches import CACHE_SUFFIXES


def check_copy(source: PathLike, folder: PathLike) -> None:
    """Raise InputError if `save_copy` could not write.

    Args:
        source: as of `save_copy`.
        folder: as of `save_copy`.
    """
    origin = checked_path(source, "source").resolve()
    target = checked_path(folder, "folder").resolve()
    if target == origin or target in origin.parents:
        what = "is" if target == origin else "contains"
        raise InputError(f"{folder}: {what} the input {source}, which would be lost; choose "
                         "another directory")  # fmt: skip
    names = _copied_names(shape_files(source))
    check_directory(folder, lambda entry: entry.name in names)


def copied_path(source: PathLike, folder: PathLike, count: int) -> Path:
    """What `load_shapes` reads the copy of `count` shapes from.

    Args:
        source: as of `save_copy`.
        folder: as of `save_copy`.
        count: how many shapes the source has.
    """
    files = shape_files(source)
    target = checked_path(folder, "folder")
    if _is_one_file_of_many(files, count):
        return target / f"{files[0].stem}.npz"
    return target if checked_path(source, "source").is_dir() else target / files[0].name


def _is_one_file_of_many(files: list[Path], count: int) -> bool:
    """True for one file of several shapes, such as morph targets or frames, that is no NPZ."""
    file = files[0]
    if len(files) != 1 or file.suffix.lower() == ".npz":
        return False
    return count > 1 or file.suffix.lower() in CACHE_SUFFIXES


def _copied_names(files: list[Path]) -> set[str]:
    return {file.name for file in files} | {f"{file.stem}.npz" for file in files[:1]}


def save_copy(
    source: PathLike,
    folder: PathLike,
    shapes: MeshSequence,
    *,
    changed: Collection[int],
    kept: IntArray,
    faces_changed: bool,
) -> tuple[str, ...]:
    """Write the changed set of a source under the source's file names, in its formats.

    One file of several shapes, such as of morph targets, becomes an NPZ of its stem. Files of
    shapes that did not change are copied byte for byte. The other arrays of an NPZ are
    kept; of those with a value for each vertex, the values of the vertices that are left.

    Args:
        source: what `load_shapes` read.
        folder: directory to write; an older copy of the same source in it is replaced.
        shapes: the changed set, N shapes as in the source.
        changed: indices of the shapes whose vertices changed.
        kept: (V',) former indices of the vertices that are left.
        faces_changed: true if the faces changed, too.

    Returns:
        Names of the mesh files that were written anew; they have positions and triangles alone.

    Raises:
        InputError: the folder is or contains the source, holds something else, or cannot be
            written.
    """
    check_copy(source, folder)
    files = shape_files(source)
    names = _copied_names(files)
    written = []
    with atomic_directory(folder, lambda entry: entry.name in names) as work:
        if _is_one_file_of_many(files, len(shapes)):
            name = f"{files[0].stem}.npz"
            write_npz(work / name, {"vertices": shapes.vertices, "faces": shapes.faces})
            return (name,)
        for n, file in enumerate(files):
            if file.suffix.lower() == ".npz":
                _copy_npz(file, work / file.name, shapes, kept)
            elif n in changed or faces_changed:
                save_mesh(work / file.name, Mesh(shapes.vertices[n], shapes.faces))
                written.append(file.name)
            else:
                shutil.copyfile(file, work / file.name)
    return tuple(written)


def _copy_npz(source: Path, target: Path, shapes: MeshSequence, kept: IntArray) -> None:
    arrays = read_npz(source, ("vertices", "faces"), others=True)
    old = arrays["vertices"]
    V = old.shape[-2]
    if len(kept) < V:
        for name, array in arrays.items():
            axes = [axis for axis in range(min(array.ndim, 2)) if array.shape[axis] == V]
            # The first axis of a value a vertex, the second of a value a shape and a vertex.
            if axes and name not in ("vertices", "faces"):
                arrays[name] = np.take(array, kept, axis=axes[0])
    vertices = shapes.vertices.reshape(*old.shape[:-2], len(kept), 3)
    arrays["vertices"] = vertices.astype(old.dtype if old.dtype.kind == "f" else np.float64)
    arrays["faces"] = shapes.faces.astype(arrays["faces"].dtype)
    write_npz(target, arrays)
