"""Kinds of files that the program reads or writes, for messages about a file at the wrong place."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from deformer.checks import checked_choice, checked_path, checked_text
from deformer.errors import InputError
from deformer.io.atomic import PathLike, read_bytes

FileKind = Literal[
    "session", "poses", "model", "split", "code", "report", "handles", "vertices", "shapes",
    "picture",
]  # fmt: skip
"""What a file or folder is, by its contents or its suffix."""


@dataclass(frozen=True)
class _Described:
    """What a kind is called, with its article, and what to do with such a file."""

    title: str
    use: str


_DESCRIBED: dict[FileKind, _Described] = {
    "session": _Described(
        "a session of the viewer",
        "open it by File > Open session or --session; File > Export handles then writes its "
        "handles",
    ),
    "poses": _Described(
        "a library of poses", "in the viewer, open its model and use File > Import poses"
    ),
    "model": _Described("a model", "name its folder where a model is asked for"),
    "split": _Described("a split into training and test shapes", "give it to --split"),
    "code": _Described(
        "the code of a shape", "give it to `deformer interpolate` or `deformer synthesize`"
    ),
    "report": _Described("a report of a command", "give another file: nothing reads it back"),
    "handles": _Described(
        "a handles file",
        "load it by File > Load handles (frames by Timeline > Load sequence), or give it to "
        "`deformer fit MODEL`",
    ),
    "vertices": _Described("a list of vertices", "give it to `deformer layout --exclude`"),
    "shapes": _Described(
        "a mesh or a sequence of meshes",
        "give it to `deformer check` and `deformer train`, or drop it on the viewer",
    ),
    "picture": _Described(
        "a picture or a film", "in the viewer, show it by File > Reference picture"
    ),
}
# Keys that an object of a kind has. The first kind counts: sessions have handles, too.
_KEYS: tuple[tuple[FileKind, frozenset[str]], ...] = (
    ("session", frozenset({"deformer_session"})),
    ("poses", frozenset({"deformer_poses"})),
    ("model", frozenset({"format", "connectivity", "config"})),
    ("split", frozenset({"train", "test"})),
    ("code", frozenset({"z"})),
    ("report", frozenset({"usable", "findings"})),  # of `deformer check`
    ("report", frozenset({"residual_rms", "iterations"})),  # of `deformer fit`
    ("report", frozenset({"method", "metric", "value"})),  # a row of `deformer evaluate`
    ("handles", frozenset({"handles"})),
    ("handles", frozenset({"frames"})),
    ("vertices", frozenset({"vertices"})),
)
SHAPE_SUFFIXES = (
    ".obj", ".ply", ".off", ".stl", ".glb", ".gltf", ".usd", ".usda", ".usdc", ".usdz", ".mdd",
    ".pc2",
)  # fmt: skip
"""Suffixes of the files of which a folder has one a shape, and of point caches."""
# Bytes beyond which JSON, such as handles of a million frames, is not read once more for a message.
_LARGEST_READ = 50_000_000
# Files that a model's folder has, and a folder of shapes has not.
_OF_MODELS = ("model.json", "weights.safetensors")
_PICTURES = (".png", ".jpg", ".jpeg", ".gif", ".mp4", ".mov", ".avi", ".mkv", ".webm")


def kind_of(path: PathLike) -> FileKind | None:
    """Tell what a file or folder is; None if it is of no kind, missing or damaged.

    Args:
        path: the file or folder. JSON is told by its keys, any other file by its suffix.
    """
    path = checked_path(path)
    try:
        if path.is_dir():
            if any((path / name).is_file() for name in _OF_MODELS):
                return "model"
            suffixes = {entry.suffix.lower() for entry in path.iterdir()}
            return "shapes" if suffixes.intersection(SHAPE_SUFFIXES) else None
        if not path.is_file():
            return None
    except OSError:  # such as a folder that may not be read
        return None
    suffix = path.suffix.lower()
    if suffix in (*SHAPE_SUFFIXES, ".npz"):
        return "shapes"
    return "picture" if suffix in _PICTURES else _kind_of_json(path)


def _kind_of_json(path: Path) -> FileKind | None:
    try:
        if path.stat().st_size > _LARGEST_READ:
            return None
        found: Any = json.loads(read_bytes(path))
    except (InputError, OSError, ValueError, RecursionError):
        return None
    if isinstance(found, list) and found:
        found = found[0]
    if not isinstance(found, dict):
        return None
    return next((kind for kind, keys in _KEYS if keys <= found.keys()), None)


def wrong_kind(path: PathLike, expected: FileKind | str) -> InputError | None:
    """The error that a file is of another kind than expected; None if it is of no known one.

    Args:
        path: the file or folder.
        expected: a kind, or a text that says what was expected.
    """
    checked_text(expected, "expected", remedy="give a kind or a text")
    found = kind_of(path)
    if found in (None, expected):
        return None
    title = _DESCRIBED[expected].title if expected in _DESCRIBED else expected
    return InputError(
        f"{path}: is {_DESCRIBED[found].title}, expected {title}; {_DESCRIBED[found].use}"
    )


@contextmanager
def expecting(path: PathLike, kind: FileKind) -> Iterator[None]:
    """Within the block, which reads `path`, an error says what the file is if not of `kind`.

    Raises:
        InputError: that of the block, or in its place that of `wrong_kind`; or `kind` is none.
    """
    checked_choice(kind, "kind", get_args(FileKind), remedy="give a kind of file")
    try:
        yield
    except InputError as error:
        told = wrong_kind(path, kind)
        if told is None:
            raise
        raise told from error
