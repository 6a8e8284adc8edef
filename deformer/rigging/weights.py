"""Weights of vertices: exact small least squares with w ≥ 0, Σ w = 1 and few bones a vertex."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deformer.compilation import njit
from deformer.geometry import FloatArray
from deformer.rigging.transforms import PULL
from deformer.workspace import slices

# Vertices whose products with all transforms are in memory at once.
_CHUNK = 8192
# Weights below this are nothing: engines store them in steps of 1/255.
SMALLEST_WEIGHT = 2e-3


def point_errors(rest: FloatArray, shapes: FloatArray, T: FloatArray) -> FloatArray:
    """Errors (V, B) Σ_n ‖T_b ṽ_i − p_i‖² of each vertex moved by each bone alone.

    Args:
        rest: (V, 3).
        shapes: (V, N, 3).
        T: (N, B, 3, 4).
    """
    errors = np.empty((len(rest), T.shape[1]))
    A, products = _stacked(T)
    for part in slices(len(rest), _CHUNK):
        h, c, square = _chunk(rest[part], shapes[part], A)
        _point_errors(h, c, square, products, errors[part])
    return errors


def fitted_weights(
    rest: FloatArray,
    shapes: FloatArray,
    T: FloatArray,
    near: NDArray[np.bool_],
    influences: int,
    smooth: FloatArray,
    smoothness: float,
) -> FloatArray:
    """Weights (V, B) that skin the rest shape closest to the shapes.

    Each row minimises Σ_n ‖Σ_b w_b T_b ṽ − p‖² + ρ Σ_n Σ_b w_b ‖T_b ṽ − p‖² + μ ‖w − s‖² over w ≥ 0
    with Σ w = 1 (Le and Deng 2012; the last term as in Le and Deng 2014).
    Of more bones than `influences` the one with the least weight is left out, until as many remain.

    Args:
        rest: (V, 3).
        shapes: (V, N, 3).
        T: (N, B, 3, 4).
        near: (V, B) bones that may move a vertex, at least one of each row.
        influences: most bones of a vertex.
        smooth: (V, B) the weights s, means over each vertex's neighbours.
        smoothness: μ, positive.
    """
    weights = np.zeros(near.shape)
    A, products = _stacked(T)
    for part in slices(len(rest), _CHUNK):
        h, c, square = _chunk(rest[part], shapes[part], A)
        _fit(
            h, c, square, products, near[part], influences, smooth[part], smoothness, PULL,
            weights[part],
        )  # fmt: skip
    return weights


def _stacked(T: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The transforms side by side (3N, 4B), and Σ_n T_bᵀ T_c (B, B, 4, 4)."""
    N, B = T.shape[:2]
    A = np.ascontiguousarray(T.transpose(0, 2, 1, 3)).reshape(3 * N, 4 * B)
    products = (A.T @ A).reshape(B, 4, B, 4).transpose(0, 2, 1, 3)
    return A, np.ascontiguousarray(products)


