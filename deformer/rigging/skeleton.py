"""The skeleton of bones: a tree of joints about which neighbouring bones turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from deformer.geometry import FloatArray, IntArray

# Weight of the shared region's centre, in shares of what the motions say about the joint.
_CENTRE = 0.01
# Gaps of joints, in units of the rest shape's size, below which they are alike.
_GAP = 1e-3
# Cost of a connection between bones that share no vertex, in those of all others.
_APART = 1e6


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A tree of B bones; a parent comes before its children.

    Args:
        order: (B,) the bones in the order of the tree.
        parents: (B,) position in `order` of each one's parent, −1 for the root.
        joints: (B, 3) where each bone is joined to its parent on the rest shape; the root's is the
            centre of its vertices.
        gaps: (B,) root mean square distance over the shapes between the joint as the bone and as
            its parent move it; 0 for the root.
    """

    order: IntArray
    parents: IntArray
    joints: FloatArray
    gaps: FloatArray


def skeleton_of(weights: FloatArray, rest: FloatArray, T: FloatArray) -> Skeleton:
    """The tree of joints that fits the bones' motions.

    After Le and Deng, "Robust and Accurate Skeletal Rigging from Mesh Sequences", SIGGRAPH 2014. A
    joint of two bones is the point x that both move alike: it minimises Σ_n ‖(T_a − T_b) x̃‖², with
    a small weight for the centre of the vertices that both move, which decides along the axis of a
    hinge. The tree is the minimum spanning tree over the gaps that remain, where bones that share
    much of their weight are near. The root is the bone from which the others are fewest steps
    away, weighted by the number of vertices that they move. Unlike in that paper bones keep the
    motions they have: they may come apart at a joint by its gap.

    Args:
        weights: (V, B).
        rest: (V, 3) of size 1.
        T: (N, B, 3, 4).
    """
    B = weights.shape[1]
    mass = weights.sum(axis=0)
    centres = (weights.T @ rest) / mass[:, None]
    shared = weights.T @ weights
    joints, gaps, cost = (
        np.zeros((B, B, 3)), np.zeros((B, B)), np.zeros((B, B)),
    )  # fmt: skip
    for a in range(B):
        for b in range(a + 1, B):
            both = weights[:, a] * weights[:, b]
            overlap = float(shared[a, b])
            middle = 0.5 * (centres[a] + centres[b])
            if overlap > 0:
                middle = both @ rest / overlap
            x, gap = _joint(T[:, a] - T[:, b], middle)
            joints[a, b] = joints[b, a] = x
            gaps[a, b] = gaps[b, a] = gap
            if overlap > 0:
                near = np.sqrt(overlap / min(shared[a, a], shared[b, b]))
                cost[a, b] = (gap + _GAP) / near
            else:
                distance = np.linalg.norm(centres[a] - centres[b])
                cost[a, b] = _APART * (1.0 + float(distance))
    tree = csgraph.minimum_spanning_tree(sparse.csr_array(cost))
    steps = csgraph.shortest_path(tree, directed=False, unweighted=True)
    root = int((steps @ mass).argmin())
    order, before = csgraph.breadth_first_order(tree, root, directed=False)
    position = np.empty(B, dtype=np.int64)
    position[order] = np.arange(B)
    parents = np.array([-1, *(position[before[b]] for b in order[1:])], dtype=np.int64)
    found, apart = centres[order], np.zeros(B)
    for n in range(1, B):
        found[n] = joints[order[n], before[order[n]]]
        apart[n] = gaps[order[n], before[order[n]]]
    return Skeleton(order.astype(np.int64), parents, found, apart)


def _joint(difference: FloatArray, middle: FloatArray) -> tuple[FloatArray, float]:
    """The joint (3,) of two bones whose transforms differ so (N, 3, 4), and its gap."""
    # Relative to the middle: difference (x, 1) = A (x − middle) + b.
    A = difference[:, :, :3]
    b = A @ middle + difference[:, :, 3]
    H = np.einsum("nij,nik->jk", A, A)
    ridge = max(_CENTRE * float(np.trace(H)) / 3.0, np.finfo(float).tiny)
    away = np.linalg.solve(H + ridge * np.eye(3), -np.einsum("nij,ni->j", A, b))
    gap = np.sqrt(((A @ away + b) ** 2).sum(axis=1).mean())
    return middle + away, float(gap)
