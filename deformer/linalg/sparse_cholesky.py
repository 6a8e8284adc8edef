"""Sparse Cholesky: factor a symmetric positive definite matrix once, solve many times.

Multifrontal, on dense blocks: a supernode with pivot block F and rows B below it keeps F⁻¹ and
B F⁻¹, so that a solve is a sequence of small matrix products without a triangular substitution,
and parts of the mesh that do not touch are solved by different threads.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse

from deformer.geometry import FloatArray, IntArray
from deformer.linalg.nested_dissection import Dissection, dissect
from deformer.linalg.threads import CORES, together

# Parts below this many rows are not worth a thread of their own.
_SMALLEST_PART = 8000


@njit(cache=True, error_model="numpy")
def _factor(indptr, indices, data, order, place, starts, bounds, rows, parent):
    """Blocks [F⁻¹; −B F⁻¹] (w + m, w) of all supernodes, one after the other, and their slices."""
    N = len(starts) - 1
    slices = np.zeros(N + 1, dtype=np.int64)
    for s in range(N):
        w = starts[s + 1] - starts[s]
        slices[s + 1] = slices[s] + w * (w + bounds[s + 1] - bounds[s])
    blocks = np.empty(slices[N])
    nothing = np.empty((0, 0))
    updates = [nothing for _ in range(N)]
    head, following = np.full(N, -1), np.full(N, -1)
    where = np.empty(len(order), dtype=np.int64)
    for s in range(N):
        lo, w = starts[s], starts[s + 1] - starts[s]
        below = rows[bounds[s] : bounds[s + 1]]
        m = len(below)
        front = np.zeros((w + m, w + m))
        for k in range(w):
            where[lo + k] = k
        for k in range(m):
            where[below[k]] = w + k
        for k in range(w):
            i = order[lo + k]
            for e in range(indptr[i], indptr[i + 1]):
                j = place[indices[e]]
                if j >= lo:
                    front[where[j], k] += data[e]
        child = head[s]
        while child >= 0:
            update = updates[child]
            mine = where[rows[bounds[child] : bounds[child + 1]]]
            for a in range(len(mine)):
                for b in range(len(mine)):
                    front[mine[a], mine[b]] += update[a, b]
            updates[child] = nothing
            child = following[child]
        L = np.linalg.cholesky(np.ascontiguousarray(front[:w, :w]))
        X = np.linalg.inv(L)
        block = blocks[slices[s] : slices[s + 1]].reshape(w + m, w)
        block[:w] = X.T @ X
        if m:
            # By way of L⁻¹, not F⁻¹: what is taken off never exceeds what is there, by rounding.
            Y = np.ascontiguousarray(front[w:, :w]) @ X.T
            block[w:] = -(Y @ X)
            updates[s] = front[w:, w:] - Y @ Y.T
            following[s] = head[parent[s]]
            head[parent[s]] = s
    return slices, blocks


@njit(cache=True, nogil=True, error_model="numpy")
def _forward(first, last, begin, starts, bounds, rows, slices, blocks, x, tail):
    """Eliminate supernodes first…last − 1 from x (n, m); rows from `begin` on add to `tail`.

    Of a right-hand side with few entries only the supernodes that they reach are touched.
    """
    for s in range(first, last):
        lo, w = starts[s], starts[s + 1] - starts[s]
        if not x[lo : lo + w].any():
            continue
        block = blocks[slices[s] : slices[s + 1]].reshape(-1, w)
        below = rows[bounds[s] : bounds[s + 1]]
        if len(below) == 0:
            continue
        change = np.dot(block[w:], x[lo : lo + w])
        for k in range(len(below)):
            r = below[k]
            row = x[r] if r < begin else tail[r - begin]
            for c in range(x.shape[1]):
                row[c] += change[k, c]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _backward(first, last, starts, bounds, rows, slices, blocks, x):
    """Solution of supernodes last − 1…first, in place."""
    sums = np.empty(len(x), dtype=x.dtype)
    for s in range(last - 1, first - 1, -1):
        lo, w = starts[s], starts[s + 1] - starts[s]
        block = blocks[slices[s] : slices[s + 1]].reshape(-1, w)
        below = rows[bounds[s] : bounds[s + 1]]
        if x.shape[1] == 1:
            # BLAS takes twice as long for a single column.
            total = sums[:w]
            total[:] = 0
            for j in range(len(block)):
                row, u = block[j], x[lo + j if j < w else below[j - w], 0]
                for k in range(w):
                    total[k] += row[k] * u
            x[lo : lo + w, 0] = total
            continue
        gathered = np.empty((len(block), x.shape[1]), dtype=x.dtype)
        gathered[:w] = x[lo : lo + w]
        for k in range(len(below)):
            gathered[w + k] = x[below[k]]
        x[lo : lo + w] = np.dot(block.T, gathered)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _forward_three(first, last, begin, starts, bounds, rows, slices, blocks, x, tail):
    """`_forward` for three columns, with blocks (w, m) of −B F⁻¹ by column."""
    sums = np.empty((3, len(x)), dtype=x.dtype)
    for s in range(first, last):
        lo, w = starts[s], starts[s + 1] - starts[s]
        below = rows[bounds[s] : bounds[s + 1]]
        m = len(below)
        block = blocks[slices[s] : slices[s + 1]].reshape(w, m)
        s0, s1, s2 = sums[0, :m], sums[1, :m], sums[2, :m]
        s0[:], s1[:], s2[:] = 0, 0, 0
        k = 0
        while k + 4 <= w:
            a, b, c, d = block[k], block[k + 1], block[k + 2], block[k + 3]
            u, v = x[lo + k], x[lo + k + 1]
            y, z = x[lo + k + 2], x[lo + k + 3]
            u0, u1, u2, v0, v1, v2 = u[0], u[1], u[2], v[0], v[1], v[2]
            y0, y1, y2, z0, z1, z2 = y[0], y[1], y[2], z[0], z[1], z[2]
            for j in range(m):
                s0[j] += a[j] * u0 + b[j] * v0 + c[j] * y0 + d[j] * z0
                s1[j] += a[j] * u1 + b[j] * v1 + c[j] * y1 + d[j] * z1
                s2[j] += a[j] * u2 + b[j] * v2 + c[j] * y2 + d[j] * z2
            k += 4
        while k < w:
            a, u = block[k], x[lo + k]
            u0, u1, u2 = u[0], u[1], u[2]
            for j in range(m):
                s0[j] += a[j] * u0
                s1[j] += a[j] * u1
                s2[j] += a[j] * u2
            k += 1
        for j in range(m):
            r = below[j]
            row = x[r] if r < begin else tail[r - begin]
            row[0] += s0[j]
            row[1] += s1[j]
            row[2] += s2[j]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _backward_three(first, last, starts, bounds, rows, slices, blocks, x):
    """`_backward` for three columns."""
    sums = np.empty((3, len(x)), dtype=x.dtype)
    for s in range(last - 1, first - 1, -1):
        lo, w = starts[s], starts[s + 1] - starts[s]
        below = rows[bounds[s] : bounds[s + 1]]
        n = w + len(below)
        block = blocks[slices[s] : slices[s + 1]].reshape(n, w)
        s0, s1, s2 = sums[0, :w], sums[1, :w], sums[2, :w]
        s0[:], s1[:], s2[:] = 0, 0, 0
        j = 0
        while j + 4 <= n:
            a, b, c, d = block[j], block[j + 1], block[j + 2], block[j + 3]
            u = x[lo + j if j < w else below[j - w]]
            v = x[lo + j + 1 if j + 1 < w else below[j + 1 - w]]
            y = x[lo + j + 2 if j + 2 < w else below[j + 2 - w]]
            z = x[lo + j + 3 if j + 3 < w else below[j + 3 - w]]
            u0, u1, u2, v0, v1, v2 = u[0], u[1], u[2], v[0], v[1], v[2]
            y0, y1, y2, z0, z1, z2 = y[0], y[1], y[2], z[0], z[1], z[2]
            for k in range(w):
                s0[k] += a[k] * u0 + b[k] * v0 + c[k] * y0 + d[k] * z0
                s1[k] += a[k] * u1 + b[k] * v1 + c[k] * y1 + d[k] * z1
                s2[k] += a[k] * u2 + b[k] * v2 + c[k] * y2 + d[k] * z2
            j += 4
        while j < n:
            a, u = block[j], x[lo + j if j < w else below[j - w]]
            u0, u1, u2 = u[0], u[1], u[2]
            for k in range(w):
                s0[k] += a[k] * u0
                s1[k] += a[k] * u1
                s2[k] += a[k] * u2
            j += 1
        for k in range(w):
            x[lo + k, 0] = s0[k]
            x[lo + k, 1] = s1[k]
            x[lo + k, 2] = s2[k]


@njit(cache=True)
def _columns_of_below(starts, bounds, slices, blocks):
    """The lower parts −B F⁻¹ of all blocks, by column (w, m), and their slices."""
    N = len(starts) - 1
    where = np.zeros(N + 1, dtype=np.int64)
    for s in range(N):
        w, m = starts[s + 1] - starts[s], bounds[s + 1] - bounds[s]
        where[s + 1] = where[s] + w * m
    out = np.empty(where[N], dtype=np.float32)
    for s in range(N):
        w = starts[s + 1] - starts[s]
        lower = blocks[slices[s] : slices[s + 1]].reshape(-1, w)[w:]
        target = out[where[s] : where[s + 1]].reshape(w, -1)
        for k in range(len(lower)):
            for c in range(w):
                target[c, k] = lower[k, c]
    return where, out


class SparseCholesky:
    """Factor of a symmetric positive definite matrix A (n, n).

    Args:
        matrix: A.
        points: (n, 3) where the rows are in space; decides the order of elimination.
        plan: of an earlier factor; taken over if A has its entries in the same places.

    Raises:
        numpy.linalg.LinAlgError: A is not positive definite, or not finite.
    """

    def __init__(
        self, matrix: sparse.sparray, points: FloatArray, plan: Dissection | None = None
    ) -> None:
        """Order and factor `matrix`."""
        A = sparse.csr_array(matrix)
        indptr, indices = A.indptr.astype(np.int64), A.indices.astype(np.int64)
        if plan is None or not plan.suits(indptr, indices):
            parts = min(CORES, len(points) // _SMALLEST_PART)
            depth = max(0, int(np.ceil(np.log2(max(parts, 1)))))
            plan = dissect(indptr, indices, np.asarray(points, dtype=np.float64), depth)
        self.plan = plan
        self.order: IntArray = plan.order
        self.place: IntArray = plan.place
        # Rows from here on are touched by several tasks.
        self._begin = int(plan.starts[plan.tasks[-1]])
        self._nodes = plan.starts, plan.bounds, plan.rows
        self._slices, self._blocks = _factor(
            indptr, indices, A.data, plan.order, plan.place, *self._nodes, plan.parent
        )

    @cached_property
    def _single(self) -> NDArray:
        """The blocks in single precision."""
        return self._blocks.astype(np.float32)

    @cached_property
    def _lower(self) -> tuple[NDArray, NDArray]:
        """The lower parts of the blocks by column, in single precision, and their slices."""
        starts, bounds, _ = self._nodes
        return _columns_of_below(starts, bounds, self._slices, self._single)

    def supernodes(self) -> Iterator[tuple[int, int, NDArray, NDArray]]:
        """Blocks in the order of elimination: places first…last − 1, rows below (m,), block.

        The block (w + m, w), single precision, is [F⁻¹; −B F⁻¹]: x[rows] gain its lower part times
        x[first:last] on the way forward; on the way back x[first:last] is its transpose times
        those and x[rows].
        """
        starts, bounds, rows = self._nodes
        for s, (first, last) in enumerate(pairwise(starts.tolist())):
            block = self._single[self._slices[s] : self._slices[s + 1]]
            yield first, last, rows[bounds[s] : bounds[s + 1]], block.reshape(-1, last - first)

    @property
    def bytes_of_a_solve(self) -> int:
        """Bytes of the factor that `solve_in_order` reads for three columns."""
        return self._single.nbytes + self._lower[1].nbytes

    def solve(self, b: FloatArray) -> FloatArray:
        """Solution x (n, m) of A x = b for right-hand sides b (n, m), float64."""
        x = np.ascontiguousarray(np.asarray(b, dtype=np.float64)[self.order])
        factor = self._slices, self._blocks
        self._sweep(x, _forward, factor, _backward, factor)
        return x[self.place]

    def solve_in_order(self, x: NDArray) -> None:
        """Solve in place: x (n, m) float32, its rows in the order of elimination `order`."""
        factor = self._slices, self._single
        if x.shape[1] == 3:
            self._sweep(x, _forward_three, self._lower, _backward_three, factor)
        else:
            self._sweep(x, _forward, factor, _backward, factor)

    def _sweep(self, x: NDArray, forward: Any, lower: Any, backward: Any, upper: Any) -> None:
        """Forward through the tasks, then the rows that they share; back the other way."""
        tasks, begin, n = self.plan.tasks, self._begin, len(x)
        last = len(self.plan.starts) - 1
        tails = np.zeros((len(tasks) - 1, n - begin, x.shape[1]), dtype=x.dtype)
        ranges = list(pairwise(tasks.tolist()))
        together(
            forward,
            [(*r, begin, *self._nodes, *lower, x, t) for r, t in zip(ranges, tails, strict=True)],
        )
        x[begin:] += tails.sum(axis=0)
        forward(tasks[-1], last, n, *self._nodes, *lower, x, tails[0])
        backward(tasks[-1], last, *self._nodes, *upper, x)
        together(backward, [(*r, *self._nodes, *upper, x) for r in ranges])
