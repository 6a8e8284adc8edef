"""Binary glTF (GLB): positions and triangles of all nodes of the scene, in the file's order."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io.glb_builder import INDICES, VERTICES, GlbBuilder
from deformer.io.parsing import fan_triangles

_FLOAT = {5126: "<f4"}
# With the extension KHR_mesh_quantization positions may be integers, too.
_QUANTISED = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2"}
_INDEX_TYPES = {5121: "u1", 5123: "<u2", 5125: "<u4"}
_TRIANGLES = 4
_COMPRESSION = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
# Nodes may show one mesh any number of times, so a small file could ask for any amount of memory.
# Counted are vertices, corners, and a fixed number for each primitive that a node shows.
_MOST_ITEMS = 4_000_000
_ITEMS_OF_PRIMITIVE = 200


def read_glb(data: bytes, name: str) -> tuple[FloatArray, IntArray]:
    """Positions (V, 3), node transforms applied, and triangles (F, 3) of a GLB file.

    Nodes come depth first as the scene lists them. Primitives of one node that share an array of
    positions share vertices; nothing else is merged, so a seam that the exporter split stays split.

    Args:
        data: contents of the file.
        name: file name for messages.

    Raises:
        InputError: broken contents, or a feature that would not keep the vertices exactly.
    """
    scene, binary = _chunks(data, name)
    return _Scene(scene, binary, name).mesh()


def _chunks(data: bytes, name: str) -> tuple[dict, bytes]:
    """The JSON chunk and the binary chunk of a GLB file."""
    if data[:4] != b"glTF" or data[4:8] != (2).to_bytes(4, "little"):
        raise InputError(f"{name}: no glTF 2.0 header, expected a .glb file; export it again")
    chunks: dict[bytes, bytes] = {}
    at = 12
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "little")
        chunk = data[at + 8 : at + 8 + length]
        if len(chunk) != length or at + 8 > len(data):
            raise InputError(
                f"{name}: a chunk holds {len(chunk)} bytes, expected {length}; the file is cut "
                "short, export it again"
            )
        chunks.setdefault(data[at + 4 : at + 8], chunk)
        at += 8 + length
    try:
        scene = json.loads(chunks.get(b"JSON", b""))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{name}: unreadable glTF JSON ({error}); export it again") from error
    if not isinstance(scene, dict):
        raise InputError(f"{name}: the glTF JSON is no object; export the file again")
    return scene, chunks.get(b"BIN\0", b"")


class _Scene:
    """The parsed JSON of one file and the mesh collected from it."""

    def __init__(self, scene: dict, binary: bytes, name: str) -> None:
        self._json, self._binary, self._name = scene, binary, name
        self._vertices: list[FloatArray] = []
        self._faces: list[IntArray] = []
        self._vertex_count = 0
        self._items = 0
        used = set(_strings(scene.get("extensionsUsed")))
        self._position_types = _FLOAT | (_QUANTISED if "KHR_mesh_quantization" in used else {})

    def mesh(self) -> tuple[FloatArray, IntArray]:
        self._refuse_compression("the file", _strings(self._json.get("extensionsRequired")))
        for node, index, world in self._nodes():
            if "mesh" not in node:
                continue
            if "EXT_mesh_gpu_instancing" in self._part(node, "extensions", {}, f"node {index}"):
                raise self._refusal(f"node {index} repeats its mesh", "make each copy a mesh")
            if "skin" in node:
                raise self._refusal(f"node {index} is moved by a skeleton", "apply the pose")
            mesh = self._item("meshes", node["mesh"], f"node {index}")
            weights = self._part(mesh, "weights", [], f"mesh {node['mesh']}")
            if any(self._part(node, "weights", weights, f"node {index}")):
                raise self._refusal(f"node {index} is moved by morph targets", "apply the shape")
            self._add_mesh(mesh, node["mesh"], world)
        if not self._faces:
            raise InputError(
                f"{self._name}: no faces, expected a scene with a triangle mesh; export it again"
            )
        return np.concatenate(self._vertices), np.concatenate(self._faces)

    def _nodes(self) -> Iterator[tuple[dict, int, FloatArray]]:
        """Nodes of the scene depth first, with their indices and transforms to the world (4, 4)."""
        nodes = self._part(self._json, "nodes", [], "the file")
        if self._json.get("scenes"):
            scene = self._item("scenes", self._json.get("scene", 0), "the file")
            roots = self._part(scene, "nodes", [], "the scene")
        else:
            # As text, since a damaged list may hold anything; `_item` refuses that below.
            listed: set[str] = set()
            for i in range(len(nodes)):
                node = self._item("nodes", i, "the file")
                listed.update(map(str, self._part(node, "children", [], f"node {i}")))
            roots = [i for i in range(len(nodes)) if str(i) not in listed]
        seen = set()
        identity = np.eye(4)
        stack = [(root, identity, "the scene") for root in reversed(roots)]
        while stack:
            index, parent, label = stack.pop()
            node = self._item("nodes", index, label)
            if index in seen:
                raise self._broken(f"node {index} is listed twice, expected one parent")
            seen.add(index)
            # The others need no transform, and there may be hundreds of thousands.
            if "mesh" in node or "children" in node:
                label = f"node {index}"
                world = self._world(parent, node, label)
                yield node, index, world
                children = self._part(node, "children", [], label)
                stack += [(child, world, label) for child in reversed(children)]

    def _world(self, parent: FloatArray, node: dict, label: str) -> FloatArray:
        """Transform (4, 4) of a node to the world: its own or translation · rotation · scale."""

        def numbers(key: str, length: int) -> FloatArray:
            values = node[key]
            if (
                not isinstance(values, list)
                or len(values) != length
                or not all(type(v) in (int, float) and abs(v) < 1e300 for v in values)
            ):
                found = f"{label} has {key} {values}"
                raise self._broken(f"{found[:120]}, expected {length} numbers")
            return np.array(values, dtype=np.float64)

        if "matrix" in node:
            return parent @ numbers("matrix", 16).reshape(4, 4).T
        if not {"rotation", "scale", "translation"} & node.keys():
            return parent
        local = np.eye(4)
        if "rotation" in node:
            quaternion = numbers("rotation", 4)
            if not abs(np.linalg.norm(quaternion) - 1) < 0.01:
                raise self._broken(
                    f"{label} has rotation {quaternion.tolist()}, expected a unit quaternion"
                )
            local[:3, :3] = _rotation(*quaternion.tolist())
        if "scale" in node:
            local[:3, :3] *= numbers("scale", 3)
        if "translation" in node:
            local[:3, 3] = numbers("translation", 3)
        return parent @ local

    def _add_mesh(self, mesh: dict, index: int, world: FloatArray) -> None:
        starts: dict[int, int] = {}
        primitives = self._part(mesh, "primitives", [], f"mesh {index}")
        if not primitives:
            raise self._broken(f"mesh {index} has no primitives")
        for number, primitive in enumerate(primitives):
            label = f"mesh {index} primitive {number}"
            if not isinstance(primitive, dict):
                raise self._broken(f"{label} is no object")
            self._refuse_compression(label, self._part(primitive, "extensions", {}, label))
            mode = primitive.get("mode", _TRIANGLES)
            if mode != _TRIANGLES:
                raise self._refusal(f"{label} has drawing mode {mode}", "export triangles only")
            accessor = self._part(primitive, "attributes", {}, label).get("POSITION")
            points = self._array(accessor, self._position_types, "VEC3", label)
            if "indices" in primitive:
                corners = self._array(primitive["indices"], _INDEX_TYPES, "SCALAR", label).ravel()
            else:
                corners = np.arange(len(points))
            if len(corners) % 3:
                raise self._refusal(f"{label} has {len(corners)} corners", "export triangles only")
            self._items += len(corners) + _ITEMS_OF_PRIMITIVE
            if accessor not in starts:
                self._items += len(points)
            if self._items > _MOST_ITEMS + len(self._binary):
                raise self._broken(
                    f"nodes repeat their meshes to more than {self._items} vertices and corners"
                )
            if accessor not in starts:
                starts[accessor] = self._vertex_count
                self._vertices.append(self._positions(points, accessor, world))
                self._vertex_count += len(points)
            faces = fan_triangles(
                corners.astype(np.int64),
                np.full(len(corners) // 3, 3, dtype=np.int64),
                len(points),
                self._name,
                lambda i, label=label: f"{label} face {i}",
            )
            # A mirroring transform turns faces inside out; glTF has the reader turn them back.
            if np.linalg.det(world[:3, :3]) < 0:
                faces = faces[:, [0, 2, 1]]
            self._faces.append(faces + starts[accessor])

    def _positions(self, stored: np.ndarray, accessor: int, world: FloatArray) -> FloatArray:
        points = stored.astype(np.float64)
        if stored.dtype.kind != "f" and self._json["accessors"][accessor].get("normalized"):
            # glTF 2.0, 3.6.2.2: c / 127 for 8 bits with sign, but never below −1.
            points = np.maximum(points / np.iinfo(stored.dtype).max, -1.0)
        if np.array_equal(world, np.eye(4)):
            return points
        return points @ world[:3, :3].T + world[:3, 3]

    def _array(self, index: int, types: dict[int, str], shape: str, label: str) -> np.ndarray:
        """Accessor `index` as an array (count, 3) of VEC3 or (count, 1) of SCALAR, not copied."""
        accessor = self._item("accessors", index, label)
        label = f"{label}, accessor {index}"
        if "sparse" in accessor or "bufferView" not in accessor:
            raise self._refusal(f"{label} is a sparse array", "export without sparse accessors")
        number, kind_name = accessor.get("componentType"), accessor.get("type")
        if kind_name != shape:
            raise self._broken(f"{label} is of type {kind_name!r}, expected {shape!r}")
        if type(number) is not int or number not in types:
            raise self._refusal(
                f"{label} has numbers of type {number}, expected one of {sorted(types)}",
                "export without quantisation",
            )
        view = self._item("bufferViews", accessor["bufferView"], label)
        self._refuse_compression(label, self._part(view, "extensions", {}, label))
        buffer = self._item("buffers", view.get("buffer"), label)
        if "uri" in buffer:
            raise self._refusal(f"{label} is kept outside the file", "export one .glb file")
        if view["buffer"] != 0:
            raise self._broken(f"{label} is in buffer {view['buffer']}, which the file lacks")
        kind = np.dtype(types[number])
        width = {"SCALAR": 1, "VEC3": 3}[shape]
        row = width * kind.itemsize
        count = self._whole(accessor, "count", None, label)
        stride = self._whole(view, "byteStride", row, label)
        first = self._whole(accessor, "byteOffset", 0, label)
        start = self._whole(view, "byteOffset", 0, label)
        length = self._whole(view, "byteLength", None, label)
        if count == 0 or stride < row or first + (count - 1) * stride + row > length:
            raise self._broken(
                f"{label} has {count} items of {row} bytes, {stride} apart from byte {first}, in a "
                f"view of {length} bytes"
            )
        if start + length > len(self._binary):
            raise self._broken(
                f"{label} is in a view up to byte {start + length} of {len(self._binary)}"
            )
        return np.ndarray(
            (count, width), kind, self._binary, start + first, (stride, kind.itemsize)
        )

    def _item(self, family: str, index: Any, label: str) -> dict:
        """Object number `index` of one of the lists at the top of the JSON."""
        items = self._json.get(family)
        if not isinstance(items, list):
            raise self._broken(f"no list of {family}")
        if type(index) is not int or not 0 <= index < len(items):
            raise self._broken(f"{label} refers to number {index!r} of {len(items)} {family}"[:120])
        if not isinstance(items[index], dict):
            raise self._broken(f"number {index} of {family} is no object")
        return items[index]

    def _part(self, item: dict, key: str, default: Any, label: str) -> Any:
        """Value of `key`, which is of the type of its default."""
        value = item.get(key, default)
        if not isinstance(value, type(default)):
            kind = "an object" if isinstance(default, dict) else "a list"
            raise self._broken(f"{label} has {key} {value!r}"[:120] + f", expected {kind}")
        return value

    def _whole(self, item: dict, key: str, default: int | None, label: str) -> int:
        value = item.get(key, default)
        if type(value) is not int or not 0 <= value < 2**53:
            raise self._broken(f"{label} has {key} {value!r}"[:120])
        return value

    def _refuse_compression(self, label: str, extensions: Any) -> None:
        for extension, method in _COMPRESSION.items():
            if extension in extensions:
                raise self._refusal(f"{label} is compressed by {method}", "switch compression off")

    def _refusal(self, found: str, remedy: str) -> InputError:
        return InputError(
            f"{self._name}: {found}, so vertices cannot be kept exactly; {remedy}, or export as PLY"
        )

    def _broken(self, found: str) -> InputError:
        return InputError(
            f"{self._name}: broken glTF structure, {found}; export the file again as glTF 2.0"
        )


def _rotation(x: float, y: float, z: float, w: float) -> FloatArray:
    """Matrix (3, 3) of a unit quaternion."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _strings(values: Any) -> list[str]:
    return [v for v in values if isinstance(v, str)] if isinstance(values, list) else []


def write_glb(vertices: FloatArray, faces: IntArray) -> bytes:
    """GLB of vertices (V, 3) and faces (F, 3), positions as float32."""
    asset = GlbBuilder()
    attributes = {"POSITION": asset.add_array(vertices, VERTICES)}
    corners = asset.add_array(faces.ravel().astype("<u4"), INDICES)
    mesh = asset.add("meshes", {"primitives": [{"attributes": attributes, "indices": corners}]})
    asset.add("scenes", {"nodes": [asset.add("nodes", {"mesh": mesh})]})
    asset.json["scene"] = 0
    return asset.data
