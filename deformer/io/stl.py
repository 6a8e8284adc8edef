"""STL: a triangle soup in float32, welded the same way over a sequence."""

from __future__ import annotations

import numpy as np

from deformer.errors import InputError
from deformer.geometry import FARTHEST, FloatArray, IntArray
from deformer.io.parsing import plain_text, positions, shown
from deformer.io.polygons import Polygons

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
# The lines of one facet of text: the words each begins with, and how many it has with its numbers.
_FACET = (
    ([b"facet", b"normal"], 5),
    ([b"outer", b"loop"], 2),
    *[([b"vertex"], 4)] * 3,
    ([b"endloop"], 1),
    ([b"endfacet"], 1),
)


class StlReader:
    """Reads the files of one sequence; corners that coincide in the first file are one vertex.

    Vertices are numbered by their first corner in the file. Corners that coincide only in a later
    file are different vertices.
    """

    def __init__(self) -> None:
        """Start a sequence."""
        self._first_corner: IntArray | None = None
        self._faces = np.empty((0, 3), dtype=np.int64)
        self._name = ""

    def __call__(self, data: bytes, name: str) -> tuple[FloatArray, Polygons]:
        """Positions (V, 3) and triangles (F, 3) of an STL file.

        Args:
            data: contents of the file.
            name: file name for messages.

        Raises:
            InputError: garbage, or corners welded by the first file that do not coincide here.
        """
        # Adding zero turns -0.0 into 0.0, which is the same position.
        corners = _corners(data, name) + 0.0
        if self._first_corner is None:
            bits = np.ascontiguousarray(corners).view("V24").ravel()
            _, first, label = np.unique(bits, return_index=True, return_inverse=True)
            order = np.argsort(first)
            rank = np.empty(len(order), dtype=np.int64)
            rank[order] = np.arange(len(order))
            self._first_corner = first[order]
            self._faces = rank[label].reshape(-1, 3)
            self._name = name
        if len(corners) != self._faces.size:
            raise InputError(
                f"{name}: {len(corners) // 3} triangles, expected {len(self._faces)} as in "
                f"{self._name}; export all shapes with one connectivity"
            )
        vertices = corners[self._first_corner]
        split = np.flatnonzero((corners != vertices[self._faces.ravel()]).any(axis=1))
        if len(split):
            raise InputError(
                f"{name}, triangle {split[0] // 3}: a corner of vertex "
                f"{self._faces.ravel()[split[0]]} lies apart from the vertex's other corners, "
                f"expected them together as in {self._name}; export as PLY, which keeps vertices"
            )
        return vertices, Polygons.of_triangles(self._faces)


def _corners(data: bytes, name: str) -> FloatArray:
    """Positions (3F, 3) of the corners of all triangles, in the file's order."""
    text = plain_text(data, name)
    # The header of a binary file may begin with "solid", too.
    if text.lstrip()[:5].lower() == b"solid" and b"\0" not in text:
        corners = _text_corners(text, name)
    else:
        corners = _binary_corners(data, name)
    if len(corners) == 0:
        raise InputError(f"{name}: no triangles, expected at least one; export the file again")
    return corners


def _binary_corners(data: bytes, name: str) -> FloatArray:
    count = int.from_bytes(data[80:84], "little")
    extra = len(data) - 84 - _TRIANGLE.itemsize * count
    # Some programs append a few bytes; from the size of a triangle on, a triangle would be lost.
    if len(data) < 84 or not 0 <= extra < _TRIANGLE.itemsize:
        raise InputError(
            f"{name}: {len(data)} bytes, expected 84 + 50 for each of {count} triangles or text "
            "that starts with 'solid'; export the file again"
        )
    corners = np.frombuffer(data, _TRIANGLE, count, 84)["corners"].reshape(-1, 3)
    corners = corners.astype(np.float64)
    bad = np.flatnonzero(~(np.abs(corners) <= FARTHEST).all(axis=1))
    if len(bad):
        raise InputError(
            f"{name}, triangle {bad[0] // 3}: found {corners[bad[0]].tolist()}, expected "
            f"positions within ±{FARTHEST:g}; repair the triangle"
        )
    return corners


def _text_corners(text: bytes, name: str) -> FloatArray:
    """Corners of text: any number of solids, each a series of facets of seven lines."""
    rows, lines = [], []
    number, step, inside = 0, 0, False
    for number, line in enumerate(text.splitlines(), 1):
        row = line.lower().split()
        if not row:
            continue
        if step == 0 and row[0] == (b"endsolid" if inside else b"solid"):
            inside = not inside
            continue
        words, length = _FACET[step] if inside else ([b"solid"], 0)
        if row[: len(words)] != words or len(row) != length:
            raise InputError(
                f"{name}, line {number}: found {shown(row)}, expected "
                f"{shown(words)} and {length - len(words)} numbers; correct the line or export "
                "the file again"
            )
        if 2 <= step <= 4:
            rows.append(row)
            lines.append(number)
        step = (step + 1) % len(_FACET)
    if inside:
        raise InputError(
            f"{name}: ends at line {number} without 'endsolid'; the file is cut short, export it "
            "again"
        )
    return positions(rows, 1, name, lambda i: f"line {lines[i]}")


def write_stl(vertices: FloatArray, faces: IntArray) -> bytes:
    """Binary STL of vertices (V, 3) and faces (F, 3): float32; unused vertices are lost."""
    soup = np.zeros(len(faces), dtype=_TRIANGLE)
    soup["corners"] = vertices[faces]
    corners = soup["corners"].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    soup["normal"] = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    # The header must not begin with "solid": readers would read the file as text.
    return b"deformer".ljust(80) + len(faces).to_bytes(4, "little") + soup.tobytes()
