"""Documents as GLB files whose meshes lie in the world, at the roots of the scene."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from deformer.documents.document import Document
from deformer.documents.glb import attributes_of, turn_faces
from deformer.documents.glb_file import COMPONENTS, GlbFile
from deformer.documents.glb_poses import posed_glb
from deformer.documents.text_files import single_precision
from deformer.geometry import FloatArray, IntArray
from deformer.io import GltfAsset, GltfScene, VertexRange

_TRANSFORM = ("matrix", "translation", "rotation", "scale")
# What stays where a node is when its mesh moves to a root.
_HELD = {"children", "camera", "extensions"}
# A node with one of these, or with children, is not empty.
_CONTENT = {"mesh", "skin", "camera", "extensions", "extras"}
# Extensions of the asset, its scenes, nodes, skins and animations that refer to no node.
_WITHOUT_NODES = {"KHR_lights_punctual", "KHR_materials_variants", "KHR_xmp_json_ld"}


def rooted_glb(document: Document, vertices: FloatArray) -> tuple[bytes, IntArray]:
    """As `posed_glb`, with every mesh in world space on a node that is a root without a transform.

    Skinned meshes are to be so (glTF 2.0, 3.7.3.2): programs ignore the transforms of their nodes.
    A node with children, a camera or extensions stays where it is with these, without its mesh.
    Groups that are empty then are removed, and so are bones of a skin that the meshes had, unless
    something else hangs on them or an extension may refer to them.

    Args:
        document: a document of V vertices.
        vertices: (V, 3) positions.

    Returns:
        the file, and for each vertex of its scene the vertex of the document.

    Raises:
        InputError: as of `Document.write`.
    """
    data, owners = posed_glb(document, vertices, document.faces)
    return document.guarded(lambda: _rooted(document, data, vertices[owners])), owners


def _rooted(document: Document, data: bytes, points: FloatArray) -> bytes:
    scene = GltfScene(GltfAsset(data, "the document"))
    file, ranges = GlbFile(scene.asset), scene.ranges
    for part in ranges:
        if not np.array_equal(part.transform, np.eye(4)):
            own = points[part.start : part.start + part.count]
            _write_in_world(file, scene.asset, part, own)
    _move_to_roots(file, scene, ranges)
    bones = _former_bones(document, scene.asset.json) if document.suffix == ".glb" else set()
    _remove_empty(file, scene, {part.node for part in ranges} | bones)
    return file.data


def _write_in_world(file: GlbFile, asset: GltfAsset, part: VertexRange, points: FloatArray) -> None:
    """Put positions (n, 3), normals, tangents and sides of a range into world space."""
    linear = part.transform[:3, :3]
    sign = np.sign(np.linalg.det(linear))

    def normals(rows: FloatArray) -> FloatArray:
        return _unit(rows @ np.linalg.inv(linear))

    def tangents(rows: FloatArray) -> FloatArray:
        return np.concatenate([_unit(rows[:, :3] @ linear.T), sign * rows[:, 3:]], axis=1)

    for name, shape, change in (
        ("POSITION", "VEC3", lambda _: points),
        ("NORMAL", "VEC3", normals),
        ("TANGENT", "VEC4", tangents),
    ):
        for accessor in dict.fromkeys(n for _, n in attributes_of(file.json, part, name)):
            users = [a for a, n in attributes_of(file.json, part, name) if n == accessor]
            old = asset.floats(accessor, shape, COMPONENTS, name)
            new = file.replace_array(accessor, single_precision(change(old), "GLB"), users, name)
            for user in users:
                user[name] = new
    if sign < 0:
        primitives = file.json["meshes"][file.json["nodes"][part.node]["mesh"]]["primitives"]
        for number in part.primitives:
            turn_faces(file, asset, primitives[number])


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def _move_to_roots(file: GlbFile, scene: GltfScene, ranges: tuple[VertexRange, ...]) -> None:
    """Make the nodes that show a mesh roots of their scenes, in the order of the vertices."""
    nodes, before = file.json["nodes"], scene.asset.json
    order = list(dict.fromkeys(part.node for part in ranges))
    moved: dict[int, int] = {}
    # Children first: a node whose children have all moved holds nothing.
    for number in reversed(order):
        node, parent = nodes[number], scene.tree.parents[number]
        if _HELD & node.keys():
            root = {key: node[key] for key in ("name", "mesh", "extras") if key in node}
            del node["mesh"]
            moved[number] = file.add("nodes", root)
            continue
        moved[number] = number
        for key in _TRANSFORM:
            node.pop(key, None)
        if parent >= 0:
            nodes[parent]["children"].remove(number)
            if not nodes[parent]["children"]:
                del nodes[parent]["children"]
    for shown in file.json.get("scenes", []):
        there = _below(before["nodes"], shown.get("nodes", []))
        if there.isdisjoint(order):
            continue
        others = [n for n in shown["nodes"] if moved.get(n) != n]
        shown["nodes"] = others + [moved[n] for n in order if n in there]


def _below(nodes: list[dict[str, Any]], roots: Iterable[int]) -> set[int]:
    """The numbers of some nodes and of all below them."""
    found, stack = set(), list(roots)
    while stack:
        number = stack.pop()
        if number not in found:
            found.add(number)
            stack += nodes[number].get("children", [])
    return found


def _former_bones(document: Document, posed: dict[str, Any]) -> set[int]:
    """The nodes of the bones that moved the meshes of a GLB document before they were posed."""
    before = GltfAsset(document.data, "the document").json
    pairs = zip(before["nodes"], posed["nodes"], strict=False)
    skins = {old["skin"] for old, new in pairs if "skin" in old and "skin" not in new}
    return {joint for skin in skins for joint in before["skins"][skin]["joints"]}


def _remove_empty(file: GlbFile, scene: GltfScene, below: set[int]) -> None:
    """Remove the nodes from some up to their roots that hold nothing any more.

    Args:
        file: the file.
        scene: the scene before anything moved.
        below: the nodes.
    """
    nodes, used = file.json["nodes"], _used_nodes(file.json)
    if used is None:
        return
    removed: set[int] = set()
    found = {n for each in below for n in scene.tree.path(each)} - used
    for number in sorted(found, key=lambda n: len(scene.tree.path(n)), reverse=True):
        if nodes[number].keys() & _CONTENT:
            continue
        if removed.issuperset(nodes[number].get("children", [])):
            removed.add(number)
    if removed:
        file.remove_nodes(removed)


def _used_nodes(description: dict[str, Any]) -> set[int] | None:
    """Nodes that skins and animations refer to; None if extensions may refer to others."""
    clips, skins = description.get("animations", []), description.get("skins", [])
    channels = [channel for clip in clips for channel in clip["channels"]]
    targets = [channel["target"] for channel in channels]
    owners = [description, *description["nodes"], *description.get("scenes", [])]
    for owner in (*owners, *skins, *clips, *channels, *targets):
        if not _WITHOUT_NODES.issuperset(owner.get("extensions", {})):
            return None
    found = {target["node"] for target in targets if "node" in target}
    for skin in skins:
        found.update(skin["joints"], [skin["skeleton"]] if "skeleton" in skin else [])
    return found
