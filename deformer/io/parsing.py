"""Shared parts of the mesh file readers: text, numbers, face indices."""

from __future__ import annotations

import codecs
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io.polygons import Polygons

# Where item number i is in the file, for an error message: "line 12", "face 3".
Where = Callable[[int], str]


def plain_text(data: bytes, name: str) -> bytes:
    """Text of a file in an encoding that extends ASCII, without a byte order mark.

    Args:
        data: contents of the file; a mark at its start says UTF-8 or UTF-16.
        name: file name for messages.

    Raises:
        InputError: the file is marked as UTF-16 and is not.
    """
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        try:
            return data.decode("utf-16").encode("utf-8")
        except UnicodeDecodeError as error:
            raise InputError(
                f"{name}: starts as UTF-16 text and ends or breaks at byte {error.start}; export "
                "the file again"
            ) from None
    return data.removeprefix(codecs.BOM_UTF8)


def item_count(token: bytes | str) -> int:
    """Value of a count, or −1 if `token` is no unsigned integer of at most 18 digits."""
    return int(token) if token.isdigit() and len(token) <= 18 else -1


def shown(tokens: Sequence[bytes]) -> str:
    """Tokens of a line for a message, cut to 60 characters."""
    return repr(b" ".join(tokens)[:60].decode("utf-8", "replace"))


def positions(rows: Sequence[Sequence[bytes]], start: int, name: str, where: Where) -> FloatArray:
    """Positions (n, 3) from tokens start, start+1, start+2 of every row; later tokens are ignored.

    Args:
        rows: tokens of n statements.
        start: index of the first coordinate in a row.
        name: file name for messages.
        where: describes statement i for messages.

    Raises:
        InputError: a row is short, or a token is not a finite number.
    """
    tokens = [token for row in rows for token in row[start : start + 3]]
    # float() accepts "1_000", as in Python source; in a mesh file it is an error.
    if len(tokens) == 3 * len(rows) and b"_" not in b"".join(tokens):
        try:
            values = np.array([float(token) for token in tokens]).reshape(-1, 3)
        except ValueError:
            pass
        else:
            if np.isfinite(values).all():
                return values
    for i, row in enumerate(rows):
        found = row[start : start + 3]
        if len(found) != 3 or not all(_is_finite_number(token) for token in found):
            raise InputError(
                f"{name}, {where(i)}: found {shown(found)} as a position, expected three finite "
                "numbers; correct the line or export the file again"
            )
    raise InputError(f"{name}: positions cannot be read; export the file again")


def _is_finite_number(token: bytes) -> bool:
    try:
        return b"_" not in token and bool(np.isfinite(float(token)))
    except ValueError:
        return False


def corner_indices(
    rows: Sequence[Sequence[bytes]], name: str, where: Where
) -> tuple[IntArray, IntArray]:
    """All tokens of all rows as integers in one array, and the count (n,) of tokens of every row.

    Args:
        rows: tokens of n statements.
        name: file name for messages.
        where: describes statement i for messages.

    Raises:
        InputError: a token is not an integer.
    """
    counts = np.array([len(row) for row in rows], dtype=np.int64)
    tokens = [token for row in rows for token in row]
    try:
        if b"_" not in b"".join(tokens):
            return np.array([int(token) for token in tokens], dtype=np.int64), counts
    except (ValueError, OverflowError):
        pass
    bad = next(i for i, row in enumerate(rows) if not all(_is_index(token) for token in row))
    raise InputError(
        f"{name}, {where(bad)}: found {shown(rows[bad])} as a face, expected vertex indices; "
        "correct the line or export the file again"
    )


def _is_index(token: bytes) -> bool:
    try:
        return b"_" not in token and abs(int(token)) < 2**63
    except ValueError:
        return False


def distinct(names: Iterable[str]) -> tuple[str, ...]:
    """The names, of which the second, third, … of the same text have " (2)", " (3)", ….

    What is no Unicode becomes question marks.
    """
    found: dict[str, None] = {}
    last: dict[str, int] = {}
    for given in names:
        wanted = name = given.encode("utf-8", "replace").decode()
        while wanted in found:
            last[name] = last.get(name, 1) + 1
            wanted = f"{name} ({last[name]})"
        found[wanted] = None
    return tuple(found)


def checked_polygons(
    corners: IntArray,
    counts: IntArray,
    vertex_count: int,
    name: str,
    where: Where,
    written: IntArray | None = None,
    first: int = 0,
) -> Polygons:
    """Polygons whose numbers of corners and indices are right.

    Args:
        corners: vertex indices of all polygons in one array, counted from 0.
        counts: (n,) corners of each polygon.
        vertex_count: vertices of the mesh.
        name: file name for messages.
        where: describes polygon i for messages.
        written: the indices as the file has them, for messages; `corners` if not given.
        first: index of the first vertex in the file's own counting, for messages.

    Raises:
        InputError: no polygon, a polygon of fewer than 3 corners, or an index out of range.
    """
    if len(counts) == 0:
        raise InputError(f"{name}: no faces, expected a triangle mesh; export it with its faces")
    short = np.flatnonzero(counts < 3)
    if len(short):
        raise InputError(
            f"{name}, {where(int(short[0]))}: a face of {counts[short[0]]} corners, expected at "
            "least 3; remove the face"
        )
    bad = np.flatnonzero((corners < 0) | (corners >= vertex_count))
    if len(bad):
        face = int(np.searchsorted(np.cumsum(counts), bad[0], side="right"))
        found = (corners if written is None else written)[bad[0]]
        raise InputError(
            f"{name}, {where(face)}: found vertex index {found}, expected "
            f"{first}…{vertex_count - 1 + first}; remove the face or add the missing vertices"
        )
    return Polygons(corners, counts)
