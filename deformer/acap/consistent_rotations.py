"""Continuous logarithms of a field of rotations over a mesh.

The rotation about ω by θ has the logarithms (θ + 2πt) ω for every integer t. This module picks one
of them per vertex so that neighbours agree, after Gao et al., "Sparse Data Driven Mesh
Deformation" (arXiv 1709.01250), without their mixed-integer solver: logarithms grow from the least
rotated vertex along the minimum spanning tree of the rotation differences of edges, and are then
improved locally. A twist of many turns thus becomes a ramp of angles.

No choice of t gives a continuous field everywhere. At a whole number of turns the rotation is the
identity and its axis is undefined: where a twist passes *near* the identity (shear tilts its
rotations a little), exact logarithms jump between opposite points of a sphere of radius 2πt. The
vertices there are `bridged`: they get the harmonic interpolation of their surroundings, a
continuous field that is not the exact logarithm. This happens only beyond one turn; `features`
compensates for it in the stretch, so that reconstruction still gives the shape.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from deformer.compilation import njit
from deformer.geometry import FloatArray, IntArray, log_, rotation_to_log

# Neighbours whose logarithms differ by more than this (radians) are not continuous.
MAX_EDGE_JUMP = 0.5 * math.pi
# Within this angle of a whole turn (radians) vertices are bridged at first.
WHOLE_TURN_RADIUS = 0.5 * math.pi
_TURN = 2.0 * math.pi
# Rotations by less than this (radians) have no axis to turn about.
_UNDEFINED_AXIS = 0.5


# Arguments that the compiled functions share: rotations R (V, 3, 3) and their principal logarithms
# `principal` (V, 3); one-rings (indptr (V + 1,), rings) as `one_rings` returns them; the logarithms
# r (V, 3) and the flags `bridged` (V,) of vertices that interpolate their neighbours, both changed
# in place. Angles are radians.


@njit(nogil=True, error_model="numpy")
def _nearest_log_(principal, target, out):
    """Out = the logarithm of the same rotation as `principal` that is nearest to `target`."""
    theta = math.sqrt(principal[0] ** 2 + principal[1] ** 2 + principal[2] ** 2)
    if theta > 1e-9:
        along = 0.0
        for d in range(3):
            along += target[d] * principal[d]
        scale = (theta + _TURN * np.rint((along / theta - theta) / _TURN)) / theta
        for d in range(3):
            out[d] = scale * principal[d]
        return
    # The logarithms of the identity are spheres of radius 2πt: the axis is that of the target.
    length = math.sqrt(target[0] ** 2 + target[1] ** 2 + target[2] ** 2)
    turns = _TURN * np.rint(length / _TURN)
    for d in range(3):
        out[d] = target[d] * (turns / length) if length > 0.0 else 0.0


@njit(nogil=True, error_model="numpy")
def _distance2_(a, b):
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@njit(nogil=True, error_model="numpy")
def _relative_(Ri, Rj, D, w):
    """Rotation vector w from vertex i to vertex j in the fixed frame: Rj = exp(w) Ri."""
    for a in range(3):
        for b in range(3):
            D[a, b] = Rj[a, 0] * Ri[b, 0] + Rj[a, 1] * Ri[b, 1] + Rj[a, 2] * Ri[b, 2]
    log_(D, w)


@njit(nogil=True, error_model="numpy")
def _largest_jump_(r, indptr, rings):
    worst = 0.0
    for i in range(len(r)):
        for k in range(indptr[i], indptr[i + 1]):
            worst = max(worst, _distance2_(r[i], r[rings[k]]))
    return math.sqrt(worst)


@njit(nogil=True, error_model="numpy")
def _near_whole_turn_(principal, r):
    """True where R is close to the identity but its logarithm is not: the axis is uncertain."""
    return (
        principal[0] ** 2 + principal[1] ** 2 + principal[2] ** 2 < WHOLE_TURN_RADIUS**2
        and r[0] ** 2 + r[1] ** 2 + r[2] ** 2 > math.pi**2
    )


@njit(nogil=True, error_model="numpy")
def _continue_(R, indptr, rings, known, r, i, D, w, guess):
    """Guess = logarithm at i continued from the known neighbours: their mean, rotated further.

    Along the mean's axis the rotation from the neighbours to i is added exactly. Across the axis
    nothing is added, since the logarithm is not continuous there near a whole turn.
    """
    guess[:] = 0.0
    count = 0
    for k in range(indptr[i], indptr[i + 1]):
        j = rings[k]
        if known[j]:
            count += 1
            for d in range(3):
                guess[d] += r[j, d]
    length = math.sqrt(guess[0] ** 2 + guess[1] ** 2 + guess[2] ** 2) / count
    along = 0.0
    if length > MAX_EDGE_JUMP:
        for k in range(indptr[i], indptr[i + 1]):
            j = rings[k]
            if known[j]:
                _relative_(R[j], R[i], D, w)
                for d in range(3):
                    along += guess[d] * w[d] / (length * count * count)
    for d in range(3):
        guess[d] = guess[d] / count * (1.0 + (along / length if length > 0.0 else 0.0))


@njit(nogil=True, error_model="numpy")
def _grow_(R, principal, indptr, rings, roots, r, bridged):
    """Prim's tree over rotation differences; r of a new vertex continues r of its parent."""
    D = np.empty((3, 3))
    w = np.empty(3)
    guess = np.empty(3)
    reached = np.zeros(len(r), dtype=np.bool_)
    for root in roots:
        heap = [(0.0, root)]
        while len(heap) > 0:
            _, j = heapq.heappop(heap)
            if reached[j]:
                continue
            if j == root:
                guess[:] = r[j]
            else:
                _continue_(R, indptr, rings, reached, r, j, D, w, guess)
            reached[j] = True
            # Near a whole turn the rotation continues about the axis of the neighbours.
            bridged[j] = j != root and _near_whole_turn_(principal[j], guess)
            if bridged[j]:
                r[j] = guess
            else:
                _nearest_log_(principal[j], guess, r[j])
            for k in range(indptr[j], indptr[j + 1]):
                n = rings[k]
                if not reached[n]:
                    _relative_(R[j], R[n], D, w)
                    heapq.heappush(heap, (w[0] ** 2 + w[1] ** 2 + w[2] ** 2, n))


