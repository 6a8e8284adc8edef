"""Point caches, MDD and PC2: positions of a mesh over time, whose faces another file has."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

import numpy as np

from deformer.errors import InputError
from deformer.io.atomic import check_file
from deformer.io.system_names import folded_name
from deformer.workspace import Empty, Rows, blocks, in_memory

CACHE_SUFFIXES = (".mdd", ".pc2")
_PC2_NAME = b"POINTCACHE2\0"
_PC2_HEADER = struct.Struct("<12siiffi")


def read_cache(path: Path, empty: Empty = in_memory) -> tuple[Rows, tuple[str, ...]]:
    """Positions (N, V, 3) of the frames of an MDD or PC2 file, and a name for each.

    Frames of MDD are named by their times, "walk 0.25 s", those of PC2 by their numbers, "walk
    frame 3".

    Args:
        path: the file; its suffix says which.
        empty: makes the array of the positions.

    Raises:
        InputError: the file is missing, or its size is not that of its header.
    """
    check_file(path)
    size = path.stat().st_size
    with path.open("rb") as file:
        if path.suffix.lower() == ".mdd":
            return _read_mdd(file, size, path, empty)
        return _read_pc2(file, size, path, empty)


def _read_mdd(file: BinaryIO, size: int, path: Path, empty: Empty) -> tuple[Rows, tuple[str, ...]]:
    """MDD is big-endian: counts of frames and points, times, then positions."""
    if size < 8:
        raise _damaged(path, f"{size} bytes", "8 of a header or more")
    frames, points = struct.unpack(">ii", file.read(8))
    _check_counts(path, frames, points, size - 8, 4 * frames + 12 * frames * points)
    times = np.frombuffer(file.read(4 * frames), ">f4")
    names = tuple(f"{path.stem} {time:.4g} s" for time in times.tolist())
    return _positions(file, ">f4", frames, points, empty), names


def _read_pc2(file: BinaryIO, size: int, path: Path, empty: Empty) -> tuple[Rows, tuple[str, ...]]:
    """PC2 is little-endian: a name, version, points, first frame, frames a sample, samples."""
    header = file.read(_PC2_HEADER.size)
    if len(header) < _PC2_HEADER.size or not header.startswith(_PC2_NAME):
        raise _damaged(path, f"{header[:12]!r}", "POINTCACHE2 and a header")
    _, version, points, start, rate, frames = _PC2_HEADER.unpack_from(header)
    if version != 1:
        raise _damaged(path, f"version {version}", "version 1")
    _check_counts(path, frames, points, size - _PC2_HEADER.size, 12 * frames * points)
    names = tuple(f"{path.stem} frame {start + n * rate:.6g}" for n in range(frames))
    return _positions(file, "<f4", frames, points, empty), names


def _check_counts(path: Path, frames: int, points: int, found: int, expected: int) -> None:
    if frames < 1 or points < 1 or found != expected:
        raise _damaged(
            path,
            f"{found} bytes after the header",
            f"{expected} of {frames} frames of {points} points",
        )


def _positions(file: BinaryIO, kind: str, frames: int, points: int, empty: Empty) -> Rows:
    """Positions (N, V, 3) that follow in a file, read some frames at a time."""
    found = empty((frames, points, 3))
    for part in blocks(found):
        count = part.stop - part.start
        stored = np.frombuffer(file.read(12 * count * points), kind, 3 * count * points)
        found[part] = stored.reshape(count, points, 3)
    return found


def _damaged(path: Path, found: str, expected: str) -> InputError:
    return InputError(
        f"{path}: found {found}, expected {expected}; the cache is cut short or damaged, export it "
        "again"
    )


def base_of(path: Path, suffixes: tuple[str, ...]) -> Path:
    """The mesh beside a cache that has its stem.

    Args:
        path: the cache.
        suffixes: suffixes of mesh files.

    Raises:
        InputError: there is none, or several.
    """
    beside = sorted(
        entry
        for entry in path.parent.iterdir()
        if folded_name(entry.stem) == folded_name(path.stem)
        and entry.suffix.lower() in suffixes
        and entry.is_file()
    )
    # Where the system tells apart what others do not, the cache's own stem goes first.
    found = [entry for entry in beside if entry.stem == path.stem] or beside
    if len(found) == 1:
        return found[0]
    if found:
        names = " and ".join(entry.name for entry in found[:3])
        raise InputError(
            f"{path}: {names} beside it, expected one mesh named {path.stem} for its faces; move "
            "the others away"
        )
    raise InputError(
        f"{path}: no mesh beside it, expected one such as {path.stem}.obj for its faces; export "
        "the mesh under that name into the folder"
    )
