"""Morph targets and animations of their weights in GLB files."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from deformer.documents import Document, posed_glb, single_precision
from deformer.geometry import FloatArray, IntArray
from deformer.io import VERTICES, GlbBuilder, GltfAsset, GltfScene, VertexRange, clip_extras


@dataclass(frozen=True, eq=False)
class Clip:
    """An animation of the weights of morph targets, linear from key to key.

    Args:
        name: its name.
        times: (F,) times of the keys in seconds, growing from 0 or more.
        weights: (F, T).
        fps: frames a second, if the keys are the shapes of the file and the targets are none by
            themselves; None if the targets are the shapes.
    """

    name: str
    times: FloatArray
    weights: FloatArray
    fps: float | None = None


def morph_glb(
    base: FloatArray,
    faces: IntArray,
    targets: np.ndarray,
    names: Sequence[str],
    clips: Sequence[Clip],
    document: Document | None = None,
    name: str = "mesh",
) -> bytes:
    """A GLB file with morph targets, also called shape keys, and clips that play them.

    Nodes, materials, texture coordinates, colours and names are those of the document. It has
    normals of the base where the document has some, and none of the targets. Meshes of the document
    that no target moves get none.

    Args:
        base: (V, 3) positions without any target.
        faces: (F, 3) triangles, for a file without a document.
        targets: (T, V, 3) displacements from the base.
        names: T names of the targets.
        clips: the animations.
        document: a document of V vertices, or None for positions and triangles alone.
        name: name of the mesh, where there is no document.

    Raises:
        InputError: a position too large for single precision.
    """
    data, owners = posed_glb(document, base, faces)
    scene = GltfScene(GltfAsset(data, "the document"))
    asset = GlbBuilder.of(copy.deepcopy(scene.asset.json), scene.asset.buffer(0, "the file"))
    if document is None:
        for family in ("nodes", "meshes"):
            asset.json[family][0]["name"] = name
    moved = {part.node for part in scene.ranges
             if targets[:, owners[_rows(part)]].any()}  # fmt: skip
    for part in scene.ranges:
        if part.node in moved:
            _add_targets(asset, part, targets[:, owners[_rows(part)]])
    for node in sorted(moved):
        mesh = asset.json["meshes"][asset.json["nodes"][node]["mesh"]]
        mesh["weights"] = [0.0] * len(names)
        extras = mesh.get("extras")
        mesh["extras"] = {**(extras if isinstance(extras, dict) else {}), "targetNames": [*names]}
    # Before those of the document that are left: programs play the first one.
    others = asset.json.pop("animations", [])
    for clip in clips if moved else ():
        _add_clip(asset, clip, sorted(moved))
    for animation in others:
        asset.add("animations", animation)
    return asset.data


def _rows(part: VertexRange) -> slice:
    return slice(part.start, part.start + part.count)


def _add_targets(asset: GlbBuilder, part: VertexRange, targets: np.ndarray) -> None:
    """Add targets (T, n, 3), displacements in the world, to the primitives of a range."""
    linear = part.transform[:3, :3]
    mesh = asset.json["meshes"][part.mesh]
    for target in targets:
        local = target.astype(np.float64)
        if not np.array_equal(linear, np.eye(3)):
            local = np.linalg.solve(linear, local.T).T
        accessor = asset.add_array(single_precision(local, "GLB"), VERTICES)
        for number in part.primitives:
            primitive = mesh["primitives"][number]
            primitive.setdefault("targets", []).append({"POSITION": accessor})


def _add_clip(asset: GlbBuilder, clip: Clip, nodes: list[int]) -> None:
    sampler = {
        "input": asset.add_array(clip.times),
        "output": asset.add_array(clip.weights.ravel()),
        "interpolation": "LINEAR",
    }
    channels: list[dict[str, Any]] = [
        {"sampler": 0, "target": {"node": node, "path": "weights"}} for node in nodes
    ]
    found = {"name": clip.name, "samplers": [sampler], "channels": channels}
    if clip.fps is not None:
        found["extras"] = clip_extras(clip.fps)
    asset.add("animations", found)
