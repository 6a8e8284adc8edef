"""Exact handles: the Schur complement, and rigid relaxation from a decoded pose."""

from __future__ import annotations

import numpy as np
from numba import njit

from deformer.mesh import FloatArray, IntArray
from deformer.poisson import PoissonSystem
from deformer.rotations import closest_rotation_


@njit(cache=True, nogil=True, error_model="numpy")
def _local_rotations(indptr, rings, c, rest, p, R):
    """R_i closest to Σ_j c_ij (p_i − p_j)(rest_i − rest_j)ᵀ (Sorkine and Alexa 2007)."""
    B = np.empty((3, 3))
    for i in range(len(rest)):
        B[:] = 0.0
        for k in range(indptr[i], indptr[i + 1]):
            j = rings[k]
            for a in range(3):
                e = c[k] * (p[i, a] - p[j, a])
                for b in range(3):
                    B[a, b] += e * (rest[i, b] - rest[j, b])
        closest_rotation_(B, R[i])


@njit(cache=True, nogil=True, error_model="numpy")
def _rotated_rhs(indptr, rings, c, rest, R, b):
    """b_i = Σ_j ½ c_ij (R_i + R_j)(rest_i − rest_j)."""
    for i in range(len(rest)):
        b[i] = 0.0
        for k in range(indptr[i], indptr[i + 1]):
            j = rings[k]
            for a in range(3):
                total = 0.0
                for d in range(3):
                    total += (R[i, a, d] + R[j, a, d]) * (rest[i, d] - rest[j, d])
                b[i, a] += 0.5 * c[k] * total


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


def relax(
    system: PoissonSystem,
    rest: FloatArray,
    green: FloatArray,
    vertices: IntArray,
    targets: FloatArray,
    iterations: int,
) -> FloatArray:
    """As-rigid-as-possible positions (V, 3) that meet the targets exactly.

    The decoded pose is the rest shape, so that the prior decides the pose and rigidity carries
    the handles the last part of the way. Local steps fit one rotation a one-ring, global steps
    are one back-substitution; L is the reference's, so nothing is factored here.

    Args:
        system: factored Laplacian.
        rest: (V, 3) the decoded pose.
        green: Green rows (H, V) of the handles.
        vertices: (H,) different handle vertices.
        targets: (H, 3).
        iterations: local/global rounds; 0 is the Schur complement alone.
    """
    p = meet_exactly(rest, green, vertices, targets)
    R = np.empty((len(rest), 3, 3))
    b = np.empty_like(rest)
    for _ in range(iterations):
        _local_rotations(system.indptr, system.rings, system.c, rest, p, R)
        _rotated_rhs(system.indptr, system.rings, system.c, rest, R, b)
        p = meet_exactly(system.back_substitute(b), green, vertices, targets)
    return p
