"""Linear-blend skinning of glTF: joints, inverse bind matrices, and weights of vertices."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from deformer.geometry import FloatArray
from deformer.io.gltf import FLOAT, INDICES, INTEGERS, GltfAsset
from deformer.io.gltf_nodes import Moving, NodeTree

_JOINT_TYPES = {number: kind for number, kind in INDICES.items() if number != 5125}
_MOST_SETS = 64  # sets of four influences a vertex


class Skin:
    """Joints of one skin, and the vertices of one primitive that they move.

    A vertex p comes to Σ_j w_j G_j B_j p, with G_j the transform of joint j to the world and B_j
    its inverse bind matrix (glTF 2.0, 3.7.3.3); the node that shows the mesh does not matter.
    Weights are divided by their sum; a vertex whose weights are all 0 goes with its first joint.
    """

    def __init__(
        self, asset: GltfAsset, tree: NodeTree, index: Any, attributes: dict, count: int, label: str
    ) -> None:
        """Read the skin and the influences.

        Args:
            asset: the file.
            tree: nodes of its scene.
            index: number of the skin.
            attributes: of the primitive.
            count: vertices of the primitive.
            label: the primitive, for messages.

        Raises:
            InputError: no such skin, a joint outside of the scene, or weights that do not fit.
        """
        skin = asset.item("skins", index, label)
        self._tree, self._count = tree, count
        self.joints = asset.part(skin, "joints", [], f"skin {index}")
        for joint in self.joints:
            if type(joint) is not int or joint not in tree.parents:
                raise asset.broken(f"skin {index} has joint {joint!r}, no node of the scene"[:160])
        if not self.joints:
            raise asset.broken(f"skin {index} has no joints")
        self._inverse_binds = np.tile(np.eye(4), (len(self.joints), 1, 1))
        if "inverseBindMatrices" in skin:
            label_of_skin = f"skin {index}"
            found = asset.floats(skin["inverseBindMatrices"], "MAT4", FLOAT, label_of_skin)
            if len(found) < len(self.joints):
                raise asset.broken(
                    f"{label_of_skin} has {len(found)} inverse bind matrices for "
                    f"{len(self.joints)} joints"
                )
            # Column by column.
            self._inverse_binds = found[: len(self.joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
        self._weights = self._influences(asset, attributes, count, label)

    def _influences(
        self, asset: GltfAsset, attributes: dict, count: int, label: str
    ) -> sparse.csr_array:
        """Weights (V, J), which sum to 1 for every vertex."""
        rows, columns, values = [], [], []
        number = 0
        while f"JOINTS_{number}" in attributes and number < _MOST_SETS:
            joints = asset.array(attributes[f"JOINTS_{number}"], "VEC4", _JOINT_TYPES, label)
            weights = asset.floats(
                attributes.get(f"WEIGHTS_{number}"), "VEC4", FLOAT | INTEGERS, label
            )
            if len(joints) != count or len(weights) != count:
                raise asset.broken(
                    f"{label} has joints of {len(joints)} and weights of {len(weights)} vertices, "
                    f"expected {count}"
                )
            # Exporters leave any number as the joint of an influence of 0.
            joints = np.where(weights == 0, 0, joints.astype(np.int64))
            if joints.max() >= len(self.joints):
                raise asset.broken(f"{label} has joint {joints.max()} of {len(self.joints)}")
            rows.append(np.repeat(np.arange(count), 4))
            columns.append(joints.ravel())
            values.append(weights.ravel())
            number += 1
        if not rows:
            raise asset.broken(f"{label} has no JOINTS_0, and its node has a skin")
        weights = np.stack(values).reshape(number, count, 4)
        if weights.min() < 0:
            raise asset.broken(f"{label} has the weight {weights.min()}, expected 0 or more")
        sums = weights.sum(axis=(0, 2))
        first = asset.array(attributes["JOINTS_0"], "VEC4", _JOINT_TYPES, label)[:, 0]
        lost = np.flatnonzero(sums == 0)
        rows.append(lost)
        columns.append(np.minimum(first[lost].astype(np.int64), len(self.joints) - 1))
        values.append(np.ones(len(lost)))
        found = sparse.csr_array(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
            shape=(count, len(self.joints)),
        )
        return sparse.csr_array(found.multiply(1 / np.where(sums == 0, 1, sums)[:, None]))

    def transforms(self, moving: Moving, frame_count: int) -> FloatArray:
        """Blended transforms (F, V, 3, 4) of the vertices to the world.

        Args:
            moving: local transforms of the nodes that move.
            frame_count: F.
        """
        worlds = self._tree.worlds(self.joints, moving)
        matrices = np.empty((frame_count, len(self.joints), 3, 4))
        for j, world in enumerate(worlds):
            matrices[:, j] = (world @ self._inverse_binds[j])[..., :3, :]
        found = np.empty((frame_count, self._count, 3, 4))
        for f in range(frame_count):
            found[f] = (self._weights @ matrices[f].reshape(-1, 12)).reshape(-1, 3, 4)
        return found
