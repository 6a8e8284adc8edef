"""Wavefront OBJ: positions and polygons, in the file's own order."""

from __future__ import annotations

import re

import numpy as np

from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io.parsing import checked_polygons, corner_indices, plain_text, positions
from deformer.io.polygons import Polygons

_CONTINUED = re.compile(rb"^[ \t]*[vfVF](?=[ \t\\])(?:[^\n]*\\\r?\n)+", re.MULTILINE)
_UPPER = re.compile(rb"^ *[VF] ", re.MULTILINE)


class ObjReader:
    """Reads the files of one sequence; parses face lines only where they differ from the last file.

    Only `v` and `f` are read: texture coordinates and normals never split a vertex. A fourth
    coordinate (a weight of rational curves) and vertex colours are ignored, as are lines, points,
    groups and materials.
    """

    def __init__(self) -> None:
        """Start a sequence."""
        self._face_text = b""
        self._faces: Polygons | None = None

    def __call__(self, data: bytes, name: str) -> tuple[FloatArray, Polygons]:
        """Positions (V, 3) and polygons of an OBJ file.

        Args:
            data: contents of the file.
            name: file name for messages.

        Raises:
            InputError: no vertices or faces, garbage, or a face index out of range.
        """
        text = _normalised(plain_text(data, name))
        lines = [line.strip() for line in text.split(b"\n")]
        rows = [line.split() for line in lines if line[:2] == b"v " or line == b"v"]
        if not rows:
            raise InputError(
                f"{name}: no vertices, expected lines 'v x y z'; check that it is an OBJ file"
            )
        vertices = positions(rows, 1, name, lambda i: _line_of(text, b"v", i))
        face_lines = [line for line in lines if line[:2] == b"f " or line == b"f"]
        face_text = b"\n".join(face_lines)
        if (
            self._faces is None
            or face_text != self._face_text
            # A negative index counts back from the vertices read so far.
            or b"-" in face_text
        ):
            self._faces = _faces(face_lines, lines, text, len(vertices), name)
            self._face_text = face_text
        return vertices, self._faces


def _normalised(data: bytes) -> bytes:
    """Tabs and continuations as spaces, line ends as line feeds, keywords in lower case."""
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    if b"\\" in data:
        # Only v and f statements are continued: a comment or path may end in a backslash by chance.
        # \v replaces the line end, so that lines can still be counted.
        data = _CONTINUED.sub(
            lambda m: m[0].replace(b"\\\r\n", b" \v").replace(b"\\\n", b" \v"), data
        )
    data = data.replace(b"\t", b" ")
    # Most files have neither letter, and looking for them takes no time.
    if b"V " in data or b"F " in data:
        data = _UPPER.sub(lambda m: m[0].lower(), data)
    return data


def _line_of(text: bytes, keyword: bytes, index: int) -> str:
    """Line number, as text, of the statement number `index` among those of a `keyword`."""
    number = 1
    for line in text.split(b"\n"):
        if line.split(maxsplit=1)[:1] == [keyword]:
            if index == 0:
                break
            index -= 1
        number += 1 + line.count(b"\v")
    return f"line {number}"


def _faces(
    face_lines: list[bytes], lines: list[bytes], text: bytes, vertex_count: int, name: str
) -> Polygons:
    # "17/3/5" is vertex 17, texture coordinate 3, normal 5; only the vertex is used.
    plain = re.sub(rb"#[^\n]*|/[^\s#]*", b"", b"\n".join(face_lines))
    rows: list[list[bytes]] = []
    for line in plain.split(b"\n") if face_lines else []:
        rows.append(line.split()[1:])
        # It is refused below by this name; the rows after it need no memory.
        if len(rows[-1]) < 3:
            break

    def where(i: int) -> str:
        return _line_of(text, b"f", i)

    raw, counts = corner_indices(rows, name, where)
    corners = raw - 1
    if (raw < 0).any():
        is_vertex = np.array([line[:2] == b"v " for line in lines])
        is_face = np.array([line[:2] == b"f " or line == b"f" for line in lines])
        seen = np.cumsum(is_vertex)[is_face]
        corners = np.where(raw < 0, raw + np.repeat(seen[: len(counts)], counts), corners)
    return checked_polygons(corners, counts, vertex_count, name, where, written=raw, first=1)


def write_obj(vertices: FloatArray, faces: IntArray) -> bytes:
    """OBJ text of vertices (V, 3) and faces (F, 3), with the shortest decimals that are exact."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return ("\n".join(lines) + "\n").encode("ascii")
