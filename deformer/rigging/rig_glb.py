"""A rig as a GLB file: a skinned mesh, its tree of joints, and a clip."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deformer.geometry import FloatArray, IntArray, Mesh
from deformer.io import INDICES, VERTICES, GlbBuilder

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
) -> bytes:
    """The bytes of the file, in the data's own units and axes.

    Args:
        mesh: the reference, V vertices.
        normals: (V, 3) of length 1, or 0 where there is none.
        weights: (V, B) with rows of sum 1.
        names: B names of the bones.
        parents: (B,) index of each bone's parent, −1 for the root.
        rest: (B, 4, 4) rest matrices to the world: translations.
        clip: (N, B, 4, 4) matrices relative to the parents, N may be 0.
        fps: key frames a second; the first is at 0.
    """
    asset = GlbBuilder()
    B = len(names)
    nodes: list[dict[str, Any]] = [{"name": name} for name in names]
    positions = rest[:, :3, 3]
    for b, parent in enumerate(parents):
        start = positions[parent] if parent >= 0 else np.zeros(3)
        nodes[b]["translation"] = _single(positions[b] - start)
        if parent >= 0:
            nodes[parent].setdefault("children", []).append(b)
    for node in nodes:
        asset.add("nodes", node)
    # The joints as the file's single precision places them, so that the bind pose is exact.
    bound = np.zeros((B, 3))
    for b, parent in enumerate(parents):
        bound[b] = nodes[b]["translation"]
        if parent >= 0:
            bound[b] += bound[parent]
    inverse = np.tile(np.eye(4), (B, 1, 1))
    inverse[:, :3, 3] = -bound
    root = int(np.flatnonzero(parents < 0)[0])
    skin = {
        "name": "rig",
        "joints": list(range(B)),
        "skeleton": root,
        "inverseBindMatrices": asset.add_array(inverse),
    }
    asset.add("skins", skin)
    body = {"name": "body", "mesh": _add_mesh(asset, mesh, normals, weights), "skin": 0}
    roots = [asset.add("nodes", body), root]
    asset.add("scenes", {"nodes": roots})
    asset.json["scene"] = 0
    if len(clip):
        _add_clip(asset, clip, fps)
    return asset.data


def _add_mesh(asset: GlbBuilder, mesh: Mesh, normals: FloatArray, weights: FloatArray) -> int:
    # glTF has no vertex without a normal.
    normals = np.where((normals == 0).all(axis=1, keepdims=True), (0.0, 0.0, 1.0), normals)
    attributes = {
        "POSITION": asset.add_array(mesh.vertices, VERTICES),
        "NORMAL": asset.add_array(normals, VERTICES),
    }
    for n, (joints, shares) in enumerate(influence_sets(weights)):
        attributes[f"JOINTS_{n}"] = asset.add_array(joints, VERTICES)
        attributes[f"WEIGHTS_{n}"] = asset.add_array(shares, VERTICES)
    corners = mesh.faces.ravel().astype(np.uint16 if len(mesh.vertices) <= _WIDE else np.uint32)
    primitive = {"attributes": attributes, "indices": asset.add_array(corners, INDICES)}
    return asset.add("meshes", {"name": "body", "primitives": [primitive]})


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


def _add_clip(asset: GlbBuilder, clip: FloatArray, fps: float) -> None:
    N, B = clip.shape[:2]
    times = asset.add_array(np.arange(N) / fps)
    turns = continuous_quaternions(clip[..., :3, :3])
    samplers, channels = [], []
    for b in range(B):
        for path, values in (("rotation", turns[:, b]), ("translation", clip[:, b, :3, 3])):
            channels.append({"sampler": len(samplers), "target": {"node": b, "path": path}})
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
