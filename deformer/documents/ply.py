"""PLY files as documents: new positions and normals among elements and properties that stay."""

from __future__ import annotations

import re

import numpy as np

from deformer.documents.normals import renewed_normals, smooth_groups
from deformer.documents.ply_tables import PlyTable, ply_tables
from deformer.documents.polygons import Part, PolygonMesh, first_of_each
from deformer.documents.text_files import decoded, single_precision
from deformer.geometry import FloatArray, IntArray

_POSITION, _NORMAL = ("x", "y", "z"), ("nx", "ny", "nz")
_UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
_COLOURS = ("red", "green", "blue", "alpha")
_MOST_IN_BYTE = 255


def rewritten_ply(data: bytes, vertices: FloatArray, faces: IntArray) -> bytes:
    """The file with other positions, and with other normals where it has them.

    Positions and normals keep their type if it is a floating-point one, and become `float`
    otherwise. All other properties and elements stay, in their type, order and bytes.

    Args:
        data: contents of a PLY file.
        vertices: (V, 3) new positions, in the file's order.
        faces: (F, 3) the file's triangles.

    Raises:
        InputError: a position too large for single precision, where the file has that.
    """
    plain, restore = decoded(data)
    file = ply_tables(plain)
    table = file.tables["vertex"]
    before = _columns(table, _POSITION)
    if np.array_equal(before, vertices):
        return data
    values = dict(zip(_POSITION, vertices.T, strict=True))
    if table.scalars.keys() >= set(_NORMAL):
        old = _columns(table, _NORMAL)
        groups = smooth_groups(before, old)
        counts, corners = np.full(len(faces), 3), faces.ravel()
        firsts, _ = first_of_each(groups, old, int(groups.max()) + 1)
        anew = renewed_normals(firsts, groups[corners], before, vertices, counts, corners)
        kept = (anew == firsts).all(axis=1)[groups]
        normals = np.where(kept[:, None], old, anew[groups])
        values |= dict(zip(_NORMAL, normals.T, strict=True))
    types = {p.name: p.type if p.type.startswith("f") else "f4" for p in table.element.properties}
    rounded = {
        name: single_precision(array, "PLY") if types[name] == "f4" else array
        for name, array in values.items()
    }
    retyped = {
        p.name for p in table.element.properties if p.name in values and not p.type.startswith("f")
    }
    head = _retyped(plain[: file.body], retyped) if retyped else plain[: file.body]
    body = plain[file.body :]
    if file.order:
        body = _binary(plain, table, rounded, file.order)[file.body :]
    else:
        body = _text(body, table, rounded)
    return restore(head + body)


def _columns(table: PlyTable, names: tuple[str, ...]) -> FloatArray:
    return np.stack([table.scalars[name] for name in names], axis=1).astype(np.float64)


def _retyped(head: bytes, names: set[str]) -> bytes:
    """The header with properties of vertices declared as `float`."""
    element = b""

    def replaced(match: re.Match[bytes]) -> bytes:
        nonlocal element
        if match[1].strip().lower() == b"element":
            element = match[3].lower()
        elif element == b"vertex" and match[5] and match[5].lower().decode() in names:
            return match[1] + match[2] + b"float" + match[4] + match[5]
        return match[0]

    line = rb"(?:^|(?<=[\r\n]))([ \t]*(?:element|property))([ \t]+)(\w+)(?:([ \t]+)(\w+))?"
    return re.sub(line, replaced, head, flags=re.I)


def _binary(data: bytes, table: PlyTable, values: dict[str, np.ndarray], order: str) -> bytes:
    row = table.row
    assert row is not None and row.fields is not None  # the reader refuses vertices without
    old = np.frombuffer(data, row, table.element.count, table.start)
    fields = [
        (name, np.dtype(order + values[name].dtype.str[1:]) if name in values else kind[0])
        for name, kind in row.fields.items()
    ]
    new = np.empty(len(old), np.dtype(fields))
    for name, _ in fields:
        new[name] = values.get(name, old[name])
    end = table.start + old.nbytes
    return data[: table.start] + new.tobytes() + data[end:]


def _text(
    body: bytes,
    table: PlyTable,
    values: dict[str, np.ndarray],
) -> bytes:
    column = {prop.name: n for n, prop in enumerate(table.element.properties)}
    columns = [column[name] for name in values]
    # Numbers of single precision have the digits that tell them apart there.
    texts = [[str(value.item() if value.dtype.itemsize == 8 else value) for value in array]
             for array in values.values()]  # fmt: skip
    changed = np.stack(
        [array != table.scalars[name].astype(array.dtype) for name, array in values.items()], axis=1
    ).tolist()
    lines, row = body.splitlines(keepends=True), -table.start
    for n, line in enumerate(lines):
        if line.isspace():
            continue
        if 0 <= row < table.element.count:
            spans = [match.span() for match in re.finditer(rb"\S+", line)]
            for k in sorted(range(len(columns)), key=lambda k: -columns[k]):
                if changed[row][k]:
                    first, last = spans[columns[k]]
                    line = line[:first] + texts[k][row].encode() + line[last:]
            lines[n] = line
        row += 1
    return b"".join(lines)


