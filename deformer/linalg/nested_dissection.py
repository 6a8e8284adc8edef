"""Nested dissection: an order of elimination that keeps a sparse factor small and parallel.

A mesh is cut in two by a plane through its median, the vertices along the cut (the separator) are
eliminated last, and both halves are cut again (George 1973). Each piece that is left, and each
separator, becomes one supernode: consecutive columns of the factor with one set of rows below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from deformer.geometry import FloatArray, IntArray

# Pieces of at most this many vertices are not cut further: their dense blocks cost about what the
# bookkeeping of smaller ones would.
_LEAF = 32


@njit(cache=True)
def _cut(part, indptr, indices, key, side):
    """Sort part by key and split it at the median: side 1 and 2. Boundary sizes of both sides."""
    ranked = part[np.argsort(key[part])]
    half = len(ranked) // 2
    for k in range(len(ranked)):
        side[ranked[k]] = 1 if k < half else 2
    first = second = 0
    for i in ranked:
        other = 3 - side[i]
        for e in range(indptr[i], indptr[i + 1]):
            if side[indices[e]] == other:
                if other == 2:
                    first += 1
                else:
                    second += 1
                break
    return ranked, first, second


@njit(cache=True)
def _breadth_first(part, indptr, indices, side, key):
    """Number part along its edges, from one end to the other: a key where points are no help."""
    queue = part.copy()
    end = part[0]
    for _ in range(2):
        side[part] = 1
        head = tail = 0
        for k in range(-1, len(part)):
            start = part[k] if k >= 0 else end
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
        end = queue[-1]
    for k in range(len(part)):
        key[queue[k]] = k


@njit(cache=True)
def _dissect(indptr, indices, points, leaf, depth):
    """Order (n,) and its supernodes (start, stop, task), by start.

    Pieces that are left after `depth` cuts are numbered as tasks; the separators of those cuts
    belong to none, −1.
    """
    n = len(indptr) - 1
    order = np.arange(n)
    side = np.zeros(n, dtype=np.int8)
    key = np.empty(n)
    tasks = 0
    nodes = [(0, 0, 0) for _ in range(0)]
    stack = [(0, n, 0, -1)]
    while len(stack):
        lo, hi, level, task = stack.pop()
        size = hi - lo
        if size == 0:
            continue
        if task < 0 and (level == depth or size <= leaf):
            task, tasks = tasks, tasks + 1
        if size <= leaf:
            nodes.append((lo, hi, task))
            continue
        part = order[lo:hi].copy()
        best, axis = n + 1, 0
        for a in range(points.shape[1]):
            _, first, second = _cut(part, indptr, indices, points[:, a], side)
            if min(first, second) < best:
                best, axis = min(first, second), a
        if 3 * best > size:
            # No plane separates it, as where a mesh is shrunk to a point: by its edges alone.
            side[part] = 0
            _breadth_first(part, indptr, indices, side, key)
            ranked, first, second = _cut(part, indptr, indices, key, side)
        else:
            ranked, first, second = _cut(part, indptr, indices, points[:, axis], side)
        if 3 * min(first, second) > size:
            # Everything touches everything: a dense block.
            side[part] = 0
            if task < 0:
                task, tasks = tasks, tasks + 1
            nodes.append((lo, hi, task))
            continue
        mine = 1 if first <= second else 2
        for i in ranked:
            if side[i] == mine:
                for e in range(indptr[i], indptr[i + 1]):
                    if side[indices[e]] == 3 - mine:
                        side[i] = 3
                        break
        place = lo
        bounds = np.empty(4, dtype=np.int64)
        for value in range(1, 4):
            bounds[value - 1] = place
            for i in ranked:
                if side[i] == value:
                    order[place] = i
                    place += 1
        side[part] = 0
        if bounds[2] < hi:
            nodes.append((bounds[2], hi, task))
        stack.append((bounds[0], bounds[1], level + 1, task))
        stack.append((bounds[1], bounds[2], level + 1, task))
    return order, np.array(nodes)


@njit(cache=True)
def _boundaries(indptr, indices, place, order, starts):
    """Rows below every supernode (bounds, rows) and the supernode that takes its update."""
    n, N = len(order), len(starts) - 1
    owner = np.empty(n, dtype=np.int64)
    for s in range(N):
        owner[starts[s] : starts[s + 1]] = s
    mark = np.full(n, -1)
    head, following, parent = np.full(N, -1), np.full(N, -1), np.full(N, -1)
    bounds = np.zeros(N + 1, dtype=np.int64)
    rows = np.empty(8 * n, dtype=np.int32)
    top = 0
    for s in range(N):
        hi = starts[s + 1]
        begin = top
        if top + n > len(rows):
            longer = np.empty(2 * len(rows) + n, dtype=np.int32)
            longer[:top] = rows[:top]
            rows = longer
        for k in range(starts[s], hi):
            for e in range(indptr[order[k]], indptr[order[k] + 1]):
                j = place[indices[e]]
                if j >= hi and mark[j] != s:
                    mark[j] = s
                    rows[top] = j
                    top += 1
        child = head[s]
        while child >= 0:
            for e in range(bounds[child], bounds[child + 1]):
                j = rows[e]
                if j >= hi and mark[j] != s:
                    mark[j] = s
                    rows[top] = j
                    top += 1
            child = following[child]
        rows[begin:top].sort()
        bounds[s + 1] = top
        if top > begin:
            parent[s] = owner[rows[begin]]
            following[s] = head[parent[s]]
            head[parent[s]] = s
    return bounds, rows[:top].copy(), parent


@dataclass(frozen=True, eq=False)
class Dissection:
    """Supernodes of a symmetric sparse matrix.

    Args:
        indptr, indices: where the matrix has entries, its rows compressed.
        order: (n,) the old index at every place of the elimination.
        place: (n,) its inverse.
        starts: (N + 1,) supernode s holds the places starts[s]…starts[s + 1] − 1.
        bounds: (N + 1,) slices of `rows`.
        rows: places below each supernode, sorted.
        parent: (N,) the supernode that takes the update of s; −1 for none.
        tasks: (P + 1,) supernodes tasks[t]…tasks[t + 1] − 1 do not depend on another task's; those
            from tasks[P] on come after all of them.
    """

    indptr: IntArray
    indices: IntArray
    order: IntArray
    place: IntArray
    starts: IntArray
    bounds: IntArray
    rows: NDArray[np.int32]
    parent: IntArray
    tasks: IntArray

    def suits(self, indptr: IntArray, indices: IntArray) -> bool:
        """Whether a matrix has its entries in the very same places."""
        return np.array_equal(indptr, self.indptr) and np.array_equal(indices, self.indices)


def dissect(indptr: IntArray, indices: IntArray, points: FloatArray, depth: int) -> Dissection:
    """Nested dissection of the graph of a symmetric matrix whose rows are points in space.

    Args:
        indptr, indices: its rows, compressed.
        points: (n, 3).
        depth: 2^depth parts are kept apart as tasks, where the mesh is large enough.
    """
    order, nodes = _dissect(indptr, indices, points, _LEAF, depth)
    # The separators between tasks come last.
    last = nodes[:, 2].max() + 1
    rank = np.where(nodes[:, 2] < 0, last, nodes[:, 2])
    nodes, rank = (array[np.lexsort((nodes[:, 0], rank))] for array in (nodes, rank))
    order = np.concatenate([order[lo:hi] for lo, hi, _ in nodes])
    starts = np.concatenate([[0], np.cumsum(nodes[:, 1] - nodes[:, 0])])
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    bounds, rows, parent = _boundaries(indptr, indices, place, order, starts)
    tasks = np.searchsorted(rank, np.arange(last + 1))
    return Dissection(indptr, indices, order, place, starts, bounds, rows, parent, tasks)
