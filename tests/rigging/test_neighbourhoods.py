"""Truths of what a bone may move, of what lies astray, of rigid parts and of the skeleton."""

import numpy as np
import pytest

from deformer.rigging.clusters import RIGID, one_hot, rigid_parts, worst_patch
from deformer.rigging.neighbourhoods import (
    averaging,
    connected_labels,
    gathered,
    main_part,
    stray_share,
    surface_graph,
    within_reach,
)
from deformer.rigging.skeleton import skeleton_of
from shapes import MESHES, random_rotation, tube, two_components

AROUND, RINGS = 8, 15  # of tube(), ring by ring
RING = np.repeat(np.arange(RINGS), AROUND)


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_graph_connects_all_and_has_the_lengths_of_edges(mesh):
    graph = surface_graph(mesh, 2.0)
    assert abs(graph - graph.T).max() == 0
    a, b = mesh.faces[0, :2]
    length = np.linalg.norm(mesh.vertices[a] - mesh.vertices[b])
    assert graph[a, b] == pytest.approx(0.5 * length, abs=1e-300)
    assert main_part(graph, np.ones(len(mesh.vertices))).all()


def test_means_are_those_of_a_vertex_and_its_neighbours():
    mean = averaging(surface_graph(tube()))
    x = np.random.default_rng(0).normal(size=120)
    neighbours = np.unique(tube().faces[(tube().faces == 60).any(axis=1)])
    assert (mean @ x)[60] == pytest.approx(x[neighbours].mean())


def test_what_is_not_connected_to_the_heaviest_part_is_astray():
    graph = surface_graph(tube())
    ends = np.where(RING < 5, 1.0, np.where(RING >= 12, 0.5, 0.0))
    weights = np.column_stack([ends, 1.0 - ends])
    # The last three rings are not connected to the first five: half a vertex each of 24 of 120.
    assert stray_share(graph, weights) == pytest.approx(12 / 120)
    kept = gathered(graph, weights)
    assert stray_share(graph, kept) == 0.0
    np.testing.assert_allclose(kept[:, 0], RING < 5)
    np.testing.assert_allclose(kept.sum(axis=1), 1.0)


def test_a_vertex_of_which_nothing_is_left_joins_its_neighbours():
    graph = surface_graph(tube())
    labels = np.where(RING < 7, 0, 1)
    labels[RING == 13] = 0
    kept = gathered(graph, one_hot(labels))
    np.testing.assert_array_equal(kept.argmax(axis=1), np.where(RING < 7, 0, 1))
    np.testing.assert_array_equal(connected_labels(graph, labels), np.where(RING < 7, 0, 1))


def test_bones_reach_as_far_as_said_along_the_surface():
    graph = surface_graph(tube())  # rings 1/7 apart
    near = within_reach(graph, np.where(RING < 7, 0, 1), 3, 2.5 / 7)
    np.testing.assert_array_equal(near, np.column_stack([RING < 9, RING >= 5, RING < 0]))


def two_parts(mesh, split):
    """Shapes (V, N, 3) of two halves that move rigidly, each by its own."""
    rng = np.random.default_rng(3)
    shapes = np.empty((len(mesh.vertices), 6, 3))
    for part in (split, ~split):
        for n in range(6):
            shapes[part, n] = mesh.vertices[part] @ random_rotation(rng, 1.0).T + rng.normal(size=3)
    return shapes


def test_rigid_parts_are_found_and_no_more_than_there_are():
    told = []
    mesh, split = tube(), RING < 6
    parts = rigid_parts(
        surface_graph(mesh), mesh.vertices, two_parts(mesh, split), 9, 4, told.append
    )
    assert parts.max() == 1
    np.testing.assert_array_equal(parts == parts[0], split)
    assert told == [1, 2]


def test_parts_are_connected_over_links_between_pieces():
    mesh = two_components()
    tube_part = mesh.labels == mesh.labels[0]
    parts = rigid_parts(
        surface_graph(mesh), mesh.vertices, two_parts(mesh, tube_part), 5, 4, lambda _: None
    )
    np.testing.assert_array_equal(parts == parts[0], tube_part)


def test_the_worst_patch_lies_around_the_largest_error():
    graph = surface_graph(tube())
    errors = np.zeros(120)
    assert worst_patch(graph, errors + 0.9 * RIGID**2, 4, 3) is None
    errors[40] = 1.0
    patch = worst_patch(graph, errors, 4, 3)
    assert patch is not None and len(patch) == 10 and patch[0] == 40
    assert main_part(graph, np.isin(np.arange(120), patch).astype(float)).sum() == 10


def chain(angles):
    """Weights, rest shape and transforms of four bones along a tube, each turned at its start.

    Bones that are no neighbours share some vertices, too, and no joint is in the middle of them.
    """
    mesh = tube(rings=41)
    rest = mesh.vertices
    starts = np.array([0.0, 0.5, 1.0, 1.5])
    x = rest[:, 0]
    blend = np.clip((x[:, None] - starts[1:]) / 0.8 + 0.3, 0, 1)
    full = np.column_stack([np.ones(len(x)), blend])
    w = full - np.column_stack([blend, np.zeros(len(x))])
    T = np.empty((len(angles), 4, 3, 4))
    for n, pose in enumerate(angles):
        M = np.eye(4)
        for b in range(4):
            joint = np.array([starts[b], 0.0, 0.0])
            turn = random_rotation(np.random.default_rng(10 * n + b), pose[b])
            step = np.eye(4)
            step[:3, :3], step[:3, 3] = turn, joint - turn @ joint
            M = M @ step
            T[n, b] = M[:3]
    return w, rest, T, starts


def test_the_skeleton_of_a_chain_is_the_chain_with_its_joints():
    w, rest, T, starts = chain(np.random.default_rng(0).uniform(0.3, 1.0, size=(12, 4)))
    found = skeleton_of(w, rest, T)
    bone = found.order
    pairs = {frozenset((bone[n], bone[found.parents[n]])) for n in range(1, 4)}
    assert pairs == {frozenset((b, b + 1)) for b in range(3)}
    assert bone[0] in (1, 2)  # the root is in the middle
    assert found.parents[0] == -1 and (found.parents[1:] < np.arange(1, 4)).all()
    for n in range(1, 4):
        upper = max(bone[n], bone[found.parents[n]])
        np.testing.assert_allclose(found.joints[n], [starts[upper], 0, 0], atol=2e-2)
    assert found.gaps.max() < 2e-2


def test_bones_without_a_vertex_in_common_are_joined_to_the_nearest():
    w = np.repeat(np.eye(3), [3, 3, 3], axis=0)
    rest = np.column_stack([[0, 1, 2, 10, 11, 12, 14, 15, 16], np.zeros(9), np.arange(9) % 2])
    T = np.tile(np.eye(4)[:3], (2, 3, 1, 1))
    found = skeleton_of(w, rest.astype(float), T)
    assert found.order[0] == 1
    assert set(found.order[1:]) == {0, 2} and (found.parents[1:] == 0).all()
