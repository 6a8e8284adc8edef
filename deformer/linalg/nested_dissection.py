"""Nested dissection: an order of elimination that keeps a sparse factor small and parallel.

A mesh is cut in two by a plane through its median, the vertices along the cut (the separator) are
eliminated last, and both halves are cut again (George 1973). Each piece that is not cut further,
and each separator, becomes a supernode: consecutive columns of the factor with the same rows below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deformer.compilation import called_with, njit
from deformer.geometry import FloatArray, IntArray

# Pieces of at most this many vertices are not cut further: their dense blocks cost about as much as
# the bookkeeping of smaller ones.
_LEAF = 32


# The compiled functions of this module run once a model. They are plain loops: sorting, lists and
# assignments between arrays would each take longer to compile than all of these loops.


@njit()
def _halve(ranked, row, lo, hi, indptr, indices, side):
    """Split ranked[row, lo:hi] at its median into sides 1 and 2; returns their boundary sizes."""
    half = lo + (hi - lo) // 2
    for k in range(lo, hi):
        side[ranked[row, k]] = 1 if k < half else 2
    first = second = 0
    for k in range(lo, hi):
        i = ranked[row, k]
        for e in range(indptr[i], indptr[i + 1]):
            if side[indices[e]] == 3 - side[i]:
                if k < half:
                    first += 1
                else:
                    second += 1
                break
    return first, second


@njit()
def _breadth_first(ranked, row, lo, hi, indptr, indices, side, queue):
    """Rank a piece along its edges, from one end to the other, if no plane separates its points."""
    end = ranked[row, lo]
    for _ in range(2):
        for k in range(lo, hi):
            side[ranked[row, k]] = 1
        head = tail = lo
        for k in range(lo - 1, hi):
            start = ranked[row, k] if k >= lo else end
            if side[start] == 1:
                side[start] = 0
                queue[tail] = start
                tail += 1
            while head < tail:
                i = queue[head]
                head += 1
                for e in range(indptr[i], indptr[i + 1]):
                    j = indices[e]
                    if side[j] == 1:
                        side[j] = 0
                        queue[tail] = j
                        tail += 1
        end = queue[hi - 1]
    for k in range(lo, hi):
        ranked[row, k] = queue[k]


@called_with("i8(i8[::1], i8[::1], i8[:, ::1], i8, i8, i8[:, ::1])")
@njit()
def _dissect(indptr, indices, ranked, leaf, depth, nodes):
    """Order of elimination and its supernodes; returns their number.

    `ranked` (4, n) has the vertices sorted by x, y and z in its first rows; its last row becomes
    the order. `nodes` (n, 3) gets start, stop and task of each supernode. The pieces after `depth`
    cuts are numbered as tasks; the separators of these cuts have the task −1.
    """
    n = len(indptr) - 1
    chosen = len(ranked) - 1
    side = np.zeros(n, dtype=np.int8)
    spare = np.empty(n, dtype=np.int64)
    cursor = np.empty(5, dtype=np.int64)
    # Pieces (start, stop, level, task) still to be cut: at most two a level.
    stack = np.empty((256, 4), dtype=np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, n, 0, -1
    waiting, tasks, node_count = 1, 0, 0
    while waiting > 0:
        waiting -= 1
        lo, hi = stack[waiting, 0], stack[waiting, 1]
        level, task = stack[waiting, 2], stack[waiting, 3]
        size = hi - lo
        if size == 0:
            continue
        if task < 0 and (level == depth or size <= leaf):
            task, tasks = tasks, tasks + 1
        dense = size <= leaf
        first = second = 0
        if not dense:
            best, axis = n + 1, 0
            for a in range(chosen):
                first, second = _halve(ranked, a, lo, hi, indptr, indices, side)
                if min(first, second) < best:
                    best, axis = min(first, second), a
            for k in range(lo, hi):
                side[ranked[axis, k]] = 0
            if 3 * best > size:
                # No plane separates the piece (a mesh may be shrunk to a point): use its edges.
                _breadth_first(ranked, chosen, lo, hi, indptr, indices, side, spare)
            else:
                for k in range(lo, hi):
                    ranked[chosen, k] = ranked[axis, k]
            first, second = _halve(ranked, chosen, lo, hi, indptr, indices, side)
            if 3 * min(first, second) > size:
                # Most vertices are connected with each other: a dense block.
                dense = True
                if task < 0:
                    task, tasks = tasks, tasks + 1
        if dense:
            nodes[node_count, 0], nodes[node_count, 1], nodes[node_count, 2] = lo, hi, task
            node_count += 1
            for k in range(lo, hi):
                side[ranked[chosen, k]] = 0
            continue
        # The separator, side 3: the smaller of the two boundaries.
        separated = 1 if first <= second else 2
        for k in range(lo, hi):
            i = ranked[chosen, k]
            if side[i] == separated:
                for e in range(indptr[i], indptr[i + 1]):
                    if side[indices[e]] == 3 - separated:
                        side[i] = 3
                        break
        for d in range(5):
            cursor[d] = 0
        for k in range(lo, hi):
            cursor[side[ranked[chosen, k]] + 1] += 1
        second_start = lo + cursor[2]
        separator = second_start + cursor[3]
        # Every row is sorted by side, and otherwise stays in order.
        for a in range(len(ranked)):
            cursor[1], cursor[2], cursor[3] = lo, second_start, separator
            for k in range(lo, hi):
                i = ranked[a, k]
                spare[cursor[side[i]]] = i
                cursor[side[i]] += 1
            for k in range(lo, hi):
                ranked[a, k] = spare[k]
        for k in range(lo, hi):
            side[ranked[chosen, k]] = 0
        if separator < hi:
            nodes[node_count, 0], nodes[node_count, 1], nodes[node_count, 2] = separator, hi, task
            node_count += 1
        for half in range(2):
            stack[waiting, 0] = lo if half == 0 else second_start
            stack[waiting, 1] = second_start if half == 0 else separator
            stack[waiting, 2], stack[waiting, 3] = level + 1, task
            waiting += 1
    return node_count


@called_with(
    "i4[::1](i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[:, ::1], i8[::1])"
)
@njit()
def _boundaries(indptr, indices, inverse_order, order, starts, owner, visitor, links, bounds):
    """Rows below every supernode, unsorted.

    `bounds` (N + 1,) gets their slices, and the last row of `links` (3, N), −1 at first, the parent
    of each supernode, which its update is added to. `owner` (n,) is the supernode of every column
    in the order of elimination; `visitor` (n,), −1 at first, is work memory.
    """
    n, N = len(order), len(starts) - 1
    rows = np.empty(8 * n, dtype=np.int32)
    top = 0
    bounds[0] = 0
    for s in range(N):
        hi = starts[s + 1]
        if top + n > len(rows):
            longer = np.empty(2 * len(rows) + n, dtype=np.int32)
            for k in range(top):
                longer[k] = rows[k]
            rows = longer
        nearest = n
        for k in range(starts[s], hi):
            for e in range(indptr[order[k]], indptr[order[k] + 1]):
                j = inverse_order[indices[e]]
                if j >= hi and visitor[j] != s:
                    visitor[j] = s
                    rows[top] = j
                    top += 1
                    nearest = min(nearest, j)
        child = links[0, s]
        while child >= 0:
            for e in range(bounds[child], bounds[child + 1]):
                j = rows[e]
                if j >= hi and visitor[j] != s:
                    visitor[j] = s
                    rows[top] = j
                    top += 1
                    nearest = min(nearest, j)
            child = links[1, child]
        bounds[s + 1] = top
        if nearest < n:
            parent = owner[nearest]
            links[2, s] = parent
            links[1, s] = links[0, parent]
            links[0, parent] = s
    return rows[:top]


@dataclass(frozen=True, eq=False)
class Dissection:
    """Supernodes of a symmetric sparse matrix.

    Args:
        indptr, indices: (n + 1,) and (m,) int64, the matrix's entries in compressed rows.
        order: (n,) int64 permutation: the matrix's row that is eliminated k-th, for every k.
        inverse_order: (n,) int64 inverse of `order`: when each row is eliminated.
        starts: (N + 1,) int64: columns starts[s]…starts[s + 1] − 1, in the order of elimination,
            are supernode s.
        bounds: (N + 1,) int64 slices of `rows`.
        rows: int32 rows below each supernode, in the order of elimination, sorted.
        parent: (N,) int64 the supernode that the update of s is added to; −1 for none.
        tasks: (P + 1,) int64: supernodes tasks[t]…tasks[t + 1] − 1 do not depend on another
            task's; those from tasks[P] on are eliminated after all tasks.
    """

    indptr: IntArray
    indices: IntArray
    order: IntArray
    inverse_order: IntArray
    starts: IntArray
    bounds: IntArray
    rows: NDArray[np.int32]
    parent: IntArray
    tasks: IntArray

    def matches(self, indptr: IntArray, indices: IntArray) -> bool:
        """True if a matrix of compressed rows (indptr, indices) has the same sparsity pattern."""
        return np.array_equal(indptr, self.indptr) and np.array_equal(indices, self.indices)


def dissect(indptr: IntArray, indices: IntArray, points: FloatArray, depth: int) -> Dissection:
    """Nested dissection of the graph of a symmetric matrix whose rows are points in space.

    Args:
        indptr, indices: (n + 1,) and (m,) int64, the matrix's entries in compressed rows.
        points: (n, 3), any unit.
        depth: number of cuts that make tasks: up to 2^depth tasks.
    """
    n = len(indptr) - 1
    by_axis = [np.argsort(points[:, axis], kind="stable") for axis in range(3)]
    ranked = np.array([*by_axis, np.arange(n)], dtype=np.int64)
    nodes: IntArray = np.empty((n, 3), dtype=np.int64)
    nodes = nodes[: _dissect(indptr, indices, ranked, _LEAF, depth, nodes)]
    order = ranked[-1]
    # The separators between tasks come last.
    last = nodes[:, 2].max() + 1
    rank = np.where(nodes[:, 2] < 0, last, nodes[:, 2])
    nodes, rank = (array[np.lexsort((nodes[:, 0], rank))] for array in (nodes, rank))
    order = np.concatenate([order[lo:hi] for lo, hi, _ in nodes])
    sizes = nodes[:, 1] - nodes[:, 0]
    starts = np.concatenate([[0], np.cumsum(sizes)])
    inverse_order = np.empty_like(order)
    inverse_order[order] = np.arange(n)
    owner = np.repeat(np.arange(len(nodes)), sizes)
    links = np.full((3, len(nodes)), -1)
    bounds = np.empty(len(nodes) + 1, dtype=np.int64)
    unsorted = _boundaries(
        indptr, indices, inverse_order, order, starts, owner, np.full(n, -1), links, bounds
    )
    # Sorted within each supernode: one sort of supernode and row together.
    first_key = n * np.repeat(np.arange(len(nodes)), np.diff(bounds))
    rows = (np.sort(first_key + unsorted) - first_key).astype(np.int32)
    tasks = np.searchsorted(rank, np.arange(last + 1))
    return Dissection(indptr, indices, order, inverse_order, starts, bounds, rows, links[2], tasks)
