"""Continuous logarithms of a field of rotations over a mesh.

The rotation about ω by θ has the logarithms (θ + 2πt) ω for every integer t. This module picks one
of them per vertex so that neighbours agree, after Gao et al., "Sparse Data Driven Mesh
Deformation" (arXiv 1709.01250), without their mixed-integer solver: logarithms grow from the least
rotated vertex along the minimum spanning tree of the rotation differences of edges, and are then
improved locally. A fold of many turns thus comes out as one ramp.

There is one obstacle that no choice of t removes. At a whole number of turns the rotation is the
identity and the axis is lost: where a twist passes *beside* the identity (shear tilts its rotations
by a little), exact logarithms swing between far ends of a sphere of radius 2πt. There the vertices
are marked as `bridged` and take the harmonic interpolation of their surroundings: a continuous
field that is not the exact logarithm. It happens only beyond one turn; `features` compensates for
it in the stretch, so that the shape is still reconstructed.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit

from deformer.mesh import FloatArray, IntArray
from deformer.rotations import log_, rotation_to_log

# Neighbours whose logarithms differ by more than this (radians) are not continuous.
MAX_EDGE_JUMP = 0.5 * math.pi
_TURN = 2.0 * math.pi


@njit(cache=True, nogil=True, error_model="numpy")
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
    # The identity: its logarithms are spheres, any axis will do.
    length = math.sqrt(target[0] ** 2 + target[1] ** 2 + target[2] ** 2)
    turns = _TURN * np.rint(length / _TURN)
    for d in range(3):
        out[d] = target[d] * (turns / length) if length > 0.0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _distance2_(a, b):
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@njit(cache=True, nogil=True, error_model="numpy")
def _relative_(Ri, Rj, D, w):
    """Rotation vector w from vertex i to vertex j in the fixed frame: Rj = exp(w) Ri."""
    for a in range(3):
        for b in range(3):
            D[a, b] = Rj[a, 0] * Ri[b, 0] + Rj[a, 1] * Ri[b, 1] + Rj[a, 2] * Ri[b, 2]
    log_(D, w)


@njit(cache=True, nogil=True, error_model="numpy")
def _largest_jump_(r, indptr, rings):
    worst = 0.0
    for i in range(len(r)):
        for k in range(indptr[i], indptr[i + 1]):
            worst = max(worst, _distance2_(r[i], r[rings[k]]))
    return math.sqrt(worst)


@njit(cache=True, nogil=True, error_model="numpy")
def _grow_(R, principal, indptr, rings, roots, r, reached):
    """Prim's tree over rotation differences; r of a new vertex continues r of its parent."""
    D = np.empty((3, 3))
    w = np.empty(3)
    guess = np.empty(3)
    for root in roots:
        heap = [(0.0, root, root)]
        while len(heap) > 0:
            _, i, j = heapq.heappop(heap)
            if reached[j]:
                continue
            reached[j] = True
            _relative_(R[i], R[j], D, w)
            # Along the axis of i the turn is followed exactly; across it the log cannot be.
            length = math.sqrt(_distance2_(r[i], np.zeros(3)))
            along = 0.0
            if length > MAX_EDGE_JUMP:
                for d in range(3):
                    along += r[i, d] * w[d] / length
            for d in range(3):
                guess[d] = r[i, d] + (along * r[i, d] / length if length > 0.0 else 0.0)
            _nearest_log_(principal[j], guess, r[j])
            if length > MAX_EDGE_JUMP and _distance2_(r[j], guess) > MAX_EDGE_JUMP**2:
                for d in range(3):
                    r[j, d] = guess[d]
            for k in range(indptr[j], indptr[j + 1]):
                n = rings[k]
                if not reached[n]:
                    _relative_(R[j], R[n], D, w)
                    heapq.heappush(heap, (w[0] ** 2 + w[1] ** 2 + w[2] ** 2, j, n))


