"""Geomview OFF: positions and polygons as text, in the file's own order."""

from __future__ import annotations

import re

import numpy as np

from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io.parsing import (
    checked_polygons,
    corner_indices,
    item_count,
    plain_text,
    positions,
    shown,
)
from deformer.io.polygons import Polygons

# In these variants x y z lead every vertex line; colours, normals and texture coordinates follow.
# All in capitals or none: nOFF is another format, with points of n coordinates.
_HEADER = re.compile(rb"(ST)?C?N?OFF|(st)?c?n?off")
# Files of the ModelNet collection have the first count right after the keyword: "OFF8 6 0".
_COUNT_IN_KEYWORD = re.compile(rb"\s*(?:OFF|off)(?=\d)")


def read_off(data: bytes, name: str) -> tuple[FloatArray, Polygons]:
    """Positions (V, 3) and polygons of an OFF file.

    Args:
        data: contents of the file.
        name: file name for messages.

    Raises:
        InputError: a variant other than plain 3D text, a short file, garbage, or a face index
            out of range.
    """
    data = plain_text(data, name)
    if keyword := _COUNT_IN_KEYWORD.match(data):
        data = keyword[0] + b" " + data[keyword.end() :]
    plain = _read_plain_triangles(data)
    if plain is not None:
        return plain
    rows = [row for line in data.splitlines() if (row := _tokens(line))]

    def where(row: int) -> str:
        numbers = [n for n, line in enumerate(data.splitlines(), 1) if _tokens(line)]
        return f"line {numbers[row]}"

    if not rows or not _HEADER.fullmatch(rows[0][0]) or b"BINARY" in rows[0]:
        found = rows[0][0][:20].decode("utf-8", "replace") if rows else "nothing"
        raise InputError(
            f"{name}: starts with {found!r}, expected 'OFF'; export it as text OFF with 3D points"
        )
    # The counts may share the line of the keyword.
    head = rows[0][1:]
    start = 1
    if not head and len(rows) > 1:
        head, start = rows[1], 2
    vertex_count, face_count = (item_count(token) for token in (*head, b"", b"")[:2])
    if vertex_count < 0 or face_count < 0:
        raise InputError(
            f"{name}, {where(start - 1)}: found {shown(head)}, expected the counts of "
            "vertices and faces; export the file again"
        )
    if vertex_count == 0:
        raise InputError(f"{name}: no vertices, expected at least 3; export the file again")
    found = len(rows) - start
    if found < vertex_count + face_count:
        raise InputError(
            f"{name}: {found} lines follow the counts, expected {vertex_count} vertices and "
            f"{face_count} faces; the file is cut short, export it again"
        )
    middle = start + vertex_count
    end = middle + face_count
    if end < len(rows):
        raise InputError(
            f"{name}, {where(end)}: found {shown(rows[end])} after {vertex_count} vertices "
            f"and {face_count} faces, expected the end of the file; correct the counts or remove "
            "the rest"
        )
    vertices = positions(rows[start:middle], 0, name, lambda i: where(start + i))

    polygons = []
    for i, row in enumerate(rows[middle:end]):
        count = item_count(row[0])
        if count < 0 or len(row) < 1 + count:
            raise InputError(
                f"{name}, {where(middle + i)}: expected a corner count and as many vertex indices; "
                "correct the line or export the file again"
            )
        polygons.append(row[1 : 1 + count])

    def where_face(i: int) -> str:
        return where(middle + i)

    corners, counts = corner_indices(polygons, name, where_face)
    return vertices, checked_polygons(corners, counts, vertex_count, name, where_face)


def _tokens(line: bytes) -> list[bytes]:
    return line.partition(b"#")[0].split()


def _read_plain_triangles(data: bytes) -> tuple[FloatArray, Polygons] | None:
    """The mesh of a file of positions and triangles alone; None if there is anything else.

    It ignores line ends and is about three times as fast as the full reader.
    """
    tokens = data.split()
    if tokens[:1] not in ([b"OFF"], [b"off"]) or b"_" in data:
        return None
    try:
        vertex_count, face_count = int(tokens[1]), int(tokens[2])
        middle = 4 + 3 * vertex_count
        if min(vertex_count, face_count) < 1 or len(tokens) != middle + 4 * face_count:
            return None
        vertices = np.array([float(token) for token in tokens[4:middle]]).reshape(-1, 3)
        polygons = np.array([int(token) for token in tokens[middle:]]).reshape(-1, 4)
    except (ValueError, IndexError, OverflowError):
        return None
    faces = polygons[:, 1:]
    if (
        (polygons[:, 0] != 3).any()
        or not np.isfinite(vertices).all()
        or (faces < 0).any()
        or (faces >= vertex_count).any()
    ):
        return None
    return vertices, Polygons.of_triangles(faces)


def write_off(vertices: FloatArray, faces: IntArray) -> bytes:
    """OFF text of vertices (V, 3) and faces (F, 3), with the shortest decimals that are exact."""
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    return ("\n".join(lines) + "\n").encode("ascii")
