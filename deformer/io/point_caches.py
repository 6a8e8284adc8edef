"""Point caches, MDD and PC2: positions of a mesh over time, whose faces another file has."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from deformer.errors import InputError
from deformer.geometry import FloatArray
from deformer.io.atomic import read_bytes

CACHE_SUFFIXES = (".mdd", ".pc2")
_PC2_NAME = b"POINTCACHE2\0"
_PC2_HEADER = struct.Struct("<12siiffi")


def read_cache(path: Path) -> tuple[FloatArray, tuple[str, ...]]:
    """Positions (N, V, 3) of the frames of an MDD or PC2 file, and a name for each.

    Frames of MDD are named by their times, "walk 0.25 s", those of PC2 by their numbers, "walk
    frame 3".

    Args:
        path: the file; its suffix says which.

    Raises:
        InputError: the file is missing, or its size is not that of its header.
    """
    data = read_bytes(path)
    if path.suffix.lower() == ".mdd":
        return _read_mdd(data, path)
    return _read_pc2(data, path)


def _read_mdd(data: bytes, path: Path) -> tuple[FloatArray, tuple[str, ...]]:
    """MDD is big-endian: counts of frames and points, times, then positions."""
    if len(data) < 8:
        raise _damaged(path, f"{len(data)} bytes", "8 of a header or more")
    frames, points = struct.unpack(">ii", data[:8])
    _check_counts(path, frames, points, len(data) - 8, 4 * frames + 12 * frames * points)
    times = np.frombuffer(data, ">f4", frames, 8)
    names = tuple(f"{path.stem} {time:.4g} s" for time in times.tolist())
    return _positions(data, ">f4", frames, points, 8 + 4 * frames), names


def _read_pc2(data: bytes, path: Path) -> tuple[FloatArray, tuple[str, ...]]:
    """PC2 is little-endian: a name, version, points, first frame, frames a sample, samples."""
    if len(data) < _PC2_HEADER.size or not data.startswith(_PC2_NAME):
        raise _damaged(path, f"{data[:12]!r}", "POINTCACHE2 and a header")
    _, version, points, start, rate, frames = _PC2_HEADER.unpack_from(data)
    if version != 1:
        raise _damaged(path, f"version {version}", "version 1")
    _check_counts(path, frames, points, len(data) - _PC2_HEADER.size, 12 * frames * points)
    names = tuple(f"{path.stem} frame {start + n * rate:.6g}" for n in range(frames))
    return _positions(data, "<f4", frames, points, _PC2_HEADER.size), names


def _check_counts(path: Path, frames: int, points: int, found: int, expected: int) -> None:
    if frames < 1 or points < 1 or found != expected:
        raise _damaged(
            path,
            f"{found} bytes after the header",
            f"{expected} of {frames} frames of {points} points",
        )


def _positions(data: bytes, kind: str, frames: int, points: int, start: int) -> FloatArray:
    stored = np.frombuffer(data, kind, 3 * frames * points, start)
    return stored.astype(np.float64).reshape(frames, points, 3)


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
    found = sorted(
        entry
        for entry in path.parent.iterdir()
        if entry.stem == path.stem and entry.suffix.lower() in suffixes and entry.is_file()
    )
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
