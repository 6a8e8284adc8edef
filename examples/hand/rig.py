"""The skinned hand of a GLB file, subdivided, with a forearm to bend at the wrist.

Source: the profile "generic-hand" of the npm package `@webxr-input-profiles/assets` (MIT). Each of
its joints has a frame as in WebXR: −z along the bone to the tip, y out of the back of the hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import igl
import numpy as np
from decimation import adjacency
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial.transform import Rotation
from skinning import DeltaMush, blend

import deformer
from deformer.io import GltfScene, read_gltf

DIGITS = ("thumb", "index", "middle", "ring", "pinky")
FOREARM = "forearm"
TO_UPRIGHT = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
STRETCH = 2.6  # of what lies behind the wrist, so that there is a forearm to hold
WRIST_BEND = (-0.020, 0.022)  # metres before and behind the wrist over which the skin bends there
# Metres below the wrist from which the end of the forearm is smoothed; over how many; how often.
END, END_RAMP, END_ROUNDS = -0.02, 0.03, 12
MUSH_ROUNDS = 6
_FLOATS = {5126: "<f4"}
_WHOLE = {5121: "u1", 5123: "<u2"}

# Degrees by joint: flexion to the palm, abduction to the thumb's side, twist about the bone.
Angles = dict[str, tuple[float, float, float]]


def joints_of(digit: str) -> tuple[str, ...]:
    """The joints of a digit, from the wrist to the tip, by their names in WebXR."""
    if digit == "thumb":
        return ("thumb-metacarpal", "thumb-phalanx-proximal", "thumb-phalanx-distal", "thumb-tip")
    phalanges = (f"phalanx-{part}" for part in ("proximal", "intermediate", "distal"))
    return tuple(f"{digit}-finger-{part}" for part in ("metacarpal", *phalanges, "tip"))


@dataclass(frozen=True, eq=False)
class Hand:
    """A right hand at rest: metres, z up along the fingers, the palm facing −y, the wrist at 0.

    Args:
        vertices: (V, 3) positions.
        faces: (F, 3) triangles, counter-clockwise seen from outside.
        weights: (V, B) skinning weights; rows sum to 1.
        labels: B joint names; the forearm is the first, and the wrist the second.
        parents: B parent indices, −1 for the forearm.
        heads: (B, 3) joint positions.
        frames: (B, 3, 3) axes of the joints as columns, as in WebXR.
    """

    vertices: NDArray
    faces: NDArray
    weights: NDArray
    labels: list[str]
    parents: list[int]
    heads: NDArray
    frames: NDArray

    @cached_property
    def index(self) -> dict[str, int]:
        """Number of a joint by its name."""
        return {name: number for number, name in enumerate(self.labels)}

    @cached_property
    def _mush(self) -> DeltaMush:
        return DeltaMush(self.vertices, self.faces, MUSH_ROUNDS)

    def bone_transforms(self, angles: Angles) -> tuple[NDArray, NDArray]:
        """Rotations (B, 3, 3) and translations (B, 3) that take rest points to posed points.

        Args:
            angles: by joint; joints that are not named stay as at rest.
        """
        rotations = np.tile(np.eye(3), (len(self.labels), 1, 1))
        positions = self.heads.copy()
        for bone, parent in enumerate(self.parents):
            if parent < 0:
                continue
            flexion, abduction, twist = angles.get(self.labels[bone], (0.0, 0.0, 0.0))
            turn = Rotation.from_euler("XYZ", [-flexion, abduction, twist], degrees=True)
            frame = self.frames[bone]
            rotations[bone] = rotations[parent] @ frame @ turn.as_matrix() @ frame.T
            offset = self.heads[bone] - self.heads[parent]
            positions[bone] = positions[parent] + rotations[parent] @ offset
        return rotations, positions - np.einsum("bij,bj->bi", rotations, self.heads)

    def joint_positions(self, angles: Angles) -> NDArray:
        """Posed positions (B, 3) of the joints."""
        rotations, translations = self.bone_transforms(angles)
        return np.einsum("bij,bj->bi", rotations, self.heads) + translations

    def skin(self, angles: Angles) -> NDArray:
        """Posed vertices (V, 3); the palm stays where it is, and the forearm turns."""
        rotations, translations = self.bone_transforms(angles)
        turn, shift = rotations[1], translations[1]
        moved = blend(self.vertices, self.weights, self.parents, rotations, translations)
        return (self._mush.apply(moved) - shift) @ turn


def load_hand(path: Path) -> Hand:
    """Read the right hand, `right.glb` of the package.

    Args:
        path: the GLB file.

    Raises:
        deformer.InputError: the file is missing, damaged, or not a hand with the joints of WebXR.
    """
    points, faces, weights, binds = _read(path)
    names = [name for digit in DIGITS for name in joints_of(digit)]
    missing = [name for name in ("wrist", *names) if name not in binds]
    if missing:
        raise deformer.InputError(
            f"{path}: no joint {missing[0]!r}, expected the joints of WebXR's hands; "
            "take right.glb of the profile generic-hand"
        )
    # The weights at tips belong to the last bones.
    labels = [FOREARM, "wrist", *names]
    parents = [-1, 0]
    for digit in DIGITS:
        first = len(parents)
        parents += [1, *range(first, first + len(joints_of(digit)) - 1)]
    wrist = binds["wrist"][:3, 3]
    heads = np.stack([binds[name][:3, 3] for name in ("wrist", *labels[1:])])
    heads = (heads - wrist) @ TO_UPRIGHT.T
    frames = np.stack([TO_UPRIGHT @ binds[name][:3, :3] for name in ("wrist", *labels[1:])])
    points = (points - wrist) @ TO_UPRIGHT.T
    columns = np.stack([weights[name] for name in labels[1:]], axis=1)
    # The file's mesh ends 2 cm behind the wrist, which all of its vertices there follow.
    points[:, 2] = np.where(points[:, 2] < 0, STRETCH * points[:, 2], points[:, 2])
    points = _rounded_end(points, faces)
    t = np.clip((WRIST_BEND[1] - points[:, 2]) / (WRIST_BEND[1] - WRIST_BEND[0]), 0, 1)
    fixed = (t * t * (3 - 2 * t))[:, None]
    skin = np.concatenate([points, fixed, (1 - fixed) * columns], axis=1)
    skin, faces = igl.loop(np.ascontiguousarray(skin), faces, 1)
    return Hand(skin[:, :3], faces, skin[:, 3:], labels, parents, heads, frames)


def _rounded_end(points: NDArray, faces: NDArray) -> NDArray:
    """The points (V, 3) with the forearm's slanted, jagged end smoothed."""
    matrix = adjacency(faces, len(points))
    mean = sparse.csr_array(sparse.diags_array(1 / matrix.sum(axis=1)) @ matrix)
    share = np.clip((END - points[:, 2:]) / END_RAMP, 0, 0.5)
    for _ in range(END_ROUNDS):
        points = points + share * (mean @ points - points)
    return points


