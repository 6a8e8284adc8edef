"""Stanford PLY, text and binary: positions and polygons, in the file's own order."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass

import numpy as np

from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io.parsing import (
    Where,
    checked_polygons,
    corner_indices,
    item_count,
    plain_text,
    positions,
    shown,
)
from deformer.io.polygons import Polygons

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
# A file whose header has CR line ends has them throughout; LF ends a line that ends in CR LF, too.
_FIRST_LINE = re.compile(rb"[Pp][Ll][Yy][ \t]*(\r(?!\n)|\r?\n)")
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class PlyProperty:
    """A property of an element; types are numpy's without byte order."""

    name: str
    type: str
    count_type: str | None  # None for a scalar, else the type of a list's length


@dataclass(frozen=True)
class PlyElement:
    """An element of a PLY file: its name, its rows, and the properties of each in order."""

    name: str
    count: int
    properties: tuple[PlyProperty, ...]

    @property
    def least_bytes(self) -> int:
        """Bytes of a binary row with empty lists."""
        return sum(np.dtype(p.count_type or p.type).itemsize for p in self.properties)

    @property
    def index_list(self) -> str | None:
        """Name of the list of vertex indices, if there is one."""
        names = {p.name for p in self.properties if p.count_type}
        return next((n for n in ("vertex_indices", "vertex_index") if n in names), None)


def read_ply(data: bytes, name: str) -> tuple[FloatArray, Polygons]:
    """Positions (V, 3) and polygons of a PLY file.

    Args:
        data: contents of the file.
        name: file name for messages.

    Raises:
        InputError: a broken header, a short file, garbage, no vertices or faces, or a face index
            out of range.
    """
    data = plain_text(data, name)
    order, elements, body = ply_header(data, name)
    vertex = next((e for e in elements if e.name == "vertex"), None)
    scalars = {p.name for p in vertex.properties if not p.count_type} if vertex else set()
    if vertex is None or not {"x", "y", "z"} <= scalars:
        raise InputError(
            f"{name}: no vertices, expected an element 'vertex' with x, y, z; export it again"
        )
    if not any(e.name == "face" and e.index_list for e in elements):
        raise InputError(
            f"{name}: no faces, expected an element 'face' with 'vertex_indices'; export the mesh "
            "with its faces"
        )
    if order:
        return _read_binary(data, body, order, elements, name)
    return _read_text(data, body, elements, name)


def ply_header(data: bytes, name: str) -> tuple[str, list[PlyElement], int]:
    """Byte order, elements that have rows and properties, and where the rows start."""
    first = _FIRST_LINE.match(data)
    line_end = b"\r" if first and first[1] == b"\r" else b"\n"
    last = re.compile(line_end + rb"[ \t]*end_header[ \t\r]*?" + line_end, re.IGNORECASE)
    end = last.search(data)
    if not first or not end:
        raise InputError(f"{name}: no PLY header, expected 'ply' … 'end_header'; export it again")
    order: str | None = None
    counts: dict[str, int] = {}
    properties: dict[str, dict[str, PlyProperty]] = {}
    owner = ""
    lines = data[first.end() : end.start()].decode("ascii", "replace").split(line_end.decode())
    for number, line in enumerate(lines, 2):
        added = None
        match line.lower().split():
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", kind, *_] if kind in _ORDERS and order is None:
                order = _ORDERS[kind]
            case ["element", owner, count] if item_count(count) >= 0:
                if owner in counts:
                    raise _header_error(name, number, line, f"one element {owner!r}")
                counts[owner], properties[owner] = item_count(count), {}
            case ["property", "list", n, t, p] if owner and n in _TYPES and t in _TYPES:
                if _TYPES[n].startswith("f"):
                    raise _header_error(name, number, line, "an integer type for the list's length")
                added = PlyProperty(p, _TYPES[t], _TYPES[n])
            case ["property", t, p] if owner and t in _TYPES:
                added = PlyProperty(p, _TYPES[t], None)
            case _:
                raise _header_error(name, number, line, "a PLY header line")
        if added:
            if added.name in properties[owner]:
                raise _header_error(name, number, line, f"each property of {owner!r} once")
            properties[owner][added.name] = added
    if order is None:
        raise InputError(f"{name}: no 'format' line in the PLY header; export the file again")
    # Elements without rows or properties have no bytes in the file.
    elements = [
        PlyElement(element, count, tuple(properties[element].values()))
        for element, count in counts.items()
        if count and properties[element]
    ]
    return order, elements, end.end()


