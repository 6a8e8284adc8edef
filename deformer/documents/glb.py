"""GLB files as documents: new positions, normals and tangents in a scene that stays."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import numpy as np

from deformer.documents.glb_file import COMPONENTS, GlbFile
from deformer.documents.normals import present, renewed_normals, smooth_groups, tangents, touched
from deformer.documents.polygons import first_of_each
from deformer.documents.text_files import single_precision
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io import INDICES, GltfAsset, GltfScene, VertexRange

_INFLUENCES = ("JOINTS_", "WEIGHTS_")


def rewritten_glb(data: bytes, vertices: FloatArray) -> bytes:
    """The file with other positions, and with other normals and tangents where it has them.

    Positions go back into the space of the node that shows them. Arrays of single precision that
    nothing else uses are written over; quantised, sparse, shared and interleaved ones become arrays
    of their own. The bytes of all other arrays and of images stay, and so do nodes, materials and
    other nodes' meshes.

    A pose replaces the base shape: morph targets, weights and the skin of a mesh are removed, and
    so are animations that would move it, for they would deform the pose again.

    Args:
        data: contents of a GLB file without other files.
        vertices: (V, 3) new positions in the world, in the order of the scene.

    Raises:
        InputError: a position too large for single precision, or a node that flattens its mesh.
    """
    scene = GltfScene(GltfAsset(data, "the document"))
    if np.array_equal(shown_vertices(scene), vertices):
        return data
    return undeformed_glb(scene, vertices)


def undeformed_glb(scene: GltfScene, vertices: FloatArray) -> bytes:
    """As `rewritten_glb`, of a scene; what deforms its meshes is removed even if none has moved.

    Every node of the scene that shows a mesh has one of its own.
    """
    shown = shown_vertices(scene)
    file, ranges = GlbFile(scene.asset), scene.ranges
    _separate_meshes(file, ranges)
    before = shown.copy()
    for part in ranges:
        if part.skin is not None or part.targets:
            # The file stores these in another place than it shows them: all is new.
            before[part.start : part.start + part.count] = np.nan
    moved = (before != vertices).any(axis=1)
    normals = scene_normals(scene, ranges)
    new_normals = _new_normals(shown, before, normals, vertices, scene.faces)
    near = np.zeros(len(vertices), dtype=bool)
    corners = scene.faces.ravel()
    near[corners[touched(corners, np.full(len(scene.faces), 3), moved)]] = True
    for part in ranges:
        rows = slice(part.start, part.start + part.count)
        faces = scene.faces[(scene.faces[:, 0] >= rows.start) & (scene.faces[:, 0] < rows.stop)]
        writer = _RangeWriter(file, scene, part)
        writer.write_positions(vertices[rows], ~moved[rows])
        same = (new_normals[rows] == normals[rows]).all(axis=1)
        writer.write_normals(new_normals[rows], ~moved[rows] & same)
        writer.write_tangents(shown, vertices, faces, new_normals, ~near[rows] & same)
    _remove_deformers(file, scene, ranges)
    return file.data


def shown_vertices(scene: GltfScene) -> FloatArray:
    """Positions (V, 3) in the world, as the file shows them."""
    weights = {node: values[None] for node, values in scene.default_weights().items()}
    return scene.vertices(weights, {}, 1)[0]


def scene_normals(scene: GltfScene, ranges: tuple[VertexRange, ...]) -> FloatArray:
    """Normals (V, 3) in the world before any skin; NaN where the file has none."""
    found = np.full((scene.vertex_count, 3), np.nan)
    for part in ranges:
        accessor = next((n for _, n in attributes_of(scene.asset.json, part, "NORMAL")), None)
        if accessor is not None:
            own = scene.asset.floats(accessor, "VEC3", COMPONENTS, "NORMAL")
            linear = scene.tree.world(part.node)[:3, :3]
            if len(own) == part.count and np.linalg.det(linear) != 0:
                turned = own @ np.linalg.inv(linear)
                length = np.linalg.norm(turned, axis=1, keepdims=True)
                found[part.start : part.start + part.count] = turned / np.where(length, length, 1)
    return found


def _new_normals(
    shown: FloatArray,
    before: FloatArray,
    normals: FloatArray,
    vertices: FloatArray,
    faces: IntArray,
) -> FloatArray:
    """Normals (V, 3) of new positions; NaN where there are none.

    Vertices of one place in `shown` with one of the normals share the new one; those whose faces
    are as in `before` keep it.
    """
    has = present(normals)
    groups = smooth_groups(shown, np.where(has[:, None], normals, 9.0))
    firsts, _ = first_of_each(groups, normals, int(groups.max()) + 1)
    counts, corners = np.full(len(faces), 3), faces.ravel()
    of_corners = np.where(has[corners], groups[corners], -1)
    anew = renewed_normals(firsts, of_corners, before, vertices, counts, corners)
    same = (anew == firsts).all(axis=1)[groups]
    return np.where(same[:, None] | ~has[:, None], normals, anew[groups])


def attributes_of(description: dict, part: VertexRange, name: str) -> Iterator[tuple[dict, int]]:
    """The attributes of the primitives of a range that have one of a name, and its accessor."""
    mesh = description["meshes"][description["nodes"][part.node]["mesh"]]
    for number in part.primitives:
        attributes = mesh["primitives"][number]["attributes"]
        if isinstance(attributes.get(name), int):
            yield attributes, attributes[name]


class _RangeWriter:
    """Writes arrays of the vertices of one range."""

    def __init__(self, file: GlbFile, scene: GltfScene, part: VertexRange) -> None:
        self._file, self._scene, self._part = file, scene, part
        self._world = scene.tree.world(part.node)
        self._linear = self._world[:3, :3]
        scale = np.abs(self._linear).max()
        if not scale > 0 or abs(np.linalg.det(self._linear / scale)) < 1e-12:
            raise InputError(
                f"node {part.node} of the document flattens its mesh, expected a transform with an "
                "inverse; apply the scale and train again"
            )
        self._normals: FloatArray | None = None

    def write_positions(self, points: FloatArray, kept: np.ndarray) -> None:
        local = (points - self._world[:3, 3]) @ np.linalg.inv(self._linear).T
        self._write("POSITION", local, kept)

    def write_normals(self, normals: FloatArray, kept: np.ndarray) -> None:
        self._normals = _unit(normals @ self._linear)
        self._write("NORMAL", self._normals, kept)

    def write_tangents(
        self,
        shown: FloatArray,
        vertices: FloatArray,
        faces: IntArray,
        normals: FloatArray,
        kept: np.ndarray,
    ) -> None:
        """Tangents along the texture coordinates of the normal map.

        Without such coordinates they are the old ones, orthogonal to the new normals.
        """
        part = self._part
        rows = slice(part.start, part.start + part.count)
        found = list(attributes_of(self._file.json, part, "TANGENT"))
        if not found or self._normals is None or np.isnan(normals[rows]).any():
            return
        old = self._scene.asset.floats(found[0][1], "VEC4", COMPONENTS, "TANGENT")
        local, normal = old[:, :3], self._normals
        uvs = self._uvs()
        if len(old) != part.count:
            return
        if uvs is not None:
            groups = smooth_groups(shown[rows], old[:, :3] + 9 * old[:, 3:])
            along = tangents(vertices[rows], faces - part.start, uvs, normals[rows], groups)
            turned = along @ np.linalg.inv(self._linear).T
            local = np.where((turned != 0).any(axis=1, keepdims=True), turned, local)
        local = _unit(local - normal * (local * normal).sum(axis=1, keepdims=True))
        self._write("TANGENT", np.concatenate([local, old[:, 3:]], axis=1), kept)

    def _uvs(self) -> FloatArray | None:
        """Texture coordinates (n, 2) of the normal map, or the first ones; None without."""
        asset = self._scene.asset
        primitive = asset.json["meshes"][self._part.mesh]["primitives"][self._part.primitives[0]]
        materials = asset.json.get("materials", [])
        material = primitive.get("material")
        texture: Any = {}
        if isinstance(material, int) and 0 <= material < len(materials):
            texture = materials[material].get("normalTexture", {})
        accessor = primitive["attributes"].get(f"TEXCOORD_{texture.get('texCoord', 0)}")
        if accessor is None:
            return None
        uvs = asset.floats(accessor, "VEC2", COMPONENTS, "texture coordinates")
        return uvs if len(uvs) == self._part.count else None

    def _write(self, name: str, values: FloatArray, kept: np.ndarray) -> None:
        """Write an attribute of all primitives of the range that have it.

        Args:
            name: the attribute.
            values: (n, k) new values.
            kept: (n,) true for rows that stay as they are.
        """
        for accessor in dict.fromkeys(
            n for _, n in attributes_of(self._file.json, self._part, name)
        ):
            shape = "VEC4" if values.shape[1] == 4 else "VEC3"
            old = self._scene.asset.floats(accessor, shape, COMPONENTS, name)
            if len(old) != len(values):
                continue
            rows = single_precision(np.where(kept[:, None], old, values), "GLB")
            owners = [
                a for a, n in attributes_of(self._file.json, self._part, name) if n == accessor
            ]
            new = self._file.replace_array(accessor, rows, owners, name)
            for owner in owners:
                owner[name] = new


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1.0), (0.0, 0.0, 1.0))


def _separate_meshes(file: GlbFile, ranges: tuple[VertexRange, ...]) -> None:
    """Give every node of the scene a mesh of its own, for poses of several may differ."""
    description = file.json
    posed = dict.fromkeys(part.node for part in ranges)
    taken = {node["mesh"] for n, node in enumerate(description["nodes"])
             if n not in posed and "mesh" in node}  # fmt: skip
    for number in posed:
        node = description["nodes"][number]
        if node["mesh"] in taken:
            node["mesh"] = file.add("meshes", copy.deepcopy(description["meshes"][node["mesh"]]))
        taken.add(node["mesh"])


def turn_faces(file: GlbFile, asset: GltfAsset, primitive: dict[str, Any]) -> None:
    """Give a primitive corners in the opposite order."""
    if "indices" in primitive:
        types = {5121: "u1", 5123: "<u2", 5125: "<u4"}
        corners = asset.array(primitive["indices"], "SCALAR", types, "indices")
    else:
        count = file.json["accessors"][primitive["attributes"]["POSITION"]]["count"]
        corners = np.arange(count, dtype="<u4")
    turned = corners.reshape(-1, 3)[:, [0, 2, 1]].ravel()
    primitive["indices"] = file.add_array(turned, INDICES)


def _remove_deformers(file: GlbFile, scene: GltfScene, ranges: tuple[VertexRange, ...]) -> None:
    """Remove what would deform or move the posed meshes again."""
    description = file.json
    for part in ranges:
        node = description["nodes"][part.node]
        mesh = description["meshes"][node["mesh"]]
        # Without the skin the node's transform counts, and if it mirrors, the sides change.
        if part.skin is not None:
            inverted = np.median(np.linalg.det(part.transform[:, :3, :3])) < 0
            if inverted != (np.linalg.det(scene.tree.world(part.node)[:3, :3]) < 0):
                for number in part.primitives:
                    turn_faces(file, scene.asset, mesh["primitives"][number])
        for owner, key in ((node, "weights"), (node, "skin"), (mesh, "weights")):
            owner.pop(key, None)
        extras = mesh.get("extras")
        if isinstance(extras, dict) and extras.pop("targetNames", None) and not extras:
            del mesh["extras"]
        for primitive in mesh["primitives"]:
            primitive.pop("targets", None)
            for name in [n for n in primitive["attributes"] if n.startswith(_INFLUENCES)]:
                del primitive["attributes"][name]
    nodes, movers = description["nodes"], {part.node for part in ranges}
    removed = {part.skin for part in ranges} - {node.get("skin") for node in nodes} - {None}
    for number in removed:
        movers.update(description["skins"][number]["joints"])
    file.remove_animations({n for each in movers for n in scene.tree.path(each)})
    if removed:
        left = [n for n in range(len(description["skins"])) if n not in removed]
        description["skins"] = [description["skins"][n] for n in left]
        for node in nodes:
            if "skin" in node:
                node["skin"] = left.index(node["skin"])
    if not description.get("skins"):
        description.pop("skins", None)
