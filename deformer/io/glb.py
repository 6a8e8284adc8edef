"""Binary glTF (GLB): positions and triangles of all nodes of the scene, in the file's order."""

from __future__ import annotations

import json

import numpy as np

from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.io.parsing import fan_triangles

_FLOAT = 5126
_INDEX_TYPES = {5121: "u1", 5123: "<u2", 5125: "<u4"}
_TRIANGLES = 4


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
    try:
        return _Scene(scene, binary, name).mesh()
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"{name}: broken glTF structure ({type(error).__name__}: {error}), expected glTF 2.0; "
            "export the file again"
        ) from error


def _chunks(data: bytes, name: str) -> tuple[dict, bytes]:
    """The JSON chunk and the binary chunk of a GLB file."""
    if data[:4] != b"glTF" or data[4:8] != (2).to_bytes(4, "little"):
        raise InputError(f"{name}: no glTF 2.0 header, expected a .glb file; export it again")
    chunks: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= len(data):
        length = int.from_bytes(data[at : at + 4], "little")
        chunk = data[at + 8 : at + 8 + length]
        if len(chunk) != length:
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
    return scene, chunks.get(b"BIN\0", b"")


class _Scene:
    """The parsed JSON of one file and the mesh collected from it."""

    def __init__(self, scene: dict, binary: bytes, name: str) -> None:
        self._json, self._binary, self._name = scene, binary, name
        self._vertices: list[FloatArray] = []
        self._faces: list[IntArray] = []
        self._vertex_count = 0

    def mesh(self) -> tuple[FloatArray, IntArray]:
        nodes = self._json.get("nodes", [])
        scenes = self._json.get("scenes", [])
        if scenes:
            roots = scenes[self._json.get("scene", 0)].get("nodes", [])
        else:
            children = {child for node in nodes for child in node.get("children", [])}
            roots = [i for i in range(len(nodes)) if i not in children]
        for root in roots:
            self._add_node(nodes, root, np.eye(4))
        if not self._faces:
            raise InputError(
                f"{self._name}: no faces, expected a scene with a triangle mesh; export it again"
            )
        return np.concatenate(self._vertices), np.concatenate(self._faces)

    def _add_node(self, nodes: list[dict], index: int, parent: FloatArray) -> None:
        node = nodes[index]
        world = parent @ _local_transform(node)
        if "mesh" in node:
            if "skin" in node:
                raise self._refusal(f"node {index} is moved by a skeleton", "apply the pose")
            mesh = self._json["meshes"][node["mesh"]]
            if any(node.get("weights", mesh.get("weights", []))):
                raise self._refusal(f"node {index} is moved by morph targets", "apply the shape")
            self._add_mesh(mesh, node["mesh"], world)
        for child in node.get("children", []):
            self._add_node(nodes, child, world)

    def _add_mesh(self, mesh: dict, index: int, world: FloatArray) -> None:
        starts: dict[int, int] = {}
        for number, primitive in enumerate(mesh["primitives"]):
            label = f"mesh {index} primitive {number}"
            if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
                raise self._refusal(f"{label} is compressed by Draco", "switch compression off")
            mode = primitive.get("mode", _TRIANGLES)
            if mode != _TRIANGLES:
                raise self._refusal(f"{label} has drawing mode {mode}", "export triangles only")
            accessor = primitive["attributes"]["POSITION"]
            count = self._json["accessors"][accessor]["count"]
            if accessor not in starts:
                starts[accessor] = self._vertex_count
                self._vertices.append(self._positions(accessor, world, label))
                self._vertex_count += count
            if "indices" in primitive:
                corners = self._array(primitive["indices"], _INDEX_TYPES, 1, label).ravel()
                corners = corners.astype(np.int64)
            else:
                corners = np.arange(count, dtype=np.int64)
            if len(corners) % 3:
                raise self._refusal(f"{label} has {len(corners)} corners", "export triangles only")
            faces = fan_triangles(
                corners,
                np.full(len(corners) // 3, 3, dtype=np.int64),
                count,
                self._name,
                lambda i, label=label: f"{label} face {i}",
            )
            # A mirroring transform turns faces inside out; glTF has the reader turn them back.
            if np.linalg.det(world[:3, :3]) < 0:
                faces = faces[:, [0, 2, 1]]
            self._faces.append(faces + starts[accessor])

    def _positions(self, accessor: int, world: FloatArray, label: str) -> FloatArray:
        points = self._array(accessor, {_FLOAT: "<f4"}, 3, label).astype(np.float64)
        if np.array_equal(world, np.eye(4)):
            return points
        return points @ world[:3, :3].T + world[:3, 3]

    def _array(self, index: int, types: dict[int, str], width: int, label: str) -> np.ndarray:
        """Accessor `index` as an array (count, width)."""
        accessor = self._json["accessors"][index]
        if "sparse" in accessor or "bufferView" not in accessor:
            raise self._refusal(f"{label} has a sparse array", "export without sparse accessors")
        if accessor["componentType"] not in types:
            raise self._refusal(
                f"{label} has numbers of type {accessor['componentType']}, expected one of "
                f"{sorted(types)}",
                "export without quantisation",
            )
        view = self._json["bufferViews"][accessor["bufferView"]]
        if "EXT_meshopt_compression" in view.get("extensions", {}):
            raise self._refusal(f"{label} is compressed by meshopt", "switch compression off")
        if "uri" in self._json["buffers"][view["buffer"]]:
            raise self._refusal(f"{label} is kept outside the file", "export one .glb file")
        kind = np.dtype(types[accessor["componentType"]])
        stride = view.get("byteStride", width * kind.itemsize)
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        # np.ndarray checks that the strided window lies inside the buffer.
        return np.ndarray(
            (accessor["count"], width), kind, self._binary, start, (stride, kind.itemsize)
        )

    def _refusal(self, found: str, remedy: str) -> InputError:
        return InputError(
            f"{self._name}: {found}, so vertices cannot be kept exactly; {remedy}, or export as PLY"
        )


def _local_transform(node: dict) -> FloatArray:
    """Matrix (4, 4) of a node: its own, or translation · rotation · scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    local = np.eye(4)
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    local[:3, :3] = rotation * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    local[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return local


def write_glb(vertices: FloatArray, faces: IntArray) -> bytes:
    """GLB of vertices (V, 3) and faces (F, 3), positions as float32."""
    # The import takes most of a second, and nothing else needs it.
    from trimesh import Trimesh
    from trimesh.exchange.gltf import export_glb

    # process=True would merge coincident vertices and drop those without a face.
    scene = Trimesh(vertices, faces, process=False).scene()
    return bytes(export_glb(scene, include_normals=False))
