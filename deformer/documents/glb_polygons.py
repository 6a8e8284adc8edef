"""GLB files from and to descriptions of polygon meshes."""

from __future__ import annotations

from typing import Any

import numpy as np

from deformer.documents.glb import scene_normals, shown_vertices
from deformer.documents.glb_file import COMPONENTS
from deformer.documents.normals import present, smooth_groups
from deformer.documents.polygons import Material, Part, PolygonMesh
from deformer.documents.text_files import single_precision
from deformer.geometry import FloatArray, IntArray
from deformer.io import INDICES, VERTICES, GlbBuilder, GltfAsset, GltfScene, VertexRange

_OPAQUE = (1.0, 1.0, 1.0, 1.0)


def glb_polygons(data: bytes) -> PolygonMesh:
    """What a GLB file has beside positions, of what other formats know.

    Args:
        data: contents of the file.
    """
    scene = GltfScene(GltfAsset(data, "the document"))
    asset, faces, ranges = scene.asset, scene.faces, scene.ranges
    material = np.full(len(faces), -1)
    part = np.zeros(len(faces), dtype=np.int64)
    uvs = np.full((len(faces), 3, 2), np.nan)
    parts: dict[str, int] = {}
    at = 0
    for own, primitive in _primitives(scene, ranges):
        node = asset.json["nodes"][own.node]
        number = primitive.get("indices", primitive["attributes"]["POSITION"])
        rows = slice(at, at + asset.json["accessors"][number]["count"] // 3)
        at = rows.stop
        found = primitive.get("material", -1)
        if type(found) is int and found < len(asset.json.get("materials", [])):
            material[rows] = found
        name = node.get("name") or asset.json["meshes"][own.mesh].get("name") or ""
        part[rows] = parts.setdefault(str(name), len(parts))
        texture = primitive["attributes"].get("TEXCOORD_0")
        if texture is not None:
            values = asset.floats(texture, "VEC2", COMPONENTS, "TEXCOORD_0")
            if len(values) == own.count:
                # The origin of glTF is at the upper left.
                uvs[rows] = (values * (1, -1) + (0, 1))[faces[rows] - own.start]
    normals = scene_normals(scene, ranges)
    has = present(normals)
    groups = smooth_groups(shown_vertices(scene), np.where(has[:, None], normals, 9.0))
    corners = faces.ravel()
    return PolygonMesh(
        np.full(len(faces), 3),
        corners,
        uvs.reshape(-1, 2) if not np.isnan(uvs).all() else None,
        np.where(has, groups, -1)[corners] if has.any() else None,
        _colours(scene, ranges),
        material,
        tuple(_material(n, m) for n, m in enumerate(asset.json.get("materials", []))),
        part,
        tuple(Part(name) for name in parts),
    )


def _primitives(
    scene: GltfScene, ranges: tuple[VertexRange, ...]
) -> list[tuple[VertexRange, dict[str, Any]]]:
    """The primitives in the order of the scene's faces, each with the range of its vertices."""
    found = []
    for node in dict.fromkeys(part.node for part in ranges):
        own = {n: part for part in ranges if part.node == node for n in part.primitives}
        primitives = scene.asset.json["meshes"][own[0].mesh]["primitives"]
        found += [(own[n], primitive) for n, primitive in enumerate(primitives)]
    return found


def _colours(scene: GltfScene, ranges: tuple[VertexRange, ...]) -> FloatArray | None:
    """Colours (V, 4), encoded as sRGB, if all vertices have them."""
    asset, found = scene.asset, np.ones((scene.vertex_count, 4))
    for part in ranges:
        primitive = asset.json["meshes"][part.mesh]["primitives"][part.primitives[0]]
        number = primitive["attributes"].get("COLOR_0")
        if number is None:
            return None
        shape = str(asset.item("accessors", number, "COLOR_0").get("type"))
        values = asset.floats(number, shape, COMPONENTS, "COLOR_0")
        if len(values) != part.count or values.shape[1] not in (3, 4):
            return None
        rows = np.clip(values, 0, 1)
        rows[:, :3] = encoded_colours(rows[:, :3])
        found[part.start : part.start + part.count, : rows.shape[1]] = rows
    return found if (found[:, 3] < 1).any() else found[:, :3]


def _material(number: int, material: dict[str, Any]) -> Material:
    colour = material.get("pbrMetallicRoughness", {}).get("baseColorFactor", _OPAQUE)
    red, green, blue, alpha = (min(max(float(c), 0.0), 1.0) for c in colour)
    return Material(str(material.get("name", f"material {number}")), (red, green, blue, alpha))


def glb_of_polygons(
    vertices: FloatArray, mesh: PolygonMesh, faces: IntArray
) -> tuple[bytes, IntArray]:
    """A GLB file of positions and what the format knows of the description.

    Each object is a node, and each material a primitive of it; vertices are split where texture
    coordinates or normals need it.

    Args:
        vertices: (V, 3) positions.
        mesh: the description.
        faces: (F, 3) the triangles that its polygons are cut into.

    Returns:
        the file, and for each vertex of its scene, as `GltfScene` counts them, that of `vertices`.

    Raises:
        InputError: a position too large for single precision.
    """
    mesh = mesh.with_all_normals()
    asset = GlbBuilder()
    materials = [asset.add("materials", _described(material)) for material in mesh.materials]
    corners = mesh.corners_of(faces)
    polygon = mesh.polygon_of_triangle
    names = [part.object for part in mesh.parts]
    owner = np.array([names.index(name) for name in names])[mesh.part[polygon]]
    nodes, owners = [], []
    for number in dict.fromkeys(owner.tolist()):
        chosen = owner == number
        writer = _ObjectWriter(asset, vertices, mesh, corners[chosen])
        owners.append(writer.owners)
        triangles = mesh.material[polygon[chosen]]
        primitives = []
        for material in dict.fromkeys(triangles.tolist()):
            primitive = writer.primitive(triangles == material)
            primitives.append(
                primitive | ({"material": materials[material]} if material >= 0 else {})
            )
        named = {"name": names[number]} if names[number] else {}
        shown = asset.add("meshes", {"primitives": primitives, **named})
        nodes.append(asset.add("nodes", {"mesh": shown, **named}))
    asset.json["scene"] = asset.add("scenes", {"nodes": nodes})
    return asset.data, np.concatenate(owners)


class _ObjectWriter:
    """Writes the vertices of one object, and the triangles that refer to them.

    Attributes:
        owners: for each vertex that is written, the one that it was split from.
    """

    def __init__(
        self, asset: GlbBuilder, vertices: FloatArray, mesh: PolygonMesh, corners: IntArray
    ) -> None:
        self._asset = asset
        flat = corners.ravel()
        keys = [mesh.corners[flat].astype(np.float64)]
        if mesh.normals is not None:
            keys.append(mesh.normals[flat].astype(np.float64))
        if mesh.uvs is not None:
            keys += list(np.nan_to_num(mesh.uvs[flat]).T)
        rows, self._index = np.unique(np.stack(keys, 1), axis=0, return_inverse=True)
        self._index = self._index.reshape(-1, 3)
        self.owners = own = rows[:, 0].astype(np.int64)
        arrays = {"POSITION": single_precision(vertices[own], "GLB")}
        if mesh.normals is not None:
            arrays["NORMAL"] = mesh.shading(vertices)[rows[:, 1].astype(np.int64)]
        if mesh.uvs is not None:
            arrays["TEXCOORD_0"] = rows[:, -2:] * (1, -1) + (0, 1)
        if mesh.colours is not None:
            colours = mesh.colours[own].copy()
            colours[:, :3] = linear_colours(colours[:, :3])
            arrays["COLOR_0"] = colours
        self._attributes = {key: asset.add_array(a, VERTICES) for key, a in arrays.items()}

    def primitive(self, chosen: np.ndarray) -> dict[str, Any]:
        """A primitive of some of the object's triangles."""
        corners = self._index[chosen].ravel().astype("<u4")
        indices = self._asset.add_array(corners, INDICES)
        return {"attributes": dict(self._attributes), "indices": indices}


def _described(material: Material) -> dict[str, Any]:
    found: dict[str, Any] = {"name": material.name}
    if material.colour is not None:
        surface = {"baseColorFactor": list(material.colour), "metallicFactor": 0.0}
        found["pbrMetallicRoughness"] = surface
        if material.colour[3] < 1:
            found["alphaMode"] = "BLEND"
    else:
        found["pbrMetallicRoughness"] = {"metallicFactor": 0.0}
    return found


# IEC 61966-2-1, the transfer function of sRGB.
def linear_colours(colours: FloatArray) -> FloatArray:
    """Colours of 0 to 1 that are encoded as sRGB, in linear form."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def encoded_colours(colours: FloatArray) -> FloatArray:
    """Linear colours of 0 to 1, encoded as sRGB."""
    return np.where(colours <= 0.0031308, colours * 12.92, 1.055 * colours ** (1 / 2.4) - 0.055)
