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


# The compiled functions here run once a model. They are written as plain loops: sorting, lists and
# assignments between arrays would each take longer to compile than all of these loops.


@njit(cache=True)
def _halve(ranked, row, lo, hi, indptr, indices, side):
    """Split ranked[row, lo:hi] at its median into side 1 and 2; boundary sizes of both sides."""
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


@njit(cache=True)
def _breadth_first(ranked, row, lo, hi, indptr, indices, side, queue):
    """Rank a piece along its edges, from one end to the other, where points are no help."""
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


@njit(cache=True)
def _dissect(indptr, indices, ranked, leaf, depth, nodes):
    """Order, the last row of `ranked`, and its supernodes (start, stop, task); their number.

    The first rows of `ranked` (4, n) are the vertices sorted by x, y and z. Pieces that are left
    after `depth` cuts are numbered as tasks; the separators of those cuts belong to none, −1.
    """
    n = len(indptr) - 1
    chosen = len(ranked) - 1
    side = np.zeros(n, dtype=np.int8)
    spare = np.empty(n, dtype=np.int64)
    place = np.empty(5, dtype=np.int64)
    # Pieces (start, stop, level, task) that wait: two a level at most, and halves are halved.
    stack = np.empty((256, 4), dtype=np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, n, 0, -1
    waiting, tasks, found = 1, 0, 0
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
                # No plane separates it, as where a mesh is shrunk to a point: by its edges alone.
                _breadth_first(ranked, chosen, lo, hi, indptr, indices, side, spare)
            else:
                for k in range(lo, hi):
                    ranked[chosen, k] = ranked[axis, k]
            first, second = _halve(ranked, chosen, lo, hi, indptr, indices, side)
            if 3 * min(first, second) > size:
                # Everything touches everything: a dense block.
                dense = True
                if task < 0:
                    task, tasks = tasks, tasks + 1
        if dense:
            nodes[found, 0], nodes[found, 1], nodes[found, 2] = lo, hi, task
            found += 1
            for k in range(lo, hi):
                side[ranked[chosen, k]] = 0
            continue
        # The separator, side 3: the smaller of the two boundaries.
        mine = 1 if first <= second else 2
        for k in range(lo, hi):
            i = ranked[chosen, k]
            if side[i] == mine:
                for e in range(indptr[i], indptr[i + 1]):
                    if side[indices[e]] == 3 - mine:
                        side[i] = 3
                        break
        for d in range(5):
            place[d] = 0
        for k in range(lo, hi):
            place[side[ranked[chosen, k]] + 1] += 1
        second_start = lo + place[2]
        separator = second_start + place[3]
        # Every row is sorted by side, and otherwise stays in order.
        for a in range(len(ranked)):
            place[1], place[2], place[3] = lo, second_start, separator
            for k in range(lo, hi):
                i = ranked[a, k]
                spare[place[side[i]]] = i
                place[side[i]] += 1
            for k in range(lo, hi):
                ranked[a, k] = spare[k]
        for k in range(lo, hi):
            side[ranked[chosen, k]] = 0
        if separator < hi:
            nodes[found, 0], nodes[found, 1], nodes[found, 2] = separator, hi, task
            found += 1
        for half in range(2):
            stack[waiting, 0] = lo if half == 0 else second_start
            stack[waiting, 1] = second_start if half == 0 else separator
            stack[waiting, 2], stack[waiting, 3] = level + 1, task
            waiting += 1
    return found


@njit(cache=True)
def _boundaries(indptr, indices, place, order, starts, owner, mark, links, bounds):
    """Rows below every supernode, unsorted; into `bounds` (N + 1,) their slices.

    Into the last row of `links` (3, N), −1 at first, the supernode that takes each one's update.
    `owner` (n,) is the supernode of every place, `mark` (n,) −1.
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
                j = place[indices[e]]
                if j >= hi and mark[j] != s:
                    mark[j] = s
                    rows[top] = j
                    top += 1
                    nearest = min(nearest, j)
        child = links[0, s]
        while child >= 0:
            for e in range(bounds[child], bounds[child + 1]):
                j = rows[e]
                if j >= hi and mark[j] != s:
                    mark[j] = s
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
    place = np.empty_like(order)
    place[order] = np.arange(n)
    owner = np.repeat(np.arange(len(nodes)), sizes)
    links = np.full((3, len(nodes)), -1)
    bounds = np.empty(len(nodes) + 1, dtype=np.int64)
    unsorted = _boundaries(
        indptr, indices, place, order, starts, owner, np.full(n, -1), links, bounds
    )
    # Sorted within each supernode: one sort of supernode and row together.
    first_key = n * np.repeat(np.arange(len(nodes)), np.diff(bounds))
    rows = (np.sort(first_key + unsorted) - first_key).astype(np.int32)
    tasks = np.searchsorted(rank, np.arange(last + 1))
    return Dissection(indptr, indices, order, place, starts, bounds, rows, links[2], tasks)