def ply_polygons(data: bytes) -> PolygonMesh:
    """What a PLY file has beside positions, of what other formats know.

    Args:
        data: contents of the file.
    """
    file = ply_tables(decoded(data)[0])
    vertex, face = file.tables["vertex"], file.tables["face"]
    counts, flat = face.lists[face.element.index_list or ""]
    corners = flat.astype(np.int64)
    uvs = None
    if "texcoord" in face.lists and np.array_equal(face.lists["texcoord"][0], 2 * counts):
        uvs = face.lists["texcoord"][1].astype(np.float64).reshape(-1, 2)
    else:
        pair = next((p for p in _UVS if vertex.scalars.keys() >= set(p)), None)
        uvs = _columns(vertex, pair)[corners] if pair else None
    normals = None
    if vertex.scalars.keys() >= set(_NORMAL):
        normals = smooth_groups(_columns(vertex, _POSITION), _columns(vertex, _NORMAL))[corners]
    whole = np.zeros(len(counts), dtype=np.int64)
    return PolygonMesh(
        counts, corners, uvs, normals, _colours(vertex), whole - 1, (), whole, (Part(),)
    )


def _colours(vertex: PlyTable) -> FloatArray | None:
    """Colours (V, 3) or (V, 4) of 0 to 1."""
    for prefix in ("", "diffuse_"):
        names = [prefix + name for name in _COLOURS if prefix + name in vertex.scalars]
        if len(names) < 3:
            continue
        types = {p.name: p.type for p in vertex.element.properties}
        scales = [1.0 if types[n].startswith("f") else np.iinfo(types[n]).max for n in names]
        colours = _columns(vertex, tuple(names)) / scales
        return colours if ((colours >= 0) & (colours <= 1)).all() else None
    return None


def ply_of(vertices: FloatArray, mesh: PolygonMesh) -> bytes:
    """A binary PLY file of positions and what the format knows of the description.

    These are polygons, colours of vertices, normals where no vertex has two, and texture
    coordinates: of vertices, as `s` and `t`, or of faces, as `texcoord`, where a vertex has
    several.

    Args:
        vertices: (V, 3) positions.
        mesh: the description.
    """
    V = len(vertices)
    names = ["double x", "double y", "double z"]
    columns: list[np.ndarray] = list(vertices.T)
    if mesh.normals is not None:
        number, single = first_of_each(mesh.corners, mesh.normals[:, None].astype(float), V)
        if single and not (mesh.normals < 0).any():
            alone = np.nan_to_num(number.ravel(), nan=-1).astype(int)
            rows = np.concatenate([mesh.shading(vertices), [[0.0, 0.0, 1.0]]])
            names += ["float nx", "float ny", "float nz"]
            columns += list(rows[alone].T)
    of_faces = None
    if mesh.uvs is not None:
        uvs, single = first_of_each(mesh.corners, mesh.uvs, V)
        if single:
            names += ["float s", "float t"]
            columns += list(np.nan_to_num(uvs).T)
        else:
            of_faces = np.nan_to_num(mesh.uvs).astype("<f4")
    if mesh.colours is not None:
        width = mesh.colours.shape[1]
        names += [f"uchar {name}" for name in _COLOURS[:width]]
        columns += list(np.rint(255 * mesh.colours).T)
    kinds = {"double": "<f8", "float": "<f4", "uchar": "u1"}
    fields = [(name.split()[1], kinds[name.split()[0]]) for name in names]
    table = np.empty(V, fields)
    for (name, _), column in zip(fields, columns, strict=True):
        table[name] = column
    most = int(mesh.counts.max()) * (1 if of_faces is None else 2)
    length, kind = ("uchar", "u1") if most <= _MOST_IN_BYTE else ("int", "<i4")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {V}"]
    header += [f"property {name}" for name in names]
    header += [f"element face {len(mesh.counts)}", f"property list {length} int vertex_indices"]
    header += [] if of_faces is None else [f"property list {length} float texcoord"]
    header.append("end_header\n")
    heads = [np.array([n], kind).tobytes() for n in range(most + 1)]
    corners = mesh.corners.astype("<i4")
    rows, at = [], 0
    for count in mesh.counts.tolist():
        rows += [heads[count], corners[at : at + count].tobytes()]
        if of_faces is not None:
            rows += [heads[2 * count], of_faces[at : at + count].tobytes()]
        at += count
    return "\n".join(header).encode() + table.tobytes() + b"".join(rows)