def _header_error(name: str, number: int, line: str, expected: str) -> InputError:
    return InputError(
        f"{name}, line {number}: found {line.strip()[:60]!r} in the PLY header, expected "
        f"{expected}; export the file again"
    )


def _read_text(
    data: bytes, body: int, elements: list[PlyElement], name: str
) -> tuple[FloatArray, Polygons]:
    lines = [line for line in data[body:].splitlines() if line and not line.isspace()]

    def where(row: int) -> str:
        first = len(data[:body].splitlines()) + 1
        numbers = [n for n, line in enumerate(data[body:].splitlines(), first) if line.strip()]
        return f"line {numbers[row]}"

    start = face_start = 0
    vertices: FloatArray = np.empty((0, 3))
    polygons: list[list[bytes]] = []
    for element in elements:
        block = lines[start : start + element.count]
        if len(block) < element.count:
            raise _cut_short(name, element, len(block))
        if element.name == "vertex":
            rows = [line.split() for line in block]
            vertices = _text_positions(rows, element, name, lambda i, at=start: where(at + i))
        elif element.name == "face":
            face_start = start
            for i, line in enumerate(block):
                polygon = _text_polygon(line.split(), element)
                if polygon is None:
                    raise InputError(
                        f"{name}, {where(start + i)}: cannot read {shown([line])} as a face, "
                        f"expected its properties {[p.name for p in element.properties]}; correct "
                        "the line or export it again"
                    )
                polygons.append(polygon)
                # It is refused below by this name; the rows after it need no memory.
                if len(polygon) < 3:
                    break
        start += element.count
    if start < len(lines):
        raise InputError(
            f"{name}, {where(start)}: found {shown([lines[start]])} after the last row of element "
            f"{elements[-1].name!r}, expected the end of the file; correct the counts or remove "
            "the rest"
        )

    def where_face(i: int) -> str:
        return where(face_start + i)

    corners, counts = corner_indices(polygons, name, where_face)
    return vertices, checked_polygons(corners, counts, len(vertices), name, where_face)


def _text_positions(
    rows: list[list[bytes]], element: PlyElement, name: str, where: Where
) -> FloatArray:
    if any(p.count_type for p in element.properties):
        raise InputError(
            f"{name}: vertices with a list property, expected numbers alone; export the file "
            "without it"
        )
    names = [p.name for p in element.properties]
    i = next((i for i, row in enumerate(rows) if len(row) != len(names)), None)
    if i is not None:
        raise InputError(
            f"{name}, {where(i)}: found {shown(rows[i])} as a vertex, expected {len(names)} "
            f"numbers, {names}; correct the line or export the file again"
        )
    x, y, z = (names.index(axis) for axis in "xyz")
    return positions([[row[x], row[y], row[z]] for row in rows], 0, name, where)


def _text_polygon(row: list[bytes], element: PlyElement) -> list[bytes] | None:
    """Tokens of the vertex indices; None if the row is not made up of the element's properties."""
    polygon: list[bytes] = []
    offset = 0
    for prop in element.properties:
        length = 1
        if prop.count_type:
            count = item_count(row[offset]) if offset < len(row) else -1
            if count < 0:
                return None
            length += count
            if prop.name == element.index_list:
                polygon = row[offset + 1 : offset + length]
        offset += length
    return polygon if offset == len(row) else None