def _read(path: Path) -> tuple[NDArray, NDArray, dict[str, NDArray], dict[str, NDArray]]:
    """Vertices, triangles, and by joint its weights (V,) and its frame (4, 4), without seams."""
    asset = read_gltf(path)
    scene = GltfScene(asset)
    shown = scene.ranges[0]
    if len(scene.ranges) != 1 or shown.skin is None:
        raise deformer.InputError(
            f"{path}: expected one mesh with a skin; take right.glb of the profile generic-hand"
        )
    skin = asset.json["skins"][shown.skin]
    names = [asset.json["nodes"][joint].get("name", "") for joint in skin["joints"]]
    inverse = asset.floats(skin.get("inverseBindMatrices"), "MAT4", _FLOATS, "the skin")
    binds = np.linalg.inv(inverse.reshape(-1, 4, 4).transpose(0, 2, 1))
    attributes = asset.json["meshes"][shown.mesh]["primitives"][0]["attributes"]
    joints = asset.array(attributes["JOINTS_0"], "VEC4", _WHOLE, "the mesh")
    shares = asset.floats(attributes["WEIGHTS_0"], "VEC4", _FLOATS, "the mesh")
    vertices = asset.floats(attributes["POSITION"], "VEC3", _FLOATS, "the mesh")
    weights = np.zeros((len(vertices), len(names)))
    np.add.at(weights, (np.arange(len(vertices))[:, None], joints), shares)
    weights /= weights.sum(axis=1, keepdims=True)
    # Vertices that the exporter split at seams are one again.
    points, first, number = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    faces = number.reshape(-1)[scene.faces]
    weights = weights[first]
    by_name = dict(zip(names, weights.T, strict=True))
    return points, faces, by_name, dict(zip(names, binds, strict=True))
