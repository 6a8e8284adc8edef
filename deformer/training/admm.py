"""ADMM iterations of sparse components: min ½‖X − W C‖² + Σ_k Σ_i Λ_ki ‖C_ki‖₂ over C.

The sites are independent of each other. A few at a time go through all iterations while they are in
the processor's cache; numbers of a dimension lie side by side there, so that lengths are computed
by vectors.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deformer.compilation import called_with, njit
from deformer.geometry import FloatArray
from deformer.linalg import one_blas_thread, over_parts

# Sites that go through the iterations together.
_BLOCK = 128


class Sums(NamedTuple):
    """What weights and objective depend on, of components C (K, m·D) of m sites and their data X.

    Sums of several groups of sites add up, but the lengths, which are each site's own.

    Args:
        against: X Cᵀ (N, K), in double precision.
        gram: C Cᵀ (K, K), in double precision.
        lengths: (K, m) of the components at each site, in the data's precision.
    """

    against: FloatArray
    gram: FloatArray
    lengths: NDArray


def admm(
    X: NDArray,
    W: NDArray,
    penalty: NDArray,
    start: NDArray,
    dual: NDArray,
    *,
    strength: float,
    iterations: int,
) -> tuple[NDArray, NDArray, Sums]:
    """Iterate from given components and dual variables; all arrays have one floating dtype.

    Args:
        X: (N, m·D) data.
        W: (N, K) weights.
        penalty: Λ (K, m) of each site's length.
        start: C (K, m·D).
        dual: U (K, m·D), scaled.
        strength: ρ of the augmented Lagrangian.
        iterations: number of iterations.

    Returns:
        C (K, m·D), exactly 0 where it is shrunk away; U (K, m·D); and the sums of C.
    """
    K, m = penalty.shape
    dtype = X.dtype.type
    inverse = np.linalg.inv(W.T @ W + dtype(strength) * np.eye(K, dtype=dtype))
    moving, fixing = dtype(strength) * inverse, inverse @ W.T
    Z, U = np.empty_like(start, order="C"), np.empty_like(start, order="C")
    x, *given = (a.reshape(len(a), m, -1) for a in (X, start, dual))
    out = [a.reshape(K, m, -1) for a in (Z, U)]

    def fitted(sites: slice) -> tuple[NDArray, NDArray]:
        # (·, D, sites): numbers of a dimension side by side.
        data, z, u = (np.swapaxes(a[:, sites], 1, 2).copy() for a in (x, *given))
        flat = K, z.shape[1] * z.shape[2]
        data = data.reshape(-1, flat[1])
        fixed = (fixing @ data).reshape(z.shape)
        least = np.ascontiguousarray(penalty[:, sites] / dtype(strength))
        change, found = (z - u).reshape(flat), np.empty(flat, dtype=dtype)
        for _ in range(iterations):
            np.matmul(moving, change, out=found)
            _shrink(found.reshape(z.shape), fixed, least, z, u, change.reshape(z.shape))
        for whole, part in zip(out, (z, u), strict=True):
            whole[:, sites] = np.swapaxes(part, 1, 2)
        return data, z

    return Z, U, _summed(fitted, len(X), K, m, dtype)


def sums_of(X: NDArray, C: NDArray, sites: int) -> Sums:
    """The sums of components C (K, m·D) and data X (N, m·D) at m sites."""
    x, c = (a.reshape(len(a), sites, -1) for a in (X, C))

    def given(part: slice) -> tuple[NDArray, NDArray]:
        data, own = (np.swapaxes(a[:, part], 1, 2).copy() for a in (x, c))
        return data.reshape(len(data), -1), own

    return _summed(given, len(X), len(C), sites, X.dtype.type)


def _summed(
    block: Callable[[slice], tuple[NDArray, NDArray]], N: int, K: int, m: int, dtype: type
) -> Sums:
    """Sums over blocks of sites, on all cores.

    Each block has sums of its own, and the blocks do not depend on the number of cores: neither do
    the numbers.

    Args:
        block: gives data (N, D·s) and components (K, D, s) of s sites.
        N, K, m: numbers of shapes, components and sites.
        dtype: of the data.
    """
    count = -(-m // _BLOCK)
    against = np.empty((count, N, K), dtype=dtype)
    gram, lengths = np.empty((count, K, K), dtype=dtype), np.empty((K, m), dtype=dtype)

    def add(blocks: range) -> None:
        for n in blocks:
            sites = slice(n * _BLOCK, min((n + 1) * _BLOCK, m))
            data, own = block(sites)
            flat = own.reshape(K, -1)
            np.matmul(data, flat.T, out=against[n])
            np.matmul(flat, flat.T, out=gram[n])
            lengths[:, sites] = np.sqrt(np.einsum("kdm,kdm->km", own, own))

    with one_blas_thread():
        over_parts(add, count)
    return Sums(against.sum(axis=0, dtype=np.float64), gram.sum(axis=0, dtype=np.float64), lengths)


@called_with("void(f4[:,:,::1], f4[:,:,::1], f4[:,::1], f4[:,:,::1], f4[:,:,::1], f4[:,:,::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def _shrink(found, fixed, least, z, u, change):
    """Z = prox(C), U = C − Z and their difference, with C = `found` + `fixed` + U.

    All are (K, D, m) but the lengths (K, m) that the proximal map takes away.
    """
    K, D, m = found.shape
    kept = np.zeros(m, dtype=found.dtype)
    for k in range(K):
        kept[:] = 0
        for d in range(D):
            c, f, dual = found[k, d], fixed[k, d], u[k, d]
            for s in range(m):
                c[s] += f[s] + dual[s]
                kept[s] += c[s] * c[s]
        away = least[k]
        for s in range(m):
            size = np.sqrt(kept[s])
            # A length of 0 has no share.
            kept[s] = (size - away[s]) / size if size > away[s] else 0 * size
        for d in range(D):
            c, near, dual, step = found[k, d], z[k, d], u[k, d], change[k, d]
            for s in range(m):
                near[s] = c[s] * kept[s]
                dual[s] = c[s] - near[s]
                step[s] = near[s] - dual[s]
