"""Poses and sequences as files, in the format of the output's suffix."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import deformer
from deformer_app import console

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deformer import DeformationModel


@dataclass(frozen=True)
class Timing:
    """How a sequence is written: arguments of `deformer.save_shapes`."""

    fps: float = 24.0
    tolerance: float = 1e-3
    name: str | None = None


def is_sequence_file(path: Path) -> bool:
    """True if a suffix names a format of sequences; without one it is a directory."""
    return path.suffix.lower() in deformer.SEQUENCE_SUFFIXES


def folder_beside(path: Path) -> Path | None:
    """The folder of an output, for temporary files; None if there is none, or it is read-only.

    The output itself is checked by `check_output`, once its kind is known.
    """
    folder = path.absolute().parent
    return folder if folder.is_dir() and os.access(folder, os.W_OK) else None


def check_output(path: Path, is_sequence: bool) -> None:
    """Raise InputError, before any work, if a pose or a sequence cannot be written to `path`."""
    if is_sequence:
        deformer.check_shapes_output(path)
        return
    deformer.check_mesh_output(path)


def check_one(path: Path, count: int) -> None:
    """Raise InputError, before any work, unless one file is named for one sequence.

    Args:
        path: the file.
        count: how many sequences there are.
    """
    deformer.check_shapes_output(path)
    if count != 1:
        raise deformer.InputError(
            f"{path}: names one file for {count} sequences; name a directory, or ask for one"
        )


def save(
    path: Path,
    model: DeformationModel,
    vertices: NDArray,
    bare: bool,
    timing: Timing | None = None,
) -> dict[str, Any]:
    """Write one pose (V, 3) as a mesh, or a sequence (F, V, 3) as the suffix says.

    Args:
        path: the file or directory.
        model: whose document the files are like.
        vertices: the pose or the sequence.
        bare: write positions and triangles alone.
        timing: of sequences.

    Returns:
        what came of a sequence: its files, and of a GLB the morph targets.
    """
    faces, like = model.reference.faces, None if bare else model
    up = model.up
    if vertices.ndim == 2:
        deformer.save_mesh(path, deformer.Mesh(vertices, faces), like=like, up=up)
        _name_libraries(path, like)
        return {}
    return save_sequence(path, model, deformer.MeshSequence(vertices, faces), bare, timing)


def save_sequence(
    path: Path,
    model: DeformationModel,
    shapes: deformer.MeshSequence | deformer.StoredShapes,
    bare: bool,
    timing: Timing | None = None,
) -> dict[str, Any]:
    """Write a sequence, wherever it is, as the suffix says; arguments and result as of `save`."""
    given = timing or Timing()
    saved = deformer.save_shapes(
        path,
        shapes,
        like=None if bare else model,
        fps=given.fps,
        tolerance=given.tolerance,
        name=given.name,
        up=model.up,
    )
    found: dict[str, Any] = {"files": [str(file) for file in saved.files]}
    if saved.targets is not None:
        found["morph_targets"] = saved.targets
        found["morph_error"] = saved.error
        if not saved.principal:
            found["morph_note"] = "one target a frame: the frames have too little in common"
    return found


def _name_libraries(path: Path, like: DeformationModel | None) -> None:
    """Note the material libraries that an OBJ file needs beside it."""
    document = like.document if like is not None else None
    if document is None or path.suffix.lower() != ".obj":
        return
    missing = [name for name in document.libraries if not (path.parent / Path(name).name).exists()]
    if missing:
        console.note(f"{path.name} takes its materials from {missing[0]}: copy that beside it")
