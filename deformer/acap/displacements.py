"""Where the connected components of a mesh are: features of the links between them.

A component's own features do not say where it is. Link b = (i, j) has a gradient T_b of its own, in
the place of a vertex. It tells how far i is from where the gradients of i and j alone put it:

    p_i − p_j = ½ (T_i + T_j)(v_i − v_j) + (T_b − T_j) a,    a = (α, 0, 0).

T_b has the rotation of T_j, and a stretch S_b that differs from S_j in its first row (and column)
alone, by the displacement in the frame of j over α. Positions are thus linear in all gradients, and
a displacement turns with the component that it is relative to.
"""

from __future__ import annotations

import numpy as np

from deformer.acap.gradients import features_to_gradients
from deformer.geometry import FloatArray, Mesh, log_to_rotation

# α in bounding diagonals: a displacement of α counts as a stretch by 1.
_LEVER = 0.05


def link_lever(mesh: Mesh) -> FloatArray:
    """The vector a (3,) of a mesh, in its units."""
    return np.array([_LEVER * mesh.bounding_diagonal, 0.0, 0.0])


def link_features(reference: Mesh, vertices: FloatArray, q: FloatArray) -> FloatArray:
    """Features (B, 9) of the links of a shape.

    Args:
        reference: the undeformed mesh, with B links.
        vertices: (V, 3) the shape.
        q: (V, 9) features of its vertices.
    """
    i, j = reference.links.T
    v, p = reference.vertices, vertices
    T_i, T_j = (features_to_gradients(q[end]) for end in (i, j))
    expected = (0.5 * (T_i + T_j) @ (v[i] - v[j])[:, :, None])[..., 0]
    R_j = log_to_rotation(q[j, :3])
    out = q[j].copy()
    displacement = ((p[i] - p[j] - expected)[:, None] @ R_j)[:, 0]
    out[:, 3:6] += displacement / link_lever(reference)[0]
    return out


def undisplaced(reference: Mesh, q: FloatArray) -> FloatArray:
    """Features (..., V+B, 9) of vertices q (..., V, 9) and of links without displacement."""
    return np.concatenate([q, q[..., reference.links[:, 1], :]], axis=-2)