@njit(nogil=True, error_model="numpy")
def _ring_mean_(indptr, rings, r, i, mean):
    count = indptr[i + 1] - indptr[i]
    for d in range(3):
        total = 0.0
        for k in range(indptr[i], indptr[i + 1]):
            total += r[rings[k], d]
        mean[d] = total / count


@njit(nogil=True, error_model="numpy")
def _refine_(principal, indptr, rings, bridged, r, sweeps):
    """Coordinate descent on Σ_edges ‖r_i − r_j‖² over the turns of one vertex at a time."""
    mean = np.empty(3)
    best = np.empty(3)
    for _ in range(sweeps):
        changed = 0
        for i in range(len(r)):
            if bridged[i] or indptr[i + 1] == indptr[i]:
                continue
            _ring_mean_(indptr, rings, r, i, mean)
            _nearest_log_(principal[i], mean, best)
            if _distance2_(best, r[i]) > 1e-12:
                changed += 1
                r[i] = best
        if changed == 0:
            break


@njit(nogil=True, error_model="numpy")
def _interpolate_(R, indptr, rings, bridged, r, sweeps):
    """Continue all neighbours at each bridged vertex (symmetric Gauss–Seidel sweeps)."""
    D = np.empty((3, 3))
    w = np.empty(3)
    guess = np.empty(3)
    known = np.ones(len(r), dtype=np.bool_)
    where = np.flatnonzero(bridged)
    for _ in range(sweeps):
        worst = 0.0
        for n in range(2 * len(where)):
            i = where[n] if n < len(where) else where[2 * len(where) - 1 - n]
            _continue_(R, indptr, rings, known, r, i, D, w, guess)
            worst = max(worst, _distance2_(guess, r[i]))
            r[i] = guess
        if worst < 1e-6:
            break


@njit(nogil=True, error_model="numpy")
def _restore_exact_(principal, bridged, r):
    """Give bridged vertices their exact logarithm again if it is close to the interpolation."""
    exact = np.empty(3)
    for i in range(len(r)):
        if bridged[i]:
            _nearest_log_(principal[i], r[i], exact)
            if _distance2_(exact, r[i]) < (0.25 * MAX_EDGE_JUMP) ** 2:
                r[i] = exact
                bridged[i] = False


