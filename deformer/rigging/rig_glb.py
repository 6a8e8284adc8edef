"""A rig as a GLB file: a skinned mesh, its tree of joints, and a clip."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deformer.documents import Document, rooted_glb
from deformer.geometry import FloatArray, IntArray, Mesh
from deformer.io import INDICES, VERTICES, GlbBuilder, GltfAsset, GltfScene, VertexRange

# Index of a vertex that two bytes cannot hold: glTF leaves the last value out.
_WIDE = 65535
_SET = 4  # bones in one set of joints and weights


def rig_glb(
    mesh: Mesh,
    normals: FloatArray,
    weights: FloatArray,
    names: tuple[str, ...],
    parents: IntArray,
    rest: FloatArray,
    clip: FloatArray,
    fps: float,
    document: Document | None = None,
) -> bytes:
    """The bytes of the file, in the data's own units and axes.

    Args:
        mesh: the reference, V vertices.
        normals: (V, 3) of length 1, or 0 where there is none; for primitives without any, unless
            the document is a GLB file, where that means flat shading.
        weights: (V, B) with rows of sum 1.
        names: B names of the bones.
        parents: (B,) index of each bone's parent, −1 for the root.
        rest: (B, 4, 4) rest matrices to the world: translations.
        clip: (N, B, 4, 4) matrices relative to the parents, N may be 0.
        fps: key frames a second; the first is at 0.
        document: of the mesh, what the file has beside positions and triangles.

    Raises:
        InputError: as of `Document.write`.
    """
    # glTF has no vertex without a normal.
    normals = np.where((normals == 0).all(axis=1, keepdims=True), (0.0, 0.0, 1.0), normals)
    if document is None:
        data, owners = _bare_glb(mesh, normals), np.arange(len(mesh.vertices))
    else:
        data, owners = rooted_glb(document, mesh.vertices)
    scene = GltfScene(GltfAsset(data, "the document"))
    asset = GlbBuilder.of(copy.deepcopy(scene.asset.json), scene.asset.buffer(0, "the file"))
    joints = _add_joints(asset, names, parents, rest[:, :3, 3])
    skin = len(asset.json["skins"]) - 1
    sets = influence_sets(weights)
    shading = normals if document is None or document.suffix != ".glb" else None
    for part in scene.ranges:
        _bind(asset, part, owners[part.start : part.start + part.count], sets, shading)
        asset.json["nodes"][part.node]["skin"] = skin
    skinned = {part.node for part in scene.ranges}
    root = joints[int(np.flatnonzero(parents < 0)[0])]
    for shown in asset.json.get("scenes", []):
        if not skinned.isdisjoint(shown.get("nodes", [])):
            shown["nodes"].append(root)
    if len(clip):
        # Before those of the document: programs play the first one.
        others = asset.json.pop("animations", [])
        _add_clip(asset, clip, joints, fps)
        asset.json["animations"] += others
    return asset.data


def _bare_glb(mesh: Mesh, normals: FloatArray) -> bytes:
    """A file of positions, normals and triangles."""
    asset = GlbBuilder()
    attributes = {
        "POSITION": asset.add_array(mesh.vertices, VERTICES),
        "NORMAL": asset.add_array(normals, VERTICES),
    }
    corners = mesh.faces.ravel().astype(np.uint16 if len(mesh.vertices) <= _WIDE else np.uint32)
    primitive = {"attributes": attributes, "indices": asset.add_array(corners, INDICES)}
    body = asset.add("meshes", {"name": "body", "primitives": [primitive]})
    node = asset.add("nodes", {"name": "body", "mesh": body})
    asset.json["scene"] = asset.add("scenes", {"nodes": [node]})
    return asset.data


def _add_joints(
    asset: GlbBuilder, names: tuple[str, ...], parents: IntArray, positions: FloatArray
) -> list[int]:
    """Add a skin and its joints at positions (B, 3) of the world; the joints' nodes."""
    B = len(names)
    first = len(asset.json["nodes"])
    nodes: list[dict[str, Any]] = [{"name": name} for name in names]
    # The joints as the file's single precision places them, so that the bind pose is exact.
    bound = np.zeros((B, 3))
    for b, parent in enumerate(parents):
        start = positions[parent] if parent >= 0 else np.zeros(3)
        bound[b] = nodes[b]["translation"] = _single(positions[b] - start)
        if parent >= 0:
            nodes[parent].setdefault("children", []).append(first + b)
            bound[b] += bound[parent]
    joints = [asset.add("nodes", node) for node in nodes]
    inverse = np.tile(np.eye(4), (B, 1, 1))
    inverse[:, :3, 3] = -bound
    skin = {
        "name": "rig",
        "joints": joints,
        "skeleton": joints[int(np.flatnonzero(parents < 0)[0])],
        "inverseBindMatrices": asset.add_array(inverse),
    }
    asset.add("skins", skin)
    return joints


