"""Stanford PLY, text and binary: positions and polygons, in the file's own order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io.parsing import corner_indices, fan_triangles, positions

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
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class _Property:
    name: str
    type: str
    count_type: str | None  # None for a scalar, else the type of a list's length


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: tuple[_Property, ...]

    @property
    def index_list(self) -> str | None:
        """Name of the list of vertex indices, if there is one."""
        names = {p.name for p in self.properties if p.count_type}
        return next((n for n in ("vertex_indices", "vertex_index") if n in names), None)


def read_ply(data: bytes, name: str) -> tuple[FloatArray, IntArray]:
    """Positions (V, 3) and triangles (F, 3) of a PLY file.

    Args:
        data: contents of the file.
        name: file name for messages.

    Raises:
        InputError: a broken header, a short file, garbage, no vertices or faces, or a face index
            out of range.
    """
    order, elements, body = _header(data, name)
    vertex = next((e for e in elements if e.name == "vertex"), None)
    scalars = {p.name for p in vertex.properties if not p.count_type} if vertex else set()
    if vertex is None or vertex.count == 0 or not {"x", "y", "z"} <= scalars:
        raise InputError(
            f"{name}: no vertices, expected an element 'vertex' with x, y, z; export it again"
        )
    if not any(e.name == "face" and e.count and e.index_list for e in elements):
        raise InputError(
            f"{name}: no faces, expected an element 'face' with 'vertex_indices'; export the mesh "
            "with its faces"
        )
    if order:
        return _read_binary(data, body, order, elements, name)
    return _read_text(data, body, elements, name)


def _header(data: bytes, name: str) -> tuple[str, list[_Element], int]:
    end = data.find(b"end_header")
    body = data.find(b"\n", end) + 1
    if data[:3] != b"ply" or end < 0 or body == 0:
        raise InputError(f"{name}: no PLY header, expected 'ply' … 'end_header'; export it again")
    order: str | None = None
    elements: list[_Element] = []
    for number, line in enumerate(data[:end].decode("latin-1").splitlines(), 1):
        match line.split():
            case ["format", kind, *_] if kind in _ORDERS:
                order = _ORDERS[kind]
            case ["element", element, count] if count.isdecimal():
                elements.append(_Element(element, int(count), ()))
            case ["property", "list", n, t, p] if elements and n in _TYPES and t in _TYPES:
                elements[-1] = _with_property(elements[-1], _Property(p, _TYPES[t], _TYPES[n]))
            case ["property", t, p] if elements and t in _TYPES:
                elements[-1] = _with_property(elements[-1], _Property(p, _TYPES[t], None))
            case ["format" | "element" | "property", *_]:
                raise InputError(
                    f"{name}, line {number}: cannot read {line[:60]!r}, expected a PLY header "
                    "line; export the file again"
                )
    if order is None:
        raise InputError(f"{name}: no 'format' line in the PLY header; export the file again")
    return order, elements, body


def _with_property(element: _Element, added: _Property) -> _Element:
    return _Element(element.name, element.count, (*element.properties, added))


def _read_text(
    data: bytes, body: int, elements: list[_Element], name: str
) -> tuple[FloatArray, IntArray]:
    first = data[:body].count(b"\n") + 1
    found = [(n, line.split()) for n, line in enumerate(data[body:].splitlines(), first)]
    found = [(n, row) for n, row in found if row]
    start = 0
    vertices, polygons, face_lines = np.empty((0, 3)), [], []
    for element in elements:
        block = found[start : start + element.count]
        if len(block) < element.count:
            raise _cut_short(name, element, len(block))
        start += element.count
        if element.name == "vertex":
            if any(p.count_type for p in element.properties):
                raise InputError(
                    f"{name}: vertices with a list property, expected numbers alone; export the "
                    "file without it"
                )
            names = [p.name for p in element.properties]
            x, y, z = (names.index(axis) for axis in "xyz")
            rows = [row[x : x + 1] + row[y : y + 1] + row[z : z + 1] for _, row in block]
            lines = [n for n, _ in block]
            vertices = positions(rows, 0, name, lambda i, lines=lines: f"line {lines[i]}")
        elif element.name == "face":
            face_lines = [n for n, _ in block]
            polygons = [_text_polygon(row, element, n, name) for n, row in block]

    def where(i: int) -> str:
        return f"line {face_lines[i]}"

    corners, counts = corner_indices(polygons, name, where)
    return vertices, fan_triangles(corners, counts, len(vertices), name, where)


def _text_polygon(row: list[bytes], element: _Element, number: int, name: str) -> list[bytes]:
    polygon: list[bytes] = []
    offset = 0
    for prop in element.properties:
        length = 1
        if prop.count_type:
            token = row[offset] if offset < len(row) else b""
            length = 1 + int(token) if token.isdigit() else len(row) + 1
        if offset + length > len(row):
            raise InputError(
                f"{name}, line {number}: cannot read the face, expected its properties "
                f"{[p.name for p in element.properties]}; correct the line or export it again"
            )
        if prop.name == element.index_list:
            polygon = row[offset + 1 : offset + length]
        offset += length
    return polygon


def _read_binary(
    data: bytes, body: int, order: str, elements: list[_Element], name: str
) -> tuple[FloatArray, IntArray]:
    vertices, corners, counts = np.empty((0, 3)), np.empty(0, np.int64), np.empty(0, np.int64)
    offset = body
    for element in elements:
        row = _uniform_row(data, offset, element, order)
        if row is not None:
            table = np.frombuffer(data, row, element.count, offset)
            offset += table.nbytes
            if element.name == "vertex":
                vertices = np.stack([table[axis] for axis in "xyz"], axis=1).astype(np.float64)
            elif element.name == "face" and element.index_list:
                block = table[element.index_list].astype(np.int64)
                corners = block.ravel()
                counts = np.full(len(block), block.shape[1], dtype=np.int64)
        else:
            offset, polygons = _read_rows(data, offset, element, order, name)
            if element.name == "vertex":
                raise InputError(
                    f"{name}: vertices with lists of differing lengths, expected numbers alone; "
                    "export the file without them"
                )
            if element.name == "face":
                corners = np.concatenate(polygons).astype(np.int64)
                counts = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    return vertices, fan_triangles(corners, counts, len(vertices), name, lambda i: f"face {i}")


def _uniform_row(data: bytes, start: int, element: _Element, order: str) -> np.dtype | None:
    """Layout of the element's rows if it is the same for all; None if a list's length varies."""
    fields: list = []
    lengths = []
    offset = start
    for prop in element.properties:
        shape: tuple[int, ...] = ()
        if prop.count_type:
            count = np.dtype(order + prop.count_type)
            if element.count == 0 or offset + count.itemsize > len(data):
                return None
            length = int(np.frombuffer(data, count, 1, offset)[0])
            if not 0 <= length <= len(data):
                return None
            lengths.append((f"{prop.name} length", length))
            fields.append((f"{prop.name} length", count))
            offset += count.itemsize
            shape = (length,)
        field = np.dtype((order + prop.type, shape))
        fields.append((prop.name, order + prop.type, shape))
        offset += field.itemsize
    row = np.dtype(fields)
    if start + element.count * row.itemsize > len(data):
        return None
    table = np.frombuffer(data, row, element.count, start)
    return row if all((table[field] == length).all() for field, length in lengths) else None


def _read_rows(
    data: bytes, offset: int, element: _Element, order: str, name: str
) -> tuple[int, list[np.ndarray]]:
    """Offset after the element's rows, read one by one, and their lists of vertex indices."""
    polygons = []
    kinds = [
        (p.name, np.dtype(order + p.type), np.dtype(order + p.count_type) if p.count_type else None)
        for p in element.properties
    ]
    for i in range(element.count):
        for prop, kind, count_kind in kinds:
            length = 1
            if count_kind is not None:
                head = data[offset : offset + count_kind.itemsize]
                length = -1
                if len(head) == count_kind.itemsize:
                    length = int(np.frombuffer(head, count_kind)[0])
                offset += count_kind.itemsize
            end = offset + length * kind.itemsize
            if length < 0 or end > len(data):
                raise _cut_short(name, element, i)
            if prop == element.index_list:
                polygons.append(np.frombuffer(data, kind, length, offset))
            offset = end
    return offset, polygons


def _cut_short(name: str, element: _Element, found: int) -> InputError:
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
