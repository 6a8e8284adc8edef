"""The order of vertices that a shape should have, found from its positions and a sound shape.

A sound shape is deformed step by step towards the positions, as a cloud of points without an
order: vertices that are mutually nearest to a point are drawn there, the others follow as rigidly
as possible. In the end every vertex gets one point, by an assignment of least distance.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.optimize import linear_sum_assignment
from scipy.sparse import linalg
from scipy.spatial import KDTree

from deformer.geometry import FloatArray, IntArray, closest_rotations, procrustes

_STEPS = 10
# Weights of mutually nearest points, against 1 for an edge, over the steps.
_FIRST_PULL, _LAST_PULL = 0.05, 5.0
# Largest number of vertices without a mutually nearest point that are assigned: the time grows with
# the cube of it.
_MOST_UNSURE = 2000
# Of these parts of the edges, a shape put in order may differ from the usual lengths this much more
# than sound shapes do, in logarithms.
_QUANTILES = np.array([0.5, 0.9, 0.995])
_MARGINS = np.array([0.01, 0.03, 0.1])
# No edge may differ by more than the last of these limits plus this.
_NEVER = 1.5
# Vertices at edges that differ by more than _DOUBT times the last limit are assigned again, in at
# most _ROUNDS rounds.
_DOUBT = 0.6
_ROUNDS = 8


def find_order(
    points: FloatArray,
    chosen: IntArray,
    templates: list[FloatArray],
    edges: IntArray,
    usual_lengths: FloatArray,
) -> IntArray | None:
    """Order (V,) of points such that points[order] is a shape like the templates; None if unsure.

    Args:
        points: (V, 3) positions in a wrong order.
        chosen: vertices whose order is in doubt; all others keep theirs.
        templates: sound shapes (V, 3), the likeliest first.
        edges: (E, 2).
        usual_lengths: (E,) of edges, up to a factor.
    """
    V = len(points)
    limits = _MARGINS + np.max(
        [np.quantile(_logs(t, edges, usual_lengths), _QUANTILES) for t in templates], axis=0
    )
    for template in templates:
        order, doubtful = np.arange(V), chosen
        for _ in range(_ROUNDS):
            fixed = np.setdiff1d(np.arange(V), doubtful)
            start = template
            if len(fixed) > 3:
                R, t = procrustes(template[fixed], points[order[fixed]])
                start = template @ R.T + t
            placed = _deformed(start, points[order], fixed, doubtful, edges)
            found = _assigned(placed[doubtful], points[order[doubtful]])
            if found is None:
                break
            order[doubtful] = order[doubtful][found]
            misfits = _logs(points[order], edges, usual_lengths)
            # Next to what is right now, the rest can be told better.
            near = np.isin(edges, np.unique(edges[misfits > _DOUBT * limits[-1]])).any(axis=1)
            doubtful = np.unique(edges[near])
            if (found == np.arange(len(found))).all() or not len(doubtful):
                break
        misfits = _logs(points[order], edges, usual_lengths)
        sound = (np.quantile(misfits, _QUANTILES) <= limits).all()
        if sound and misfits.max() < _NEVER + limits[-1]:
            return order
    return None


def _logs(p: FloatArray, edges: IntArray, usual: FloatArray) -> FloatArray:
    """How far (E,) the logarithms of relative lengths are from their median."""
    lengths = np.linalg.norm(p[edges[:, 0]] - p[edges[:, 1]], axis=1)
    lengths = np.maximum(lengths, 0.01 * max(float(np.median(lengths)), 1e-300))
    logs = np.log(lengths / usual)
    return np.abs(logs - np.median(logs))


def _deformed(
    template: FloatArray, points: FloatArray, fixed: IntArray, chosen: IntArray, edges: IntArray
) -> FloatArray:
    """The template, drawn step by step to `points`; vertices in `fixed` lie on their own.

    Local and global steps of as-rigid-as-possible deformation, with weights 1 for edges.
    """
    V = len(template)
    i, j = edges.T
    incidence = sparse.csr_array(
        (np.tile([1.0, -1.0], len(edges)), (np.repeat(np.arange(len(edges)), 2), edges.ravel())),
        shape=(len(edges), V),
    )
    L = (incidence.T @ incidence).tocsr()
    inner = L[chosen][:, chosen]
    t = template[i] - template[j]
    ends = abs(incidence).T
    cloud = KDTree(points[chosen])
    x = template.copy()
    x[fixed] = points[fixed]
    for pull in np.geomspace(_FIRST_PULL, _LAST_PULL, _STEPS):
        # Rotations that bring the template's one-rings nearest to those of x.
        covariance = ends @ np.einsum("ea,eb->eab", x[i] - x[j], t).reshape(-1, 9)
        R = closest_rotations(covariance.reshape(-1, 3, 3))
        b = incidence.T @ np.einsum("eab,eb->ea", 0.5 * (R[i] + R[j]), t)
        nearest = np.asarray(cloud.query(x[chosen])[1])
        back = np.asarray(KDTree(x[chosen]).query(points[chosen])[1])
        weight = pull * (back[nearest] == np.arange(len(chosen)))
        A = (inner + sparse.diags_array(weight + 1e-6)).tocsc()
        right = (b - L[:, fixed] @ points[fixed])[chosen]
        right += weight[:, None] * points[chosen[nearest]] + 1e-6 * x[chosen]
        factor = linalg.splu(A, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        x[chosen] = factor.solve(right)
    return x


def _assigned(placed: FloatArray, points: FloatArray) -> IntArray | None:
    """A point for each placed vertex, each once; None if too many are not mutually nearest."""
    nearest = np.asarray(KDTree(points).query(placed)[1])
    back = np.asarray(KDTree(placed).query(points)[1])
    rest = np.flatnonzero(back[nearest] != np.arange(len(placed)))
    if len(rest) > _MOST_UNSURE:
        return None
    free = np.setdiff1d(np.arange(len(points)), np.delete(nearest, rest))
    distance = ((placed[rest, None] - points[free]) ** 2).sum(axis=2)
    nearest[rest] = free[linear_sum_assignment(distance)[1]]
    return nearest
