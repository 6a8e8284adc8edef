"""Sparse Cholesky: factor a symmetric positive definite matrix once, solve many times.

Multifrontal, on dense blocks: a supernode with pivot block F and rows B below it stores F⁻¹ and
B F⁻¹. A solve is then a sequence of small matrix products, without triangular substitutions, and
parts of the mesh that are not connected are solved by different threads.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg.lapack import (
    dpotrf,  # pyright: ignore[reportAttributeAccessIssue]  f2py has no stubs
    dtrtri,  # pyright: ignore[reportAttributeAccessIssue]
)

from deformer.compilation import called_with, njit
from deformer.geometry import FloatArray, IntArray
from deformer.linalg.nested_dissection import Dissection, dissect
from deformer.linalg.threads import CORES, one_blas_thread, run_calls

# Parts below this many rows are not worth a thread of their own.
_SMALLEST_PART = 8000


# Arguments that the compiled functions share: `starts`, `bounds` and `rows` of a `Dissection`; the
# blocks and their slices as `_factor` returns them; right-hand sides x (n, m), rows in the order of
# elimination, which become the solutions in place.
#
# LAPACK and BLAS factor the dense blocks. The compiled functions are plain loops: with assignments
# between slices, or with factorisations, they would take many times as long to compile.


@called_with(
    "void(i8, i8[::1], i8[::1], f8[::1], i8[::1], i8[::1], i8[::1], i8[::1], i4[::1], "
    "i8[::1], f8[:, ::1])"
)
@njit()
def _assemble(s, indptr, indices, data, order, inverse_order, starts, bounds, rows, row_of, front):
    """Add A's columns of supernode s to its front (w + m, w + m); `row_of` gets its rows."""
    lo, w = starts[s], starts[s + 1] - starts[s]
    for k in range(w):
        row_of[lo + k] = k
    for e in range(bounds[s], bounds[s + 1]):
        row_of[rows[e]] = w + e - bounds[s]
    for k in range(w):
        i = order[lo + k]
        for e in range(indptr[i], indptr[i + 1]):
            j = inverse_order[indices[e]]
            if j >= lo:
                front[row_of[j], k] += data[e]


@called_with("void(i8, i8, i4[::1], i8[::1], f8[:, ::1], f8[:, ::1])")
@njit()
def _add_update(first, last, rows, row_of, update, front):
    """Add the update (m, m) of a child with the rows first…last − 1 to the front."""
    for a in range(last - first):
        row = row_of[rows[first + a]]
        for b in range(last - first):
            front[row, row_of[rows[first + b]]] += update[a, b]


def _factor(A: sparse.csr_array, plan: Dissection) -> tuple[IntArray, FloatArray]:
    """Blocks [F⁻¹; −B F⁻¹] (w + m, w) of all supernodes, one after the other, and their slices."""
    if not np.isfinite(A.data).all():
        raise np.linalg.LinAlgError("the matrix has infs or NaNs")
    indptr, indices = plan.indptr, plan.indices
    width, below = np.diff(plan.starts), np.diff(plan.bounds)
    slices: IntArray = np.concatenate([[0], np.cumsum(width * (width + below))])
    blocks = np.empty(slices[-1])
    children: list[list[tuple[int, FloatArray]]] = [[] for _ in width]
    row_of = np.empty(len(plan.order), dtype=np.int64)
    nodes = plan.starts, plan.bounds, plan.rows
    parents, bounds = plan.parent.tolist(), plan.bounds.tolist()
    for s, (w, m) in enumerate(zip(width.tolist(), below.tolist(), strict=True)):
        front = np.zeros((w + m, w + m))
        _assemble(s, indptr, indices, A.data, plan.order, plan.inverse_order, *nodes, row_of, front)
        for child, update in children[s]:
            _add_update(bounds[child], bounds[child + 1], plan.rows, row_of, update, front)
        children[s].clear()
        L, info = dpotrf(front[:w, :w], lower=1)
        if info != 0:
            raise np.linalg.LinAlgError("the matrix is not positive definite")
        X, _ = dtrtri(L, lower=1, overwrite_c=1)
        block = blocks[slices[s] : slices[s + 1]].reshape(w + m, w)
        np.matmul(X.T, X, out=block[:w])
        if m:
            # With L⁻¹ and not F⁻¹: subtracting Y Yᵀ leaves the update definite despite rounding.
            Y = front[w:, :w] @ X.T
            np.matmul(-Y, X, out=block[w:])
            children[parents[s]].append((s, front[w:, w:] - Y @ Y.T))
    return slices, blocks