def _chunk(
    rest: FloatArray, shapes: FloatArray, A: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """ṽ (v, 4), Σ_n T_bᵀ p (v, B, 4) and Σ_n ‖p‖² (v,) of some vertices."""
    flat = shapes.reshape(len(rest), -1)
    h = np.column_stack([rest, np.ones(len(rest))])
    c = np.ascontiguousarray((flat @ A).reshape(len(rest), -1, 4))
    return h, c, np.einsum("ij,ij->i", flat, flat)


@njit(nogil=True, error_model="numpy")
def _quadratic(M, h):
    total = 0.0
    for x in range(4):
        for y in range(4):
            total += h[x] * M[x, y] * h[y]
    return total


@njit(nogil=True, error_model="numpy")
def _error(products, h, c, square, b):
    linear = 0.0
    for x in range(4):
        linear += h[x] * c[b, x]
    return max(_quadratic(products[b, b], h) - 2.0 * linear + square, 0.0), linear


@njit(nogil=True, error_model="numpy")
def _point_errors(h, c, square, products, errors):
    for i in range(len(h)):
        for b in range(len(products)):
            errors[i, b] = _error(products, h[i], c[i], square[i], b)[0]


@njit(nogil=True, error_model="numpy")
def _fit(h, c, square, products, near, influences, smooth, smoothness, pull, weights):
    V, B = near.shape
    bones = np.empty(B, np.int64)
    G = np.empty((B, B))
    g = np.empty(B)
    w = np.empty(B)
    for i in range(V):
        m = 0
        for b in range(B):
            if near[i, b]:
                bones[m] = b
                m += 1
        for a in range(m):
            error, linear = _error(products, h[i], c[i], square[i], bones[a])
            g[a] = linear - 0.5 * pull * error + smoothness * smooth[i, bones[a]]
            for b in range(a + 1):
                G[a, b] = G[b, a] = _quadratic(products[bones[a], bones[b]], h[i])
            G[a, a] += smoothness
        simplex_least_squares(G, g, m, w)
        while True:
            # The bones that are left, without the one with the least weight.
            used, least = 0, -1
            for a in range(m):
                if w[a] > 0.0:
                    used += 1
                    if least < 0 or w[a] < w[least]:
                        least = a
            if used <= influences and w[least] >= SMALLEST_WEIGHT:
                break
            n = 0
            for a in range(m):
                if w[a] > 0.0 and a != least:
                    bones[n] = bones[a]
                    g[n] = g[a]
                    k = 0
                    for b in range(m):
                        if w[b] > 0.0 and b != least:
                            G[n, k] = G[a, b]
                            k += 1
                    n += 1
            m = n
            simplex_least_squares(G, g, m, w)
        for a in range(m):
            weights[i, bones[a]] = w[a]


@njit(nogil=True, error_model="numpy")
def simplex_least_squares(G, g, m, w):
    """w[:m] = argmin ½ wᵀ G w − gᵀ w over w ≥ 0, Σ w = 1, by an active set.

    G[:m, :m] is symmetric and positive definite. As in Lawson and Hanson's NNLS, with the sum as
    one equality: bones enter one by one, the one with the steepest descent first, and leave
    where the way to the minimum of those inside ends at a weight of 0.
    """
    inside = np.zeros(m, np.bool_)
    order = np.empty(m, np.int64)
    L = np.empty((m, m))
    x = np.empty(m)
    y = np.empty(m)
    scale = 0.0
    best = 0
    for a in range(m):
        w[a] = 0.0
        scale = max(scale, G[a, a])
        if 0.5 * G[a, a] - g[a] < 0.5 * G[best, best] - g[best]:
            best = a
    w[best], inside[best] = 1.0, True
    entered = best
    for _ in range(10 * m + 10):
        n = 0
        for a in range(m):
            if inside[a]:
                order[n] = a
                n += 1
        # Cholesky of the rows inside, then G x = g and G y = 1.
        for a in range(n):
            for b in range(a + 1):
                total = G[order[a], order[b]]
                for k in range(b):
                    total -= L[a, k] * L[b, k]
                if a == b:
                    L[a, a] = np.sqrt(max(total, 1e-14 * scale))
                else:
                    L[a, b] = total / L[b, b]
        for a in range(n):
            x[a], y[a] = g[order[a]], 1.0
            for k in range(a):
                x[a] -= L[a, k] * x[k]
                y[a] -= L[a, k] * y[k]
            x[a] /= L[a, a]
            y[a] /= L[a, a]
        for a in range(n - 1, -1, -1):
            for k in range(a + 1, n):
                x[a] -= L[k, a] * x[k]
                y[a] -= L[k, a] * y[k]
            x[a] /= L[a, a]
            y[a] /= L[a, a]
        sum_x, sum_y = 0.0, 0.0
        for a in range(n):
            sum_x += x[a]
            sum_y += y[a]
        multiplier = (sum_x - 1.0) / sum_y
        step, leaves = 1.0, -1
        for a in range(n):
            x[a] -= multiplier * y[a]
            if x[a] <= 0.0:
                here = w[order[a]]
                share = here / (here - x[a]) if here > x[a] else 0.0
                if share < step:
                    step, leaves = share, order[a]
        for a in range(n):
            w[order[a]] += step * (x[a] - w[order[a]])
        if leaves >= 0:
            w[leaves], inside[leaves] = 0.0, False
            if leaves == entered and step == 0.0:
                break  # rounding alone made it enter
            continue
        entered, steepest = -1, 1e-12 * scale
        for a in range(m):
            if not inside[a]:
                slope = g[a] - multiplier
                for b in range(n):
                    slope -= G[a, order[b]] * w[order[b]]
                if slope > steepest:
                    entered, steepest = a, slope
        if entered < 0:
            break
        inside[entered] = True
    total = 0.0
    for a in range(m):
        total += w[a]
    for a in range(m):
        w[a] /= total
