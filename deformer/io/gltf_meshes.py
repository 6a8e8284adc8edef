"""Meshes of a glTF scene as one mesh: which vertices come from where, faces, morph targets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import sparse

from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io.gltf import INDICES, GltfAsset
from deformer.io.gltf_nodes import Moving, NodeTree
from deformer.io.gltf_skins import Skin
from deformer.io.parsing import checked_polygons, distinct

_TRIANGLES = 4
# Nodes may show one mesh any number of times, so a small file could ask for any amount of memory.
# Counted are vertices, corners, and a fixed number for each primitive that a node shows.
_MOST_ITEMS = 4_000_000
_ITEMS_OF_PRIMITIVE = 200
# Numbers that the morph targets of a mesh may have in memory, for a file of any size, and the
# factor by which sparse ones may be larger than the file.
_MOST_NUMBERS = 125_000_000
_MOST_GROWN = 25
_MOST_TARGETS = 10_000


@dataclass(frozen=True, eq=False)
class VertexRange:
    """Vertices of the scene's mesh that come from one array of positions as one node shows it.

    Args:
        start: index of the first vertex.
        count: n, how many there are.
        node: number of the node.
        mesh: number of the mesh.
        primitives: numbers of the mesh's primitives that have these vertices.
        accessor: number of the accessor of the positions.
        targets: for each morph target the accessor of its displacements, or None.
        skin: number of the skin that moves the vertices; None if it is the node.
        transform: (4, 4) to the world; of a skin (n, 4, 4), the blended ones of the vertices.
    """

    start: int
    count: int
    node: int
    mesh: int
    primitives: tuple[int, ...]
    accessor: int
    targets: tuple[int | None, ...]
    skin: int | None
    transform: FloatArray


@dataclass(eq=False)
class _Part:
    """What is read of one range."""

    start: int
    node: int
    mesh: int
    accessor: int
    targets: tuple[int | None, ...]
    names: tuple[str, ...]
    positions: FloatArray  # (n, 3) in the mesh's own space
    skin_index: int | None
    skin: Skin | None
    primitives: list[int] = field(default_factory=list)
    offsets: FloatArray | None = None  # (T, n, 3), once they are needed


class GltfScene:
    """The meshes that the nodes of a scene show, as one.

    Nodes come depth first as the scene lists them. Primitives of one node that share an array of
    positions share vertices; nothing else is merged, so a seam that the exporter split stays split.

    `faces` (F, 3) are its triangles, `vertex_count` V its vertices, `tree` its nodes, and
    `target_names` the names of its morph targets: those of one name in several meshes are one.
    """

    def __init__(self, asset: GltfAsset) -> None:
        """Collect the meshes of an asset.

        Raises:
            InputError: no faces, a broken structure, or a feature that would not keep the vertices
                exactly.
        """
        self.asset, self.tree = asset, NodeTree(asset)
        self.vertex_count = 0
        self._parts: list[_Part] = []
        self._items = 0
        faces: list[IntArray] = []
        for node in self.tree.order:
            if "mesh" in asset.item("nodes", node, "the scene"):
                faces += self._add_node(node)
        if not faces:
            raise InputError(
                f"{asset.name}: no faces, expected a scene with a triangle mesh; export it again"
            )
        self.faces = np.concatenate(faces)
        self.target_names = tuple(dict.fromkeys(n for part in self._parts for n in part.names))

    @property
    def ranges(self) -> tuple[VertexRange, ...]:
        """Where the vertices come from, in their order."""
        found = []
        for part in self._parts:
            transform = self.tree.world(part.node)
            if part.skin is not None:
                transform = np.tile(np.eye(4), (len(part.positions), 1, 1))
                transform[:, :3] = part.skin.transforms({}, 1)[0]
            found.append(
                VertexRange(
                    part.start,
                    len(part.positions),
                    part.node,
                    part.mesh,
                    tuple(part.primitives),
                    part.accessor,
                    part.targets,
                    part.skin_index,
                    transform,
                )
            )
        return tuple(found)

    @property
    def mesh_nodes(self) -> set[int]:
        """Numbers of the nodes whose transforms matter: those that show a mesh, and joints."""
        found = {part.node for part in self._parts if part.skin is None}
        return found | {j for part in self._parts if part.skin for j in part.skin.joints}

    def target_counts(self) -> dict[int, int]:
        """The number of morph targets of every node that has some."""
        return {part.node: len(part.names) for part in self._parts if part.names}

    def default_weights(self) -> dict[int, FloatArray]:
        """Weights (T,) with which the file shows the morph targets, by node.

        Raises:
            InputError: not one number for each target.
        """
        asset, found = self.asset, {}
        for part in self._parts:
            node = asset.item("nodes", part.node, "the scene")
            label = f"node {part.node}"
            owner = node if "weights" in node else asset.item("meshes", part.mesh, label)
            if owner is not node:
                label = f"mesh {part.mesh}"
            if "weights" in owner:
                found[part.node] = asset.numbers(owner, "weights", len(part.names), label)
        return found

    def weights_of(self, names: tuple[str, ...]) -> dict[int, FloatArray]:
        """Weights (N, T), by node, of N shapes that show one target each, by its name."""
        found = {}
        for part in self._parts:
            if part.names:
                numbers = {name: t for t, name in enumerate(part.names)}
                found[part.node] = np.zeros((len(names), len(numbers)))
                for n, name in enumerate(names):
                    if name in numbers:
                        found[part.node][n, numbers[name]] = 1.0
        return found

    def vertices(
        self, weights: Mapping[int, FloatArray], moving: Moving, frame_count: int
    ) -> FloatArray:
        """Vertices (F, V, 3) in the world.

        Args:
            weights: weights (F, T) of the morph targets, by node; 0 where a node is missing.
            moving: local transforms (F, 4, 4) of nodes, by number; the others stay as in the file.
            frame_count: F.

        Raises:
            InputError: morph targets that do not fit their mesh or are too many for the memory.
        """
        found = np.empty((frame_count, self.vertex_count, 3))
        for part in self._parts:
            block = found[:, part.start : part.start + len(part.positions)]
            block[:] = part.positions
            given = weights.get(part.node)
            if given is not None and given.any():
                offsets = self._offsets(part).reshape(len(part.names), -1)
                block += (sparse.csr_array(given) @ offsets).reshape(block.shape)
            if part.skin is not None:
                transforms = part.skin.transforms(moving, frame_count)
                block[:] = np.einsum("fvij,fvj->fvi", transforms[..., :3], block)
                block += transforms[..., 3]
            else:
                world = self.tree.world(part.node, moving)
                if not np.array_equal(world, np.eye(4)):
                    turned = block @ np.swapaxes(world[..., :3, :3], -1, -2)
                    block[:] = turned + world[..., None, :3, 3]
        return found

    def _offsets(self, part: _Part) -> FloatArray:
        """Displacements (T, n, 3) of the morph targets."""
        if part.offsets is None:
            n, asset = len(part.positions), self.asset
            size = 3 * n * len(part.names)
            if size > max(_MOST_NUMBERS, _MOST_GROWN * asset.size // 8):
                raise asset.refusal(
                    f"mesh {part.mesh} has {len(part.names)} morph targets of {n} vertices, "
                    f"{_MOST_GROWN} times the size of the file or more",
                    "export fewer of them",
                )
            part.offsets = np.zeros((len(part.names), n, 3))
            for t, accessor in enumerate(part.targets):
                label = f"mesh {part.mesh} target {t}"
                if accessor is not None:
                    offsets = asset.floats(accessor, "VEC3", asset.position_types, label)
                    if len(offsets) != n:
                        raise asset.broken(f"{label} has {len(offsets)} vertices, expected {n}")
                    part.offsets[t] = offsets
        return part.offsets

    def _add_node(self, node_index: int) -> list[IntArray]:
        """Faces (F, 3) of the primitives that a node shows."""
        asset, label = self.asset, f"node {node_index}"
        node = asset.item("nodes", node_index, "the scene")
        if "EXT_mesh_gpu_instancing" in asset.part(node, "extensions", {}, label):
            raise asset.refusal(f"{label} repeats its mesh", "make each copy a mesh")
        index = node["mesh"]
        mesh = asset.item("meshes", index, label)
        primitives = asset.part(mesh, "primitives", [], f"mesh {index}")
        if not primitives:
            raise asset.broken(f"mesh {index} has no primitives")
        parts: dict[tuple, _Part] = {}
        names: tuple[str, ...] | None = None
        found = []
        for number, primitive in enumerate(primitives):
            label = f"mesh {index} primitive {number}"
            if not isinstance(primitive, dict):
                raise asset.broken(f"{label} is no object")
            targets = self._targets(primitive, label)
            if names is None:
                names = _target_names(mesh, len(targets))
            if len(targets) != len(names):
                raise asset.broken(f"{label} has {len(targets)} targets, others {len(names)}")
            faces, part = self._add_primitive(node_index, index, primitive, targets, parts, label)
            part.primitives.append(number)
            part.names = names
            # A mirroring transform turns faces inside out; glTF has the reader turn them back.
            if np.linalg.det(self._orientation(part)) < 0:
                faces = faces[:, [0, 2, 1]]
            found.append(faces + part.start)
        return found

    def _orientation(self, part: _Part) -> FloatArray:
        """The linear part (3, 3) of the transform of a range, of a skin that of a middle vertex."""
        if part.skin is None:
            return self.tree.world(part.node)[:3, :3]
        blended = part.skin.transforms({}, 1)[0, :, :, :3]
        return blended[np.argsort(np.linalg.det(blended))[len(blended) // 2]]

    def _targets(self, primitive: dict, label: str) -> tuple[int | None, ...]:
        found = []
        targets = self.asset.part(primitive, "targets", [], label)
        if len(targets) > _MOST_TARGETS:
            raise self.asset.refusal(f"{label} has {len(targets)} targets", "export fewer")
        for t, target in enumerate(targets):
            if not isinstance(target, dict):
                raise self.asset.broken(f"{label} target {t} is no object")
            found.append(target.get("POSITION"))
            if found[-1] is not None:
                self.asset.item("accessors", found[-1], f"{label} target {t}")
        return tuple(found)

    def _add_primitive(
        self,
        node_index: int,
        mesh_index: int,
        primitive: dict,
        targets: tuple[int | None, ...],
        parts: dict[tuple, _Part],
        label: str,
    ) -> tuple[IntArray, _Part]:
        """Faces (F, 3), counted from the range's first vertex, and the range of a primitive."""
        asset = self.asset
        asset.refuse_compression(label, asset.part(primitive, "extensions", {}, label))
        mode = primitive.get("mode", _TRIANGLES)
        if mode != _TRIANGLES:
            raise asset.refusal(f"{label} has drawing mode {mode!r}"[:120], "export triangles only")
        attributes = asset.part(primitive, "attributes", {}, label)
        accessor = attributes.get("POSITION")
        points = asset.array(accessor, "VEC3", asset.position_types, label)
        if "indices" in primitive:
            corners = asset.array(primitive["indices"], "SCALAR", INDICES, label).ravel()
        else:
            corners = np.arange(len(points))
        if len(corners) % 3:
            raise asset.refusal(f"{label} has {len(corners)} corners", "export triangles only")
        skin_index = asset.item("nodes", node_index, label).get("skin")
        influences = tuple(sorted((k, v) for k, v in attributes.items() if _is_influence(k)))
        # As text, since a damaged file may have anything as the number of an accessor.
        key = (accessor, targets, str(influences) if skin_index is not None else "")
        self._items += len(corners) + _ITEMS_OF_PRIMITIVE + len(targets)
        if key not in parts:
            self._items += len(points) * (1 if skin_index is None else 1 + len(influences))
        if self._items > _MOST_ITEMS + asset.size:
            raise asset.broken(
                f"nodes repeat their meshes to more than {self._items} vertices and corners"
            )
        if key not in parts:
            positions = asset.floats(accessor, "VEC3", asset.position_types, label)
            skin = None
            if skin_index is not None:
                skin = Skin(asset, self.tree, skin_index, attributes, len(points), label)
            parts[key] = _Part(
                self.vertex_count, node_index, mesh_index, accessor, targets, (), positions,
                skin_index, skin,
            )  # fmt: skip
            self._parts.append(parts[key])
            self.vertex_count += len(points)
        polygons = checked_polygons(
            corners.astype(np.int64),
            np.full(len(corners) // 3, 3, dtype=np.int64),
            len(points),
            asset.name,
            lambda i: f"{label} face {i}",
        )
        return polygons.corners.reshape(-1, 3), parts[key]


def _is_influence(attribute: Any) -> bool:
    return isinstance(attribute, str) and attribute.startswith(("JOINTS_", "WEIGHTS_"))


def _target_names(mesh: dict, count: int) -> tuple[str, ...]:
    """Names of a mesh's morph targets; those without a name have a number, and none comes twice."""
    extras = mesh.get("extras")
    given = extras.get("targetNames") if isinstance(extras, dict) else None
    if not isinstance(given, list) or len(given) != count:
        given = [None] * count
    return distinct(
        name if isinstance(name, str) and name.strip() else f"target {t}"
        for t, name in enumerate(given)
    )
