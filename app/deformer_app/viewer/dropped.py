"""What a file or folder that the user drops on the window is."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from deformer import InputError, io

Kind = Literal["model", "shapes", "session", "handles", "mesh"]


def kind_of(path: Path) -> Kind:
    """Tell what a file or folder is for.

    Args:
        path: a model's folder, a folder or file of example shapes, a session, handles or a mesh.

    Raises:
        InputError: it is none of these.
    """
    if path.is_dir():
        return "model" if (path / "model.json").is_file() else "shapes"
    suffix = path.suffix.lower()
    if suffix == ".json":
        found = io.read_value(path)
        if "deformer_session" in found:
            return "session"
        if "handles" in found or "frames" in found:
            return "handles"
        raise InputError(f"{path}: expected a session or handles; it has neither")
    if suffix in io.MESH_SUFFIXES:
        return "mesh"
    if suffix == ".npz" or suffix in io.SHAPE_SUFFIXES:
        return "shapes"
    raise InputError(
        f"{path}: expected a model's folder, shapes, a session, handles or a mesh "
        f"({', '.join(io.MESH_SUFFIXES)}); got a file with another ending"
    )