@njit(cache=True, nogil=True, error_model="numpy")
def _refine_(principal, indptr, rings, r, sweeps):
    """Coordinate descent on Σ_edges ‖r_i − r_j‖² over the turns of one vertex at a time."""
    mean = np.empty(3)
    best = np.empty(3)
    for _ in range(sweeps):
        changed = 0
        for i in range(len(r)):
            count = indptr[i + 1] - indptr[i]
            if count == 0:
                _nearest_log_(principal[i], r[i], r[i])
                continue
            mean[:] = 0.0
            for k in range(indptr[i], indptr[i + 1]):
                for d in range(3):
                    mean[d] += r[rings[k], d] / count
            _nearest_log_(principal[i], mean, best)
            if _distance2_(best, r[i]) > 1e-12:
                changed += 1
                r[i] = best
        if changed == 0:
            break


@njit(cache=True, nogil=True, error_model="numpy")
def _bridge_(principal, indptr, rings, guide, r, bridged):
    """Bridge the vertices where exact logarithms tear, widening until no edge jumps."""
    origin = np.zeros(3)
    for _ in range(200):
        torn = 0
        for i in range(len(r)):
            # Only near a whole turn, not counting zero, does the logarithm itself tear.
            if (
                bridged[i]
                or _distance2_(principal[i], origin) > (0.5 * math.pi) ** 2
                or _distance2_(r[i], origin) < math.pi**2
            ):
                continue
            for k in range(indptr[i], indptr[i + 1]):
                j = rings[k]
                if _distance2_(r[i], r[j]) > MAX_EDGE_JUMP**2:
                    # Of the two ends the one nearer to a whole turn has the less certain axis.
                    if not bridged[j] and _distance2_(principal[j], origin) < _distance2_(
                        principal[i], origin
                    ):
                        continue
                    bridged[i] = True
                    r[i] = guide[i]
                    torn += 1
                    break
        if torn == 0:
            return
        for _ in range(60):  # Gauss–Seidel for the harmonic interpolation
            for i in range(len(r)):
                if bridged[i]:
                    count = indptr[i + 1] - indptr[i]
                    for d in range(3):
                        total = 0.0
                        for k in range(indptr[i], indptr[i + 1]):
                            total += r[rings[k], d]
                        r[i, d] = total / count


def continuous_logs(
    R: FloatArray, indptr: IntArray, rings: IntArray, labels: IntArray
) -> tuple[FloatArray, np.ndarray]:
    """Rotation vectors of R, chosen so that they are continuous over the edges of a mesh.

    Args:
        R: (V, 3, 3) rotations at the vertices.
        indptr: (V+1,) row starts of the one-rings.
        rings: (2E,) neighbours, as `mesh.one_rings` gives them.
        labels: (V,) connected component of every vertex; each is treated on its own.

    Returns:
        r (V, 3), radians, and bridged (V,), true where r is interpolated and exp(r) ≠ R.
        The root of a component is its least rotated vertex (the first within 0.1 rad); it keeps
        its principal logarithm.
    """
    principal = rotation_to_log(R)
    unbridged = np.zeros(len(R), dtype=bool)
    # Principal logarithms without a jump are already the answer (most shapes): no tree needed.
    if _largest_jump_(principal, indptr, rings) < MAX_EDGE_JUMP:
        return principal, unbridged
    angle = np.linalg.norm(principal, axis=1)
    least = np.full(labels.max() + 1, np.inf)
    np.minimum.at(least, labels, angle)
    near = np.flatnonzero(angle <= least[labels] + 0.1)
    roots = near[np.unique(labels[near], return_index=True)[1]]
    r = np.zeros_like(principal)
    r[roots] = principal[roots]
    _grow_(R, principal, indptr, rings, roots, r, np.zeros(len(R), dtype=bool))
    guide = r.copy()
    _refine_(principal, indptr, rings, r, 50)
    bridged = unbridged
    _bridge_(principal, indptr, rings, guide, r, bridged)
    return r, bridged