@njit(nogil=True, error_model="numpy")
def _bridge_jumps_(indptr, rings, bridged, r):
    """Bridge vertices beyond 3/4 turn with a discontinuous edge; true if there were any."""
    found = False
    for i in range(len(r)):
        length2 = r[i, 0] ** 2 + r[i, 1] ** 2 + r[i, 2] ** 2
        if bridged[i] or length2 < (1.5 * math.pi) ** 2:
            continue
        for k in range(indptr[i], indptr[i + 1]):
            if _distance2_(r[i], r[rings[k]]) > MAX_EDGE_JUMP**2:
                bridged[i] = True
                found = True
                break
    return found


def continuous_logs(
    R: FloatArray, indptr: IntArray, rings: IntArray, labels: IntArray
) -> tuple[FloatArray, np.ndarray]:
    """Rotation vectors of R, chosen so that they are continuous over the edges of a mesh.

    A rotation about ω by θ is also one about ω by θ + 2πt, and about −ω by −θ + 2πt (Tan et al.
    2018, rotation angles and axes). A sign o_i and a number of turns t_i are chosen such that

    - Σ_(i,j)∈E o_i o_j s(ω_i · ω_j) is large (Gao et al. 2019, objective 1), s the sign, 0 where
      the axes are nearly perpendicular or one of the angles is small, and
    - Σ_(i,j)∈E ‖(2π t_i + o_i θ_i) − (2π t_j + o_j θ_j)‖² is small (Gao et al. 2019, objective 2).

    Args:
        R: (V, 3, 3) rotations at the vertices.
        indptr: (V+1,) row starts of the one-rings.
        rings: (2E,) neighbours, as `deformer.geometry.one_rings` returns them.
        labels: (V,) connected component of every vertex; each is treated on its own.

    Returns:
        r (V, 3), radians, and bridged (V,) bool, true where r is interpolated and exp(r) ≠ R.
        The least rotated vertex of a component (the first within 0.1 rad), where its logarithms
        start, has its principal logarithm.
    """
    principal = rotation_to_log(R)
    # Most shapes: principal logarithms without a jump are already continuous.
    if _largest_jump_(principal, indptr, rings) < MAX_EDGE_JUMP:
        return principal, np.zeros(len(R), dtype=bool)
    angle = np.linalg.norm(principal, axis=1)
    least = np.full(labels.max() + 1, np.inf)
    np.minimum.at(least, labels, angle)
    near = np.flatnonzero(angle <= least[labels] + 0.1)
    roots = near[np.unique(labels[near], return_index=True)[1]]
    r = np.zeros_like(principal)
    r[roots] = principal[roots]
    bridged = np.zeros(len(R), dtype=bool)
    _grow_(R, principal, indptr, rings, roots, r, bridged)
    _interpolate_(R, indptr, rings, bridged, r, 30)
    _restore_exact_(principal, bridged, r)
    _refine_(principal, indptr, rings, bridged, r, 50)
    for _ in range(20):
        if not _bridge_jumps_(indptr, rings, bridged, r):
            break
        _interpolate_(R, indptr, rings, bridged, r, 30)
    return r, bridged


def join_components(r: FloatArray, links: IntArray, labels: IntArray) -> None:
    """Turn the rotation vectors of components as those of the components that they are linked to.

    A component's rotation vectors change by the whole turns that bring the vector at its link
    nearest to the one at the other end. A component with rotations near the identity, whose axes
    are undefined, stays as it is. A vertex without a face gets the vector at the other end.

    Args:
        r: (V, 3) rotation vectors, continuous over every component; changed in place.
        links: (B, 2), as `Mesh.links`.
        labels: (V,) connected component of every vertex.
    """
    counts = np.bincount(labels)
    for i, j in links.tolist():
        if counts[labels[i]] == 1:
            r[i] = r[j]
            continue
        part = np.flatnonzero(labels == labels[i])
        angles = np.linalg.norm(r[part], axis=1)
        if angles.min() < _UNDEFINED_AXIS:
            continue
        angle = np.linalg.norm(r[i])
        turns = np.rint((r[j] @ r[i] / angle - angle) / _TURN)
        along = np.sign(r[part] @ r[i])
        r[part] *= (1.0 + along * turns * _TURN / angles)[:, None]
