"""Nodes of a glTF scene: their order, their parents, and their transforms to the world."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from deformer.geometry import FloatArray
from deformer.io.gltf import GltfAsset
from deformer.io.gltf_marks import is_upright_node

# Local transforms (F, 4, 4) of nodes that move, by their numbers.
Moving = Mapping[int, FloatArray]
# Undoes the turn of `upright_node`, without its rounding.
_Y_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


class NodeTree:
    """The nodes that the scene of an asset shows.

    `order` are their numbers, depth first as the scene lists them; nodes that have neither a mesh
    nor children are left out of it, for there may be hundreds of thousands. The world of a scene
    that this program has turned from z up to y up, by a node of its own, is that of the data, z up.
    """

    def __init__(self, asset: GltfAsset) -> None:
        """Walk through the scene.

        Raises:
            InputError: a node that does not exist or has two parents.
        """
        self._asset = asset
        self.order: list[int] = []
        self.parents: dict[int, int] = {}
        self._upright_nodes: set[int] = set()
        stack = [(root, -1, "the scene") for root in reversed(self._roots())]
        while stack:
            index, parent, label = stack.pop()
            node = asset.item("nodes", index, label)
            if index in self.parents:
                raise asset.broken(f"node {index} is listed twice, expected one parent")
            self.parents[index] = parent
            if parent < 0 and is_upright_node(node):
                self._upright_nodes.add(index)
            if "mesh" in node or "children" in node:
                self.order.append(index)
                label = f"node {index}"
                children = asset.part(node, "children", [], label)
                stack += [(child, index, label) for child in reversed(children)]
        self._rest: dict[int, FloatArray] = {}

    def _roots(self) -> list:
        asset = self._asset
        nodes = asset.part(asset.json, "nodes", [], "the file")
        if asset.json.get("scenes"):
            scene = asset.item("scenes", asset.json.get("scene", 0), "the file")
            return asset.part(scene, "nodes", [], "the scene")
        # As text, since a damaged list may hold anything; the walk refuses that.
        listed: set[str] = set()
        for i in range(len(nodes)):
            node = asset.item("nodes", i, "the file")
            listed.update(map(str, asset.part(node, "children", [], f"node {i}")))
        return [i for i in range(len(nodes)) if str(i) not in listed]

    def path(self, index: int) -> list[int]:
        """Nodes from `index` up to its root."""
        found = [index]
        while (parent := self.parents[found[-1]]) >= 0:
            found.append(parent)
        return found

    def world(self, index: int, moving: Moving | None = None) -> FloatArray:
        """Transform (4, 4) of a node to the world, or (F, 4, 4) if it or a node above it moves.

        Args:
            index: number of a node of the scene.
            moving: local transforms of the nodes that move.

        Raises:
            InputError: a transform that is none.
        """
        if moving:
            return self._moved(index, moving, {})
        # Not recursive: a chain of nodes may be thousands deep.
        path = self.path(index)
        known = next((n for n, i in enumerate(path) if i in self._rest), len(path))
        world = self._rest[path[known]] if known < len(path) else np.eye(4)
        for i in reversed(path[:known]):
            world = _product(world, self._local(i))
            self._rest[i] = world
        return self._rest[index]

    def worlds(self, indices: list[int], moving: Moving) -> list[FloatArray]:
        """`world` of several nodes, which share the products of the nodes above them."""
        known: dict[int, FloatArray] = {}
        return [self._moved(index, moving, known) for index in indices]

    def _moved(self, index: int, moving: Moving, known: dict[int, FloatArray]) -> FloatArray:
        path = self.path(index)
        at = next((n for n, i in enumerate(path) if i in known), len(path))
        world = known[path[at]] if at < len(path) else np.eye(4)
        for i in reversed(path[:at]):
            local = self._local(i, moving)
            known[i] = world = _product(world, local)
        return world

    def _local(self, index: int, moving: Moving | None = None) -> FloatArray:
        """Transform (4, 4) or (F, 4, 4) of a node to its parent; of a root, to the world."""
        local = None if moving is None else moving.get(index)
        if local is None and index in self._upright_nodes:
            return np.eye(4)
        if local is None:
            local = local_transform(self._asset, index)
        lying = self._upright_nodes and self.parents[index] < 0
        return _Y_TO_Z @ local if lying else local


def _product(parent: FloatArray, local: FloatArray) -> FloatArray:
    """Parent · local; a factor that is the identity leaves the other as it is, bit by bit."""
    if local.ndim == 2 and np.array_equal(local, np.eye(4)):
        return parent
    return parent @ local


def local_transform(asset: GltfAsset, index: int) -> FloatArray:
    """Transform (4, 4) of a node to its parent: its matrix or translation · rotation · scale.

    Raises:
        InputError: a matrix, rotation, scale or translation that is none.
    """
    node, label = asset.item("nodes", index, "the scene"), f"node {index}"
    if "matrix" in node:
        return asset.numbers(node, "matrix", 16, label).reshape(4, 4).T
    if not {"rotation", "scale", "translation"} & node.keys():
        return np.eye(4)
    translation, rotation, scale = translation_rotation_scale(asset, index)
    return composed(translation[None], rotation[None], scale[None])[0]


def translation_rotation_scale(
    asset: GltfAsset, index: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Translation (3,), rotation (4,), x y z w, and scale (3,) of a node without a matrix.

    Raises:
        InputError: one of them is none.
    """
    node, label = asset.item("nodes", index, "the scene"), f"node {index}"
    found = [np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.ones(3)]
    for n, (key, length) in enumerate((("translation", 3), ("rotation", 4), ("scale", 3))):
        if key in node:
            found[n] = asset.numbers(node, key, length, label)
    if not abs(np.linalg.norm(found[1]) - 1) < 0.01:
        raise asset.broken(f"{label} has rotation {found[1].tolist()}, expected a unit quaternion")
    return found[0], found[1], found[2]


def composed(translation: FloatArray, rotation: FloatArray, scale: FloatArray) -> FloatArray:
    """Transforms (F, 4, 4) of translations (F, 3), quaternions x y z w (F, 4) and scales (F, 3)."""
    x, y, z, w = rotation.T
    found = np.zeros((len(translation), 4, 4))
    found[:, 0, :3] = np.stack(
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], 1
    )
    found[:, 1, :3] = np.stack(
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], 1
    )
    found[:, 2, :3] = np.stack(
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], 1
    )
    found[:, :3, :3] *= scale[:, None, :]
    found[:, :3, 3] = translation
    found[:, 3, 3] = 1.0
    return found
