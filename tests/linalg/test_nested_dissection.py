"""Truths of nested dissection: a permutation, its fill, and parts that do not touch."""

import numpy as np
import pytest
from scipy import sparse

from deformer.geometry.mesh import edges
from deformer.linalg.nested_dissection import dissect
from graphs import GRAPHS, NAMES, definite
from shapes import tube

DEPTHS = pytest.mark.parametrize("depth", [0, 1, 3])


def dissected(name, depth=0):
    A = definite(name)
    return dissect(A.indptr.astype(np.int64), A.indices.astype(np.int64), GRAPHS[name][2], depth)


def rows_below(plan):
    """Rows below each supernode."""
    return np.split(plan.rows, plan.bounds[1:-1])


def task_of_columns(plan):
    """The task of every column in the order of elimination; −1 for those that tasks share."""
    counts = np.diff(plan.starts)
    tasks = len(plan.tasks) - 1
    of_nodes = np.repeat(np.arange(tasks), np.diff(plan.tasks))
    return np.repeat(np.append(of_nodes, np.full(len(counts) - len(of_nodes), -1)), counts)


@NAMES
@DEPTHS
def test_order_is_a_permutation_cut_into_supernodes(name, depth):
    n = GRAPHS[name][0]
    plan = dissected(name, depth)
    np.testing.assert_array_equal(np.sort(plan.order), np.arange(n))
    np.testing.assert_array_equal(plan.order[plan.inverse_order], np.arange(n))
    assert plan.starts[0] == 0 and plan.starts[-1] == n and (np.diff(plan.starts) > 0).all()
    assert len(plan.bounds) == len(plan.starts) == len(plan.parent) + 1
    assert plan.bounds[0] == 0 and plan.bounds[-1] == len(plan.rows)


@NAMES
@DEPTHS
def test_rows_below_are_the_fill_of_eliminating_supernodes(name, depth):
    """Eliminated together, its columns leave all their later neighbours joined to each other."""
    plan = dissected(name, depth)
    filled = definite(name).toarray()[np.ix_(plan.order, plan.order)] != 0
    owner = np.repeat(np.arange(len(plan.parent)), np.diff(plan.starts))
    for s, below in enumerate(rows_below(plan)):
        lo, hi = plan.starts[s], plan.starts[s + 1]
        expected = hi + np.flatnonzero(filled[lo:hi, hi:].any(axis=0))
        np.testing.assert_array_equal(below, expected)
        filled[np.ix_(expected, expected)] = True
        # The update goes to where the first of them is eliminated, hence later.
        assert plan.parent[s] == (owner[expected[0]] if len(expected) else -1)
        assert plan.parent[s] > s or len(expected) == 0


@NAMES
def test_the_factor_has_no_entry_outside_the_blocks(name):
    plan = dissected(name, 2)
    L = np.linalg.cholesky(definite(name).toarray()[np.ix_(plan.order, plan.order)])
    for s, below in enumerate(rows_below(plan)):
        columns = slice(plan.starts[s], plan.starts[s + 1])
        L[columns, columns] = 0
        L[below, columns] = 0
    assert not L.any()


@NAMES
@DEPTHS
def test_tasks_touch_only_what_they_share(name, depth):
    plan = dissected(name, depth)
    tasks = len(plan.tasks) - 1
    assert 1 <= tasks <= 2**depth
    assert plan.tasks[0] == 0 and plan.tasks[-1] <= len(plan.parent)
    assert (np.diff(plan.tasks) > 0).all()
    if depth == 0:
        assert plan.tasks.tolist() == [0, len(plan.parent)]
    task = task_of_columns(plan)
    i, j = plan.inverse_order[GRAPHS[name][1]].T
    assert ((task[i] == task[j]) | (task[i] < 0) | (task[j] < 0)).all()
    # Nor do their updates.
    for s, below in enumerate(rows_below(plan)):
        assert np.isin(task[below], [task[plan.starts[s]], -1]).all()


@pytest.mark.parametrize("name", ["ball", "two", "path", "star", "no edges", "coincident"])
def test_tasks_are_of_like_size(name):
    for depth in (1, 2):
        task = task_of_columns(dissected(name, depth))
        sizes = np.bincount(task[task >= 0])
        assert len(sizes) == 2**depth
        assert sizes.min() > 0.5 * len(task) / 2**depth


@pytest.mark.parametrize("name", ["ball", "two", "path", "star", "coincident", "scattered"])
def test_the_factor_stays_sparse(name):
    """Even where the points say nothing of who touches whom."""
    plan = dissected(name)
    width, below = np.diff(plan.starts), np.diff(plan.bounds)
    assert width.max() < 4 * np.sqrt(len(plan.order))
    assert (width * (width + below)).sum() < 0.25 * len(plan.order) ** 2


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_tube_is_cut_across(axis):
    """Rings of 8 separate it, along whichever axis it lies; pieces are of at most 32."""
    mesh = tube(8, 60)
    n, pairs = len(mesh.vertices), edges(mesh.faces)
    A = sparse.coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(n, n))
    A = sparse.csr_array(A + A.T)
    points = np.roll(mesh.vertices, axis, axis=1)
    plan = dissect(A.indptr.astype(np.int64), A.indices.astype(np.int64), points, 0)
    assert np.diff(plan.starts).max() <= 32 and np.diff(plan.bounds).max() <= 32


def test_rows_outgrow_the_room_that_they_had_at_first():
    plan = dissected("hubs")
    assert len(plan.rows) > 8 * len(plan.order)


def test_a_complete_graph_is_one_block():
    assert len(dissected("complete", 3).parent) == 1


def test_the_middle_of_a_path_is_eliminated_last():
    """One vertex cuts it in two halves, at each depth."""
    plan = dissected("path", 2)
    tail = plan.starts[plan.tasks[-1] :]
    position = GRAPHS["path"][2][plan.order[tail[:-1]], 0]
    assert np.diff(tail).tolist() == [1, 1, 1]
    np.testing.assert_allclose(position[-1], 250, atol=2)
    np.testing.assert_allclose(np.sort(position), [125, 250, 375], atol=4)
