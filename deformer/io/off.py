"""Geomview OFF: positions and polygons as text, in the file's own order."""

from __future__ import annotations

import numpy as np

from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io.parsing import corner_indices, fan_triangles, positions

# In these variants x y z lead every vertex line; colours, normals and texture coordinates follow.
_HEADERS = (b"OFF", b"COFF", b"NOFF", b"CNOFF", b"STOFF", b"STCOFF", b"STNOFF", b"STCNOFF")


def read_off(data: bytes, name: str) -> tuple[FloatArray, IntArray]:
    """Positions (V, 3) and triangles (F, 3) of an OFF file.

    Args:
        data: contents of the file.
        name: file name for messages.

    Raises:
        InputError: a variant other than plain 3D text, a short file, garbage, or a face index
            out of range.
    """
    plain = _read_plain_triangles(data)
    if plain is not None:
        return plain
    rows, numbers = [], []
    for number, line in enumerate(data.splitlines(), 1):
        row = line.partition(b"#")[0].split()
        if row:
            rows.append(row)
            numbers.append(number)
    if not rows or rows[0][0] not in _HEADERS or b"BINARY" in rows[0]:
        found = rows[0][0][:20].decode("utf-8", "replace") if rows else "nothing"
        raise InputError(
            f"{name}: starts with {found!r}, expected 'OFF'; export it as text OFF with 3D points"
        )
    # The counts may share the line of the keyword.
    head = rows[0][1:]
    start = 1
    if not head and len(rows) > 1:
        head, start = rows[1], 2
    try:
        vertex_count, face_count = int(head[0]), int(head[1])
    except (ValueError, IndexError):
        raise InputError(
            f"{name}, line {numbers[start - 1]}: expected the counts of vertices and faces; "
            "export the file again"
        ) from None
    if vertex_count <= 0:
        raise InputError(f"{name}: no vertices, expected at least 3; export the file again")
    found = len(rows) - start
    if face_count < 0 or found < vertex_count + face_count:
        raise InputError(
            f"{name}: {found} lines follow the counts, expected {vertex_count} vertices and "
            f"{face_count} faces; the file is cut short, export it again"
        )
    middle = start + vertex_count
    vertices = positions(rows[start:middle], 0, name, lambda i: f"line {numbers[start + i]}")

    def where(i: int) -> str:
        return f"line {numbers[middle + i]}"

    polygons = []
    for i, row in enumerate(rows[middle : middle + face_count]):
        count = int(row[0]) if row[0].isdigit() else -1
        if count < 0 or len(row) < 1 + count:
            raise InputError(
                f"{name}, {where(i)}: expected a corner count and as many vertex indices; "
                "correct the line or export the file again"
            )
        polygons.append(row[1 : 1 + count])
    corners, counts = corner_indices(polygons, name, where)
    return vertices, fan_triangles(corners, counts, vertex_count, name, where)


def _read_plain_triangles(data: bytes) -> tuple[FloatArray, IntArray] | None:
    """The mesh of a file of positions and triangles alone; None if there is anything else.

    It ignores line ends and is about three times as fast as the full reader.
    """
    tokens = data.split()
    if tokens[:1] != [b"OFF"] or b"_" in data:
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
    return vertices, faces


def write_off(vertices: FloatArray, faces: IntArray) -> bytes:
    """OFF text of vertices (V, 3) and faces (F, 3), with the shortest decimals that are exact."""
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    return ("\n".join(lines) + "\n").encode("ascii")
