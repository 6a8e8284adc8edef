"""Exact handles: the Schur complement, and rigid relaxation from a decoded pose."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from deformer.mesh import FloatArray, IntArray
from deformer.parallel import over_ranges
from deformer.poisson import PoissonSystem
from deformer.rotations import exp_

# Fixed-point steps of the local rotation fits: the first round of a cold start, every later one.
_FIRST_STEPS = 8
_STEPS = 2


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _local(start, stop, indptr, rings, c, rest, p, R, steps):
    """R_i towards the rotation closest to A_i = Σ_j c_ij (p_i − p_j) g_ijᵀ, from where it was.

    g_ij = rest_i − rest_j. The fixed-point iteration of Müller et al. (A Robust Method to Extract
    the Rotational Part of Deformations, 2016) needs no decomposition and holds for flat rings,
    whose A is singular.
    """
    A = np.empty((3, 3))
    w = np.empty(3)
    D = np.empty((3, 3))
    new = np.empty((3, 3))
    for i in range(start, stop):
        A[:] = 0.0
        for k in range(indptr[i], indptr[i + 1]):
            j = rings[k]
            gx = c[k] * (rest[i, 0] - rest[j, 0])
            gy = c[k] * (rest[i, 1] - rest[j, 1])
            gz = c[k] * (rest[i, 2] - rest[j, 2])
            for a in range(3):
                e = p[i, a] - p[j, a]
                A[a, 0] += e * gx
                A[a, 1] += e * gy
                A[a, 2] += e * gz
        Ri = R[i]
        for _ in range(steps):
            trace = 0.0
            w[:] = 0.0
            for b in range(3):
                trace += Ri[0, b] * A[0, b] + Ri[1, b] * A[1, b] + Ri[2, b] * A[2, b]
                w[0] += Ri[1, b] * A[2, b] - Ri[2, b] * A[1, b]
                w[1] += Ri[2, b] * A[0, b] - Ri[0, b] * A[2, b]
                w[2] += Ri[0, b] * A[1, b] - Ri[1, b] * A[0, b]
            length = math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
            # A near-zero trace (a ring turned by 90° or collapsed) must not spin wildly.
            turn = max(abs(trace), length)
            if not length > 1e-12 * turn:
                break
            for a in range(3):
                w[a] /= turn
            exp_(w, D)
            for a in range(3):
                for b in range(3):
                    new[a, b] = D[a, 0] * Ri[0, b] + D[a, 1] * Ri[1, b] + D[a, 2] * Ri[2, b]
            for a in range(3):
                for b in range(3):
                    Ri[a, b] = new[a, b]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _rotated_rhs(start, stop, indptr, rings, c, rest, R, b, out):
    """Out_i = b_i + Σ_j c_ij (½ (R_i + R_j) − I) (rest_i − rest_j).

    Where L rest = b this is the sum of the rotated edges alone.
    """
    for i in range(start, stop):
        bx = by = bz = 0.0
        for k in range(indptr[i], indptr[i + 1]):
            j = rings[k]
            x = 0.5 * c[k] * (rest[i, 0] - rest[j, 0])
            y = 0.5 * c[k] * (rest[i, 1] - rest[j, 1])
            z = 0.5 * c[k] * (rest[i, 2] - rest[j, 2])
            bx += (R[i, 0, 0] + R[j, 0, 0] - 2.0) * x + (R[i, 0, 1] + R[j, 0, 1]) * y
            bx += (R[i, 0, 2] + R[j, 0, 2]) * z
            by += (R[i, 1, 0] + R[j, 1, 0]) * x + (R[i, 1, 1] + R[j, 1, 1] - 2.0) * y
            by += (R[i, 1, 2] + R[j, 1, 2]) * z
            bz += (R[i, 2, 0] + R[j, 2, 0]) * x + (R[i, 2, 1] + R[j, 2, 1]) * y
            bz += (R[i, 2, 2] + R[j, 2, 2] - 2.0) * z
        out[i, 0] = b[i, 0] + bx
        out[i, 1] = b[i, 1] + by
        out[i, 2] = b[i, 2] + bz


def meet_exactly(
    p: FloatArray, green: FloatArray, vertices: IntArray, targets: FloatArray
) -> FloatArray:
    """Smallest change (in the Laplacian's energy) of p (V, 3) that meets the targets (H, 3).

    p + Gᵀμ + t with [G_hh 1; 1ᵀ 0] [μ; t] = [q − p_h; 0]: the Schur complement of the constrained
    Poisson system, H×H, with the free translation t.

    Args:
        p: free solution.
        green: Green rows (H, V) of the handles, `PoissonSystem.green_rows`.
        vertices: (H,) different handle vertices.
        targets: (H, 3).
    """
    H = len(vertices)
    system = np.ones((H + 1, H + 1))
    system[:H, :H] = green[:, vertices]
    system[H, H] = 0.0
    misfit = np.vstack([targets - p[vertices], np.zeros((1, 3))])
    solution = np.linalg.lstsq(system, misfit, rcond=1e-13)[0]
    moved = p + green.T @ solution[:H] + solution[H]
    # What rounding leaves is set, so that exact means exact.
    moved[vertices] = targets
    return moved


class Relaxation:
    """As-rigid-as-possible positions that meet targets exactly (Sorkine and Alexa 2007).

    The decoded pose is the rest shape: the prior decides the pose, and rotations R_i of its
    one-rings carry the handles the last part of the way. Minimises
    Σ c_ij ‖(p_i − p_j) − R_i (rest_i − rest_j)‖² by global steps (a back-substitution; L is the
    reference's, so nothing is factored) and local steps (rotations). The rotations are kept from
    call to call, so that a drag goes on where it was.

    Args:
        system: the factored Laplacian.
    """

    def __init__(self, system: PoissonSystem) -> None:
        """Start without rotations."""
        self._system = system
        self._R: FloatArray | None = None

    def reset(self) -> None:
        """Forget the rotations: the next call starts from the decoded pose."""
        self._R = None

    def solve(
        self,
        b: FloatArray,
        green: FloatArray,
        vertices: IntArray,
        targets: FloatArray,
        rounds: int,
    ) -> FloatArray:
        """Positions (V, 3), up to rounding with the targets met.

        Args:
            b: (V, 3) right-hand side of the decoded pose, `PoissonSystem.rhs`.
            green: Green rows (H, V) of the handles.
            vertices: (H,) different handle vertices.
            targets: (H, 3).
            rounds: of a local and a global step. 0 is the Schur complement alone in a first call.
                A call that goes on from another takes the global step first, with the rotations
                of the call before, and leaves the local step's for the next.
        """
        if self._R is None:
            return self._begin(b, green, vertices, targets, rounds)
        p = rest = self._system.back_substitute(b)
        for _ in range(max(rounds, 1)):
            p = meet_exactly(self._global(b, rest), green, vertices, targets)
            if rounds:
                self._turn(rest, p, 1)
        return p

    def _begin(
        self,
        b: FloatArray,
        green: FloatArray,
        vertices: IntArray,
        targets: FloatArray,
        rounds: int,
    ) -> FloatArray:
        """A first call."""
        self._R = np.tile(np.eye(3), (len(b), 1, 1))
        rest = self._system.back_substitute(b)
        p = meet_exactly(rest, green, vertices, targets)
        for n in range(rounds):
            self._turn(rest, p, _STEPS if n else _FIRST_STEPS)
            p = meet_exactly(self._global(b, rest), green, vertices, targets)
        return p

    def _turn(self, rest: FloatArray, p: FloatArray, steps: int) -> None:
        """Local step: the rotations from the rest shape to p."""
        mesh = self._system.indptr, self._system.rings, self._system.c
        over_ranges(_local, len(rest), *mesh, rest, p, self._R, steps)

    def _global(self, b: FloatArray, rest: FloatArray) -> FloatArray:
        """Global step: positions (V, 3) whose edges are closest to the turned ones."""
        turned = np.empty_like(b)
        mesh = self._system.indptr, self._system.rings, self._system.c
        over_ranges(_rotated_rhs, len(b), *mesh, rest, self._R, b, turned)
        return self._system.back_substitute(turned)
