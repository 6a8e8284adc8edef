"""Wavefront OBJ files as documents: new positions and normals in a text that stays."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from deformer.documents.normals import mean_normals, renewed_normals
from deformer.documents.polygons import Material, Part, PolygonMesh, numbered
from deformer.documents.text_files import opened
from deformer.geometry import FloatArray, IntArray

# The reader continues these statements alone, for a comment may end in a backslash by chance.
_CONTINUED = re.compile(rb"^[ \t]*(?:v|vt|vn|f)(?=[ \t\\])(?:[^\n]*\\\r?\n)+", re.M | re.I)
_DIGITS = 6  # of normals
_APART = math.cos(math.radians(20))
_log = logging.getLogger("deformer")
_NEXT = r"((?:[ \t\r\v\f]|\\\r?\n)+)[^ \t\r\n\v\f\\]+"
# Keyword, then three numbers, if there are as many, with the spaces before them.
_VECTOR = re.compile(
    r"^([ \t\r\v\f]*(v|vn)(?=[ \t\n\r\v\f\\]|\Z))(?:" + 3 * _NEXT + r")?", re.M | re.I
)


class ObjFile:
    """An OBJ file, parsed once, into which positions can be written any number of times."""

    def __init__(self, data: bytes) -> None:
        """Parse the contents of an OBJ file."""
        text, self._restore = opened(data)
        self._parsed = _parse(text)
        self._before = np.array(self._parsed.positions)
        self._normals = np.array(self._parsed.normals).reshape(-1, 3)
        self._text = text.decode("latin-1")
        self._warned = False

    def written(self, vertices: FloatArray) -> bytes:
        """The file with other positions.

        Numbers of vertices and normals that stay as they are keep their digits; others are the
        shortest decimals that are exact. All else is the same, byte for byte. A normal is the mean
        of those of the polygons at the corners that use it: hard edges stay hard, and smooth ones
        smooth.

        Args:
            vertices: (V, 3) new positions, in the file's order.
        """
        normals, parsed = self._normals, self._parsed
        if len(normals):
            counts, corners = np.array(parsed.counts), np.array(parsed.corners)
            uses = parsed.normal_of_corner
            anew = renewed_normals(normals, uses, self._before, vertices, counts, corners)
            if not self._warned:
                self._warn_of_shared(anew, vertices, counts, corners)
            normals = np.where(anew == normals, normals, _rounded(anew))
        values = vertices.tolist(), normals.tolist()
        changed = (
            (self._before != vertices).any(axis=1).tolist(),
            (self._normals != normals).any(axis=1).tolist(),
        )
        pieces, at = [], 0
        for kind, n, first, last, before, between, after in self._vectors:
            if changed[kind][n]:
                x, y, z = values[kind][n]
                pieces.append(f"{self._text[at:first]}{before}{x!r}{between}{y!r}{after}{z!r}")
                at = last
        pieces.append(self._text[at:])
        return self._restore("".join(pieces).encode("latin-1"))

    def _warn_of_shared(
        self, normals: FloatArray, vertices: FloatArray, counts: IntArray, corners: IntArray
    ) -> None:
        """Say in the log, once, if one normal stands for vertices that now face apart.

        Programs write equal normals once, whichever vertices have them.
        """
        uses = self._parsed.normal_of_corner
        if not (uses >= 0).any():
            return
        own = numbered(corners, uses)
        found = mean_normals(vertices, counts, corners, own, int(own.max()) + 1)
        chosen = (own >= 0) & (found[own] != 0).any(axis=1)
        cosines = (found[own] * normals[uses]).sum(axis=1)[chosen]
        apart = cosines < _APART
        if apart.any():
            self._warned = True
            _log.warning(
                "OBJ: %d of %d normals stand for vertices that now face up to %.0f° off; "
                "recalculate normals where the file is opened, or write GLB",
                len(np.unique(uses[chosen][apart])),
                len(normals),
                np.degrees(np.arccos(np.clip(cosines.min(), -1, 1))),
            )

    @cached_property
    def _vectors(self) -> list[tuple[int, int, int, int, str, str, str]]:
        """Statements of positions and normals with three numbers, in the order of the file.

        Each is 0 for a position or 1 for a normal, its index among those, where its numbers begin
        and end in the text, and the spaces before each of them.
        """
        found, seen = [], [0, 0]
        for match in _VECTOR.finditer(self._text):
            kind = len(match[2]) - 1
            if match[3] is not None:
                found.append((kind, seen[kind], match.end(1), match.end(), *match.groups()[2:]))
            seen[kind] += 1
        return found

    def polygons(self, colours: Mapping[str, tuple[float, ...]]) -> PolygonMesh:
        """What the file has beside positions.

        Args:
            colours: base colours of materials, by name.
        """
        return self._parsed.polygons(colours)


def material_libraries(data: bytes) -> list[str]:
    """Names of the material libraries that an OBJ file refers to."""
    found = re.findall(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", opened(data)[0], re.M | re.I)
    return [name.decode("utf-8", "replace").strip() for name in found]


def material_colours(data: bytes) -> dict[str, tuple[float, ...]]:
    """Base colours, linear RGBA, of the materials of an MTL file; other statements are ignored."""
    found: dict[str, tuple[float, ...]] = {}
    name, alpha = "", 1.0
    for line in opened(data)[0].split(b"\n"):
        key, *values = line.split(b"#")[0].split()[:4] or [b""]
        numbers = _numbers(values)
        if key == b"newmtl":
            name, alpha = _rest(line), 1.0
        elif key == b"Kd" and len(numbers) == 3:
            found[name] = (*numbers, alpha)
        elif key in (b"d", b"Tr") and len(numbers) == 1:
            alpha = numbers[0] if key == b"d" else 1.0 - numbers[0]
            if name in found:
                found[name] = (*found[name][:3], alpha)
    return {
        key: colour for key, colour in found.items() if key and all(0 <= c <= 1 for c in colour)
    }


@dataclass
class _Parsed:
    """Statements of an OBJ file; indices count from 0, and −1 is none."""

    positions: list[list[float]] = field(default_factory=list)
    colours: list[list[float]] = field(default_factory=list)
    uvs: list[list[float]] = field(default_factory=list)
    normals: list[list[float]] = field(default_factory=list)
    corners: list[int] = field(default_factory=list)
    corner_uvs: list[int] = field(default_factory=list)
    corner_normals: list[int] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    smoothing: list[int] = field(default_factory=list)
    material: list[int] = field(default_factory=list)
    part: list[int] = field(default_factory=list)
    materials: dict[str, int] = field(default_factory=dict)
    parts: dict[tuple[str, str], int] = field(default_factory=dict)
    has_smoothing: bool = False

    @property
    def normal_of_corner(self) -> IntArray:
        """Normal (C,) of each corner; −1 for none, or for one that the file lacks."""
        return _indices(self.corner_normals, len(self.normals))

    def polygons(self, colours: Mapping[str, tuple[float, ...]]) -> PolygonMesh:
        uvs, normals = None, None
        chosen = _indices(self.corner_uvs, len(self.uvs))
        if (chosen >= 0).any():
            rows = np.array([*self.uvs, [np.nan, np.nan]])
            uvs = rows[chosen]
        if (self.normal_of_corner >= 0).any():
            normals = numbered(np.array(self.corners), self.normal_of_corner)
        elif self.has_smoothing:
            smoothing = np.repeat(self._smoothing_numbers(), self.counts)
            normals = numbered(np.array(self.corners), smoothing)
        return PolygonMesh(
            np.array(self.counts),
            np.array(self.corners),
            uvs,
            normals,
            self._vertex_colours(),
            np.array(self.material),
            tuple(Material(name, _rgba(colours.get(name))) for name in self.materials),
            np.array(self.part),
            tuple(Part(*names) for names in self.parts),
        )

    def _smoothing_numbers(self) -> IntArray:
        """Smoothing group (P,) of each polygon; a polygon without has a number of its own."""
        numbers = np.array(self.smoothing)
        alone = numbers == 0
        numbers[alone] = numbers.max() + 1 + np.arange(alone.sum())
        return numbers

    def _vertex_colours(self) -> FloatArray | None:
        """Colours (V, 3) or (V, 4), if all vertices have them."""
        lengths = {len(row) for row in self.colours}
        if lengths not in ({3}, {4}):
            return None
        colours = np.array(self.colours)
        return colours if ((colours >= 0) & (colours <= 1)).all() else None


def _parse(text: bytes) -> _Parsed:
    if b"\\" in text:
        text = _CONTINUED.sub(lambda m: re.sub(rb"\\\r?\n", b" ", m[0]), text)
    found = _Parsed()
    smoothing, material, names = 0, -1, ("", "")
    for line in text.split(b"\n"):
        key, *values = line.split() or [b""]
        if b"#" in line:
            values = _before_comment(values)
        match key.lower():
            case b"v":
                found.positions.append([float(value) for value in values[:3]])
                found.colours.append(_numbers(values[3:]) if len(values) > 3 else [])
            case b"vt":
                found.uvs.append([*_numbers(values), 0.0, 0.0][:2])
            case b"vn":
                numbers = _numbers(values[:3])
                found.normals.append(numbers if len(numbers) == 3 else [0.0, 0.0, 0.0])
            case b"f":
                found.counts.append(len(values))
                found.smoothing.append(smoothing)
                found.material.append(material)
                found.part.append(found.parts.setdefault(names, len(found.parts)))
                _add_corners(found, values)
            case b"s":
                smoothing = int(values[0]) if values and values[0].isdigit() else 0
                found.has_smoothing = True
            case b"usemtl":
                material = found.materials.setdefault(_rest(line), len(found.materials))
            case b"o":
                names = (_rest(line), names[1])
            case b"g":
                names = (names[0], _rest(line))
    return found


def _add_corners(found: _Parsed, corners: list[bytes]) -> None:
    for corner in corners:
        v, _, rest = corner.partition(b"/")
        t, _, n = rest.partition(b"/")
        found.corners.append(_index(v, found.positions))
        found.corner_uvs.append(_index(t, found.uvs) if t else -1)
        found.corner_normals.append(_index(n, found.normals) if n else -1)


def _index(token: bytes, seen: list) -> int:
    """An index from 0; negative ones count back from the statements seen; −1 for anything else."""
    try:
        number = int(token)
    except ValueError:
        return -1
    return number - 1 if number > 0 else max(len(seen) + number, -1) if number < 0 else -1


def _indices(indices: list[int], count: int) -> IntArray:
    found = np.array(indices)
    return np.where(found < count, found, -1)


def _before_comment(values: list[bytes]) -> list[bytes]:
    for n, value in enumerate(values):
        if b"#" in value:
            head = value.split(b"#")[0]
            return [*values[:n], head] if head else values[:n]
    return values


def _numbers(values: list[bytes]) -> list[float]:
    """The values as numbers; none if one is not a finite number."""
    try:
        numbers = [float(value) for value in values]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []


def _rest(line: bytes) -> str:
    """What follows the keyword of a line: a name, which may contain spaces."""
    return line.strip().partition(line.split()[0])[2].strip().decode("utf-8", "replace")


def _rgba(colour: tuple[float, ...] | None) -> tuple[float, float, float, float] | None:
    if colour is None:
        return None
    red, green, blue, alpha = colour
    return red, green, blue, alpha


def obj_of(vertices: FloatArray, mesh: PolygonMesh) -> bytes:
    """An OBJ file of positions and all that the description has but base colours.

    Args:
        vertices: (V, 3) positions.
        mesh: the description.
    """
    if mesh.colours is None:
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    else:
        rows = np.concatenate([vertices, mesh.colours[:, :3]], axis=1).tolist()
        lines = ["v " + " ".join(map(repr, row)) for row in rows]
    columns = [(mesh.corners + 1).astype(str)]
    if mesh.uvs is not None:
        chosen = ~np.isnan(mesh.uvs).any(axis=1)
        uvs, inverse = np.unique(mesh.uvs[chosen], axis=0, return_inverse=True)
        lines += [f"vt {u!r} {v!r}" for u, v in uvs.tolist()]
        where = np.full(len(mesh.uvs), -1)
        where[chosen] = inverse.ravel()
        columns.append(_written(where))
    if mesh.normals is not None:
        lines += [f"vn {x!r} {y!r} {z!r}" for x, y, z in _rounded(mesh.shading(vertices)).tolist()]
        if mesh.uvs is None:
            columns.append(np.full(len(mesh.corners), ""))
        columns.append(_written(mesh.normals))
    tokens = ["/".join(parts).rstrip("/") for parts in zip(*columns, strict=True)]
    part, material, at = -1, -1, 0
    named = Part()
    for n, count in enumerate(mesh.counts.tolist()):
        if mesh.part[n] != part:
            part = int(mesh.part[n])
            before, named = named, mesh.parts[part]
            lines += [f"o {_name(named.object)}"] if named.object != before.object else []
            lines += [f"g {_name(named.group)}"] if named.group != before.group else []
        if mesh.material[n] != material:
            material = int(mesh.material[n])
            named_so = mesh.materials[material].name if material >= 0 else ""
            lines.append(f"usemtl {_name(named_so)}")
        lines.append("f " + " ".join(tokens[at : at + count]))
        at += count
    return ("\n".join(lines) + "\n").encode()


def _rounded(normals: FloatArray) -> FloatArray:
    """Normals with the digits that programs write, and no negative zeros."""
    return np.round(normals, _DIGITS) + 0.0


def _name(name: str) -> str:
    """A name in one line; a placeholder for an empty one."""
    return " ".join(name.split()) or "none"


def _written(indices: IntArray) -> np.ndarray:
    """Indices as an OBJ file has them, from 1; empty for −1."""
    return np.where(indices >= 0, (indices + 1).astype(str), "")