@called_with(
    "void(i8, i8, i8, i8[::1], i8[::1], i4[::1], i8[::1], f8[::1], f8[:, ::1], f8[:, ::1])"
)
@njit(nogil=True, error_model="numpy")
def _forward(first, last, begin, starts, bounds, rows, slices, blocks, x, tail):
    """Eliminate supernodes first…last − 1 from x (n, m); changes of rows ≥ `begin` go to `tail`.

    Supernodes whose rows of x are all zero are skipped, as most are for a sparse right-hand side.
    """
    columns = x.shape[1]
    for s in range(first, last):
        lo, w = starts[s], starts[s + 1] - starts[s]
        reached = False
        for k in range(w):
            for c in range(columns):
                if x[lo + k, c] != 0:
                    reached = True
        m = bounds[s + 1] - bounds[s]
        if m == 0 or not reached:
            continue
        block = blocks[slices[s] : slices[s + 1]].reshape(w + m, w)
        change = np.dot(block[w:], x[lo : lo + w])
        for k in range(m):
            r = rows[bounds[s] + k]
            for c in range(columns):
                if r < begin:
                    x[r, c] += change[k, c]
                else:
                    tail[r - begin, c] += change[k, c]


@called_with("void(i8, i8, i8[::1], i8[::1], i4[::1], i8[::1], f8[::1], f8[:, ::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def _backward(first, last, starts, bounds, rows, slices, blocks, x):
    """Solve for the rows of supernodes last − 1…first, in place."""
    columns = x.shape[1]
    sums = np.empty(len(x))
    for s in range(last - 1, first - 1, -1):
        lo, w = starts[s], starts[s + 1] - starts[s]
        m = bounds[s + 1] - bounds[s]
        below = bounds[s] - w
        if columns == 1:
            # BLAS takes twice as long for a single column.
            for k in range(w):
                sums[k] = 0
            for j in range(w + m):
                u = x[lo + j if j < w else rows[below + j], 0]
                o = slices[s] + j * w
                row = blocks[o : o + w]  # an index o + k may be negative, which stops vectorising
                for k in range(w):
                    sums[k] += row[k] * u
            for k in range(w):
                x[lo + k, 0] = sums[k]
            continue
        gathered = np.empty((w + m, columns))
        for j in range(w + m):
            r = lo + j if j < w else rows[below + j]
            for c in range(columns):
                gathered[j, c] = x[r, c]
        block = blocks[slices[s] : slices[s + 1]].reshape(w + m, w)
        solution = np.dot(block.T, gathered)
        for k in range(w):
            for c in range(columns):
                x[lo + k, c] = solution[k, c]


@called_with(
    "void(i8, i8, i8, i8[::1], i8[::1], i4[::1], i8[::1], f4[::1], f4[:, ::1], f4[:, ::1])"
)
@njit(nogil=True, error_model="numpy", fastmath=True)
def _forward_three(first, last, begin, starts, bounds, rows, slices, blocks, x, tail):
    """`_forward` for three columns in single precision, blocks (w, m) of −B F⁻¹ by column."""
    most = 0
    for s in range(first, last):
        most = max(most, bounds[s + 1] - bounds[s])
    sums = np.empty((3, most), dtype=np.float32)
    for s in range(first, last):
        lo, w = starts[s], starts[s + 1] - starts[s]
        below, m = bounds[s], bounds[s + 1] - bounds[s]
        s0, s1, s2 = sums[0], sums[1], sums[2]
        for j in range(m):
            s0[j] = s1[j] = s2[j] = 0
        o, k = slices[s], 0
        # Columns of the block four at a time: each pass over the sums does four times the work.
        while k + 4 <= w:
            a, b = blocks[o : o + m], blocks[o + m : o + 2 * m]
            c, d = blocks[o + 2 * m : o + 3 * m], blocks[o + 3 * m : o + 4 * m]
            i = lo + k
            u0, u1, u2, v0, v1, v2 = (
                x[i, 0],
                x[i, 1],
                x[i, 2],
                x[i + 1, 0],
                x[i + 1, 1],
                x[i + 1, 2],
            )
            i += 2
            y0, y1, y2, z0, z1, z2 = (
                x[i, 0],
                x[i, 1],
                x[i, 2],
                x[i + 1, 0],
                x[i + 1, 1],
                x[i + 1, 2],
            )
            for j in range(m):
                s0[j] += a[j] * u0 + b[j] * v0 + c[j] * y0 + d[j] * z0
                s1[j] += a[j] * u1 + b[j] * v1 + c[j] * y1 + d[j] * z1
                s2[j] += a[j] * u2 + b[j] * v2 + c[j] * y2 + d[j] * z2
            o, k = o + 4 * m, k + 4
        while k < w:
            a = blocks[o : o + m]
            u0, u1, u2 = x[lo + k, 0], x[lo + k, 1], x[lo + k, 2]
            for j in range(m):
                s0[j] += a[j] * u0
                s1[j] += a[j] * u1
                s2[j] += a[j] * u2
            o, k = o + m, k + 1
        for j in range(m):
            r = rows[below + j]
            if r < begin:
                x[r, 0] += s0[j]
                x[r, 1] += s1[j]
                x[r, 2] += s2[j]
            else:
                tail[r - begin, 0] += s0[j]
                tail[r - begin, 1] += s1[j]
                tail[r - begin, 2] += s2[j]


@called_with("void(i8, i8, i8[::1], i8[::1], i4[::1], i8[::1], f4[::1], f4[:, ::1])")
@njit(nogil=True, error_model="numpy", fastmath=True)
def _backward_three(first, last, starts, bounds, rows, slices, blocks, x):
    """`_backward` for three columns in single precision."""
    widest = 0
    for s in range(first, last):
        widest = max(widest, starts[s + 1] - starts[s])
    sums = np.empty((3, widest), dtype=np.float32)
    for s in range(last - 1, first - 1, -1):
        lo, w = starts[s], starts[s + 1] - starts[s]
        n = w + bounds[s + 1] - bounds[s]
        below = bounds[s] - w
        s0, s1, s2 = sums[0], sums[1], sums[2]
        for k in range(w):
            s0[k] = s1[k] = s2[k] = 0
        o, j = slices[s], 0
        while j + 4 <= n:
            a, b = blocks[o : o + w], blocks[o + w : o + 2 * w]
            c, d = blocks[o + 2 * w : o + 3 * w], blocks[o + 3 * w : o + 4 * w]
            i = lo + j if j < w else rows[below + j]
            u0, u1, u2 = x[i, 0], x[i, 1], x[i, 2]
            i = lo + j + 1 if j + 1 < w else rows[below + j + 1]
            v0, v1, v2 = x[i, 0], x[i, 1], x[i, 2]
            i = lo + j + 2 if j + 2 < w else rows[below + j + 2]
            y0, y1, y2 = x[i, 0], x[i, 1], x[i, 2]
            i = lo + j + 3 if j + 3 < w else rows[below + j + 3]
            z0, z1, z2 = x[i, 0], x[i, 1], x[i, 2]
            for k in range(w):
                s0[k] += a[k] * u0 + b[k] * v0 + c[k] * y0 + d[k] * z0
                s1[k] += a[k] * u1 + b[k] * v1 + c[k] * y1 + d[k] * z1
                s2[k] += a[k] * u2 + b[k] * v2 + c[k] * y2 + d[k] * z2
            o, j = o + 4 * w, j + 4
        while j < n:
            a = blocks[o : o + w]
            i = lo + j if j < w else rows[below + j]
            u0, u1, u2 = x[i, 0], x[i, 1], x[i, 2]
            for k in range(w):
                s0[k] += a[k] * u0
                s1[k] += a[k] * u1
                s2[k] += a[k] * u2
            o, j = o + w, j + 1
        for k in range(w):
            x[lo + k, 0] = s0[k]
            x[lo + k, 1] = s1[k]
            x[lo + k, 2] = s2[k]


class SparseCholesky:
    """Factor of a symmetric positive definite matrix A (n, n).

    Args:
        matrix: A, sparse.
        points: (n, 3) position of each row in space, any unit; the order of elimination depends on
            them.
        plan: order of elimination of an earlier factor, used if its sparsity pattern is A's.

    Raises:
        numpy.linalg.LinAlgError: A is not positive definite, or not finite.
    """

    def __init__(
        self, matrix: sparse.sparray, points: FloatArray, plan: Dissection | None = None
    ) -> None:
        """Order and factor `matrix`."""
        A = sparse.csr_array(matrix)
        indptr, indices = A.indptr.astype(np.int64), A.indices.astype(np.int64)
        if plan is None or not plan.matches(indptr, indices):
            parts = min(CORES, len(points) // _SMALLEST_PART)
            depth = max(0, int(np.ceil(np.log2(max(parts, 1)))))
            plan = dissect(indptr, indices, np.asarray(points, dtype=np.float64), depth)
        self.plan = plan
        self.order: IntArray = plan.order
        self.inverse_order: IntArray = plan.inverse_order
        # Several tasks contribute to the rows from this one on.
        self._begin = int(plan.starts[plan.tasks[-1]])
        self._nodes = plan.starts, plan.bounds, plan.rows
        with one_blas_thread():  # numpy's and scipy's threads would spin against each other
            self._slices, self._blocks = _factor(A, plan)

    @cached_property
    def _single(self) -> NDArray:
        """The blocks in single precision."""
        return self._blocks.astype(np.float32)

    @cached_property
    def _lower(self) -> tuple[NDArray, NDArray]:
        """The lower parts of the blocks by column, in single precision, and their slices."""
        width, below = np.diff(self.plan.starts), np.diff(self.plan.bounds)
        slices: IntArray = np.concatenate([[0], np.cumsum(width * below)])
        lower = np.empty(slices[-1], dtype=np.float32)
        for s, (w, m) in enumerate(zip(width.tolist(), below.tolist(), strict=True)):
            block = self._single[self._slices[s] : self._slices[s + 1]].reshape(w + m, w)
            lower[slices[s] : slices[s + 1]].reshape(w, m)[:] = block[w:].T
        return slices, lower

    def supernodes(self) -> Iterator[tuple[int, int, NDArray, NDArray]]:
        """Supernodes in the order of elimination: columns first…last − 1, rows below (m,), block.

        The block (w + m, w) float32 is [F⁻¹; −B F⁻¹]. The forward pass adds its lower part times
        x[first:last] to x[rows]; in the backward pass x[first:last] becomes its transpose times
        x[first:last] and x[rows].
        """
        starts, bounds, rows = self._nodes
        for s, (first, last) in enumerate(pairwise(starts.tolist())):
            block = self._single[self._slices[s] : self._slices[s + 1]]
            yield first, last, rows[bounds[s] : bounds[s + 1]], block.reshape(-1, last - first)

    @property
    def bytes_per_solve(self) -> int:
        """Bytes of the factor that `solve_in_order` reads."""
        return self._single.nbytes + self._lower[1].nbytes

    def solve(self, b: FloatArray) -> FloatArray:
        """Solutions x (n, m) of A x = b for right-hand sides b (n, m)."""
        x = np.ascontiguousarray(np.asarray(b, dtype=np.float64)[self.order])
        factor = self._slices, self._blocks
        self._sweep(x, _forward, factor, _backward, factor)
        return x[self.inverse_order]

    def solve_in_order(self, x: NDArray) -> None:
        """Solve in place for x (n, 3) float32: right-hand sides, their rows permuted by `order`."""
        upper = self._slices, self._single
        self._sweep(x, _forward_three, self._lower, _backward_three, upper)

    def _sweep(self, x: NDArray, forward: Any, lower: Any, backward: Any, upper: Any) -> None:
        """Forward pass over the tasks and then over the shared supernodes; backward in reverse."""
        tasks, begin, n = self.plan.tasks, self._begin, len(x)
        last = len(self.plan.starts) - 1
        tails = np.zeros((len(tasks) - 1, n - begin, x.shape[1]), dtype=x.dtype)
        ranges = list(pairwise(tasks.tolist()))
        run_calls(
            forward,
            [(*r, begin, *self._nodes, *lower, x, t) for r, t in zip(ranges, tails, strict=True)],
        )
        x[begin:] += tails.sum(axis=0)
        forward(tasks[-1], last, n, *self._nodes, *lower, x, tails[0])
        backward(tasks[-1], last, *self._nodes, *upper, x)
        run_calls(backward, [(*r, *self._nodes, *upper, x) for r in ranges])