def _bind(
    asset: GlbBuilder,
    part: VertexRange,
    owners: IntArray,
    sets: list[tuple[NDArray, NDArray[np.float32]]],
    normals: FloatArray | None,
) -> None:
    """Give the primitives of a range joints and weights, and normals where they have none.

    Args:
        asset: the file.
        part: the range, of n vertices.
        owners: (n,) the vertices whose weights and normals they have.
        sets: joints and weights (V, 4).
        normals: (V, 3), or None for no normals.
    """
    added: dict[str, int] = {}
    for n, (joints, shares) in enumerate(sets):
        added[f"JOINTS_{n}"] = asset.add_array(joints[owners], VERTICES)
        added[f"WEIGHTS_{n}"] = asset.add_array(shares[owners], VERTICES)
    primitives = asset.json["meshes"][part.mesh]["primitives"]
    if normals is not None and "NORMAL" not in primitives[part.primitives[0]]["attributes"]:
        added["NORMAL"] = asset.add_array(normals[owners], VERTICES)
    for number in part.primitives:
        primitives[number]["attributes"].update(added)


def influence_sets(weights: FloatArray) -> list[tuple[NDArray, NDArray[np.float32]]]:
    """Joints (V, 4) and weights (V, 4) of each set, the heaviest bones first.

    In single precision, the weights of a vertex have the sum 1 as exactly as that allows. Unused
    places have the joint 0 and the weight 0.
    """
    used = int((weights > 0).sum(axis=1).max())
    width = -(-used // _SET) * _SET
    order = np.argsort(-weights, axis=1, kind="stable")[:, :width]
    shares = np.zeros((len(weights), width), np.float32)
    shares[:, : order.shape[1]] = np.take_along_axis(weights, order, axis=1)
    joints = np.zeros((len(weights), width), np.uint8 if weights.shape[1] <= 256 else np.uint16)
    joints[:, : order.shape[1]] = order
    joints[shares == 0] = 0
    shares[:, 0] = 1.0 - shares[:, 1:].sum(axis=1, dtype=np.float64)
    return [
        (joints[:, n : n + _SET].copy(), shares[:, n : n + _SET].copy())
        for n in range(0, width, _SET)
    ]


def _add_clip(asset: GlbBuilder, clip: FloatArray, joints: list[int], fps: float) -> None:
    times = asset.add_array(np.arange(len(clip)) / fps)
    turns = continuous_quaternions(clip[..., :3, :3])
    samplers, channels = [], []
    for b, joint in enumerate(joints):
        for path, values in (("rotation", turns[:, b]), ("translation", clip[:, b, :3, 3])):
            channels.append({"sampler": len(samplers), "target": {"node": joint, "path": path}})
            samplers.append({"input": times, "output": asset.add_array(values)})
    asset.add("animations", {"name": "examples", "channels": channels, "samplers": samplers})


def continuous_quaternions(R: FloatArray) -> FloatArray:
    """Unit quaternions (N, ..., 4), x y z w, of rotations (N, ..., 3, 3) in order of time.

    Of the two quaternions of a rotation the one on the side of the frame before: from key to key
    programs then turn the shorter way.
    """
    q = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat().reshape(*R.shape[:-2], 4)
    for n in range(1, len(q)):
        q[n] *= np.where((q[n] * q[n - 1]).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    return q


def _single(values: FloatArray) -> list[float]:
    return values.astype(np.float32).astype(np.float64).tolist()
