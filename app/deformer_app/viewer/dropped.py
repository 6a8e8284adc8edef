"""What a file or folder that the user drops on the window is."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, get_args

from deformer import InputError, io

Kind = Literal["model", "shapes", "session", "handles", "poses", "picture", "mesh"]
_EXPECTED = "a model's folder, shapes, a session, handles, poses, a picture or a mesh"


def kind_of(path: Path) -> Kind:
    """Tell what a file or folder is for.

    Args:
        path: a model's folder, a folder or file of example shapes, a session, handles, a library of
            poses, a picture or film to pose by, or a mesh.

    Raises:
        InputError: it is none of these.
    """
    if path.is_dir():
        return "model" if io.kind_of(path) == "model" else "shapes"
    if path.suffix.lower() in io.MESH_SUFFIXES:
        return "mesh"
    found = io.kind_of(path)
    if found == "model":  # a file of its folder
        raise InputError(f"{path}: is a file of a model; drop its folder")
    for kind in get_args(Kind):
        if found == kind:
            return kind
    if path.suffix.lower() == ".json":
        io.read_value(path)  # a damaged file is told as that
    raise io.wrong_kind(path, _EXPECTED) or InputError(
        f"{path}: expected {_EXPECTED} ({', '.join(io.MESH_SUFFIXES)}); got none of these"
    )