def _read_binary(
    data: bytes, body: int, order: str, elements: list[PlyElement], name: str
) -> tuple[FloatArray, Polygons]:
    vertices, corners, counts = np.empty((0, 3)), np.empty(0, np.int64), np.empty(0, np.int64)
    offset = body
    for element in elements:
        if element.count * element.least_bytes > len(data) - offset:
            raise _cut_short(name, element, (len(data) - offset) // element.least_bytes)
        row = ply_row(data, offset, element, order)
        if row is not None:
            table = np.frombuffer(data, row, element.count, offset)
            offset += table.nbytes
            if element.name == "vertex":
                vertices = np.stack([table[axis] for axis in "xyz"], axis=1).astype(np.float64)
            elif element.name == "face" and element.index_list:
                block = table[element.index_list]
                counts = np.full(len(block), block.shape[1], dtype=np.int64)
                corners = _whole_numbers(block.ravel(), counts, name)
        elif element.name == "vertex":
            raise InputError(
                f"{name}: vertices with lists of differing lengths, expected numbers alone; "
                "export the file without them"
            )
        else:
            offset, polygons, lengths = _read_rows(data, offset, element, order, name)
            if element.name == "face":
                counts = lengths
                corners = _whole_numbers(polygons, counts, name)
    # A line end after the last row is not data.
    if data[offset:].strip():
        raise InputError(
            f"{name}: {len(data) - offset} bytes follow the last row of element "
            f"{elements[-1].name!r}, expected the end of the file; export it again"
        )
    return vertices, checked_polygons(corners, counts, len(vertices), name, lambda i: f"face {i}")


def _whole_numbers(corners: np.ndarray, counts: IntArray, name: str) -> IntArray:
    """Vertex indices as integers; some programs write them as floating-point numbers."""
    if corners.dtype.kind == "f":
        bad = np.flatnonzero(~np.isfinite(corners) | (corners != np.floor(corners)))
        if len(bad):
            face = int(np.searchsorted(np.cumsum(counts), bad[0], side="right"))
            raise InputError(
                f"{name}, face {face}: found vertex index {corners[bad[0]]}, expected a whole "
                "number; export the file again"
            )
    return corners.astype(np.int64)


def ply_row(data: bytes, start: int, element: PlyElement, order: str) -> np.dtype | None:
    """Layout of the element's rows if it is the same for all; None if a list's length varies."""
    fields: list = []
    lengths = []
    offset = start
    for prop in element.properties:
        kind = np.dtype(order + prop.type)
        shape: tuple[int, ...] = ()
        if prop.count_type:
            count = np.dtype(order + prop.count_type)
            if offset + count.itemsize > len(data):
                return None
            length = int(np.frombuffer(data, count, 1, offset)[0])
            offset += count.itemsize
            if not 0 <= length * kind.itemsize <= len(data) - offset:
                return None
            lengths.append((f"{prop.name} length", length))
            fields.append((f"{prop.name} length", count))
            shape = (length,)
        field = np.dtype((kind, shape))
        fields.append((prop.name, kind, shape))
        offset += field.itemsize
    row = np.dtype(fields)
    if start + element.count * row.itemsize > len(data):
        return None
    table = np.frombuffer(data, row, element.count, start)
    return row if all((table[field] == length).all() for field, length in lengths) else None


def _read_rows(
    data: bytes, offset: int, element: PlyElement, order: str, name: str
) -> tuple[int, np.ndarray, IntArray]:
    """Reads the element's rows one by one.

    Returns:
        the offset after them; the vertex indices of all; and how many each has.
    """
    corners: list[bytes] = []
    lengths: list[int] = []
    index_type = np.dtype("u1")
    columns = []
    for prop in element.properties:
        kind = np.dtype(order + prop.type)
        head = prop.count_type and struct.Struct(order + np.dtype(prop.count_type).char)
        columns.append((prop.name == element.index_list, kind.itemsize, head or None))
        if prop.name == element.index_list:
            index_type = kind
    for i in range(element.count):
        for is_corners, size, head in columns:
            length = 1
            if head is not None:
                if offset + head.size > len(data):
                    raise _cut_short(name, element, i)
                (length,) = head.unpack_from(data, offset)
                offset += head.size
            end = offset + length * size
            if length < 0 or end > len(data):
                raise _cut_short(name, element, i)
            if is_corners:
                corners.append(data[offset:end])
                lengths.append(length)
            offset = end
    return offset, np.frombuffer(b"".join(corners), index_type), np.array(lengths, np.int64)


def _cut_short(name: str, element: PlyElement, found: int) -> InputError:
    return InputError(
        f"{name}: element {element.name!r} ends after {found} rows, expected {element.count}; the "
        "file is cut short, export it again"
    )


def write_ply(vertices: FloatArray, faces: IntArray) -> bytes:
    """Binary PLY of vertices (V, 3) and faces (F, 3), positions as float64."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    table = np.zeros(len(faces), dtype=[("length", "u1"), ("corners", "<i4", 3)])
    table["length"] = 3
    table["corners"] = faces
    return header.encode("ascii") + vertices.astype("<f8").tobytes() + table.tobytes()
