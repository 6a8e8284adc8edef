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


def rooted_glb(document: Document, vertices: FloatArray) -> tuple[bytes, IntArray]:
    """As `posed_glb`, with every mesh in world space on a node that is a root without a transform.

    Skinned meshes are to be so (glTF 2.0, 3.7.3.2): programs ignore the transforms of their nodes.
    A node with children, a camera or extensions stays where it is with these, without its mesh.

    Args:
        document: a document of V vertices.
        vertices: (V, 3) positions.

    Returns:
        the file, and for each vertex of its scene the vertex of the document.

    Raises:
        InputError: as of `Document.write`.
    """
    data, owners = posed_glb(document, vertices, document.faces)
    return document.guarded(lambda: _rooted(data, vertices[owners])), owners


def _rooted(data: bytes, points: FloatArray) -> bytes:
    scene = GltfScene(GltfAsset(data, "the document"))
    file, ranges = GlbFile(scene.asset), scene.ranges
    for part in ranges:
        if not np.array_equal(part.transform, np.eye(4)):
            own = points[part.start : part.start + part.count]
            _write_in_world(file, scene.asset, part, own)
    _move_to_roots(file, scene, ranges)
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
