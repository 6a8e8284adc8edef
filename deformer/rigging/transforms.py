"""Rigid transforms of bones whose skinned points are closest to given shapes.

Shapes are (V, N, 3) here, so that all positions of one vertex lie side by side, and transforms
T = [R | t] are (N, B, 3, 4). A point of the rest shape is ṽ = (v, 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from deformer.compilation import njit
from deformer.geometry import FloatArray, closest_rotation_, closest_rotations

# Share ρ of the energy that pulls each bone by itself towards the vertices that it moves.
PULL = 0.005
# The rotation of points on a line is not determined: it stays near the previous one.
_INERTIA = 1e-6
# Entries of T, in units of the rest shape's size, change by less than this at the end.
_TOLERANCE = 1e-7


@dataclass(frozen=True, eq=False)
class Moments:
    """All that the transforms depend on, for weights w (V, B) and shapes p of N poses.

    Args:
        first: (B, 4, 4) Σ_i w_ib ṽ_i ṽ_iᵀ.
        second: (B, B, 4, 4) Σ_i w_ib w_ic ṽ_i ṽ_iᵀ.
        cross: (N, B, 3, 4) Σ_i w_ib p_i ṽ_iᵀ.
    """

    first: FloatArray
    second: FloatArray
    cross: FloatArray


def moments(weights: FloatArray, rest: FloatArray, shapes: FloatArray) -> Moments:
    """Moments of weights (V, B), rest shape (V, 3) and shapes (V, N, 3)."""
    V, B = weights.shape
    N = shapes.shape[1]
    homogeneous = np.column_stack([rest, np.ones(V)])
    vertex, bone = np.nonzero(weights)
    w = weights[vertex, bone]
    # Row i of X has w_ib ṽ_i at the columns 4b … 4b + 3.
    columns = (4 * bone[:, None] + np.arange(4)).ravel()
    starts = np.append(0, np.cumsum(4 * np.bincount(vertex, minlength=V)))
    X = sparse.csr_array(
        ((w[:, None] * homogeneous[vertex]).ravel(), columns, starts), shape=(V, 4 * B)
    )
    second = (X.T @ X).toarray().reshape(B, 4, B, 4).transpose(0, 2, 1, 3)
    cross = (X.T @ shapes.reshape(V, 3 * N)).reshape(B, 4, N, 3).transpose(2, 0, 3, 1)
    products = (homogeneous[:, :, None] * homogeneous[:, None]).reshape(V, 16)
    first = (sparse.csr_array(weights).T @ products).reshape(B, 4, 4)
    return Moments(first, np.ascontiguousarray(second), np.ascontiguousarray(cross))


def separate_transforms(known: Moments) -> FloatArray:
    """Transforms (N, B, 3, 4) of each bone by itself: minimise Σ_i w_ib ‖T_b ṽ_i − p_i‖²."""
    mass = known.first[:, 3, 3]
    centre = known.first[:, :3, 3] / mass[:, None]
    moved = known.cross[..., 3] / mass[:, None]
    H = known.cross[..., :3] - moved[..., None] * known.first[:, None, 3, :3]
    R = closest_rotations(H)
    t = moved - (R @ centre[..., None])[..., 0]
    return np.concatenate([R, t[..., None]], axis=-1)


def fitted_transforms(
    known: Moments, start: FloatArray | None = None, sweeps: int = 500
) -> FloatArray:
    """Transforms (N, B, 3, 4) of all bones together.

    They minimise Σ_i ‖Σ_b w_ib T_b ṽ_i − p_i‖² + ρ Σ_i Σ_b w_ib ‖T_b ṽ_i − p_i‖², one bone after
    the other by weighted Procrustes on what the others leave (Le and Deng 2012). The second sum,
    with ρ = PULL, keeps bones that share their vertices from working against each other; both
    vanish where all move rigidly.

    Args:
        known: moments of weights and shapes.
        start: transforms to begin with; None is each bone by itself.
        sweeps: most passes over the bones; fewer if the transforms no longer change.
    """
    T = separate_transforms(known) if start is None else np.array(start)
    _sweep(known.first, known.second, known.cross, PULL, sweeps, T)
    return T


@njit(nogil=True, error_model="numpy")
def _sweep(first, second, cross, pull, sweeps, T):
    """Passes over the bones, shape by shape, until T no longer changes."""
    N, B = len(T), len(first)
    left = np.empty((3, 4))
    own = np.empty((4, 4))
    H = np.empty((3, 3))
    R = np.empty((3, 3))
    for n in range(N):
        for _ in range(sweeps):
            largest = 0.0
            for b in range(B):
                for x in range(3):
                    for y in range(4):
                        left[x, y] = (1.0 + pull) * cross[n, b, x, y]
                for c in range(B):
                    if c == b or second[c, b, 3, 3] == 0.0:
                        continue
                    for x in range(3):
                        for y in range(4):
                            total = 0.0
                            for z in range(4):
                                total += T[n, c, x, z] * second[c, b, z, y]
                            left[x, y] -= total
                for x in range(4):
                    for y in range(4):
                        own[x, y] = second[b, b, x, y] + pull * first[b, x, y]
                mass = own[3, 3]
                spread = 0.0
                for x in range(3):
                    spread += own[x, x] - own[x, 3] * own[x, 3] / mass
                spread = _INERTIA * max(spread, 1e-9 * mass)
                for x in range(3):
                    for y in range(3):
                        H[x, y] = left[x, y] - left[x, 3] * own[y, 3] / mass
                        H[x, y] += spread * T[n, b, x, y]
                closest_rotation_(H, R)
                for x in range(3):
                    t = left[x, 3]
                    for y in range(3):
                        t -= R[x, y] * own[y, 3]
                        largest = max(largest, abs(R[x, y] - T[n, b, x, y]))
                        T[n, b, x, y] = R[x, y]
                    t /= mass
                    largest = max(largest, abs(t - T[n, b, x, 3]))
                    T[n, b, x, 3] = t
            if largest < _TOLERANCE:
                break


def skinned(weights: FloatArray, rest: FloatArray, T: FloatArray) -> FloatArray:
    """Shapes (N, V, 3) of transforms (N, B, 3, 4): p_i = Σ_b w_ib T_b ṽ_i."""
    shapes = np.empty((len(T), len(rest), 3))
    _skin(*_rows(weights), rest, np.ascontiguousarray(T), shapes)
    return shapes


def skinning_errors(
    weights: FloatArray, rest: FloatArray, T: FloatArray, shapes: FloatArray
) -> FloatArray:
    """Mean squares (V,) over N of the distance between `skinned` points and shapes (V, N, 3)."""
    return ((skinned(weights, rest, T) - shapes.transpose(1, 0, 2)) ** 2).sum(axis=2).mean(axis=0)


def _rows(weights: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Weights (V, B) row by row: where rows begin (V + 1,), bones, and their weights."""
    vertex, bone = np.nonzero(weights)
    starts = np.append(0, np.cumsum(np.bincount(vertex, minlength=len(weights))))
    return starts, bone, weights[vertex, bone]


@njit(nogil=True, error_model="numpy")
def _skin(starts, bones, shares, rest, T, shapes):
    for n in range(len(T)):
        for i in range(len(rest)):
            for x in range(3):
                total = 0.0
                for e in range(starts[i], starts[i + 1]):
                    t = T[n, bones[e], x]
                    total += shares[e] * (
                        t[0] * rest[i, 0] + t[1] * rest[i, 1] + t[2] * rest[i, 2] + t[3]
                    )
                shapes[n, i, x] = total
