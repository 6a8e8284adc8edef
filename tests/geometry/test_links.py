"""Links between connected components: the minimum spanning tree, found by Prim's algorithm."""

import numpy as np
import pytest
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import cdist

from deformer.geometry.links import spanning_links
from deformer.geometry.mesh import Mesh, site_rings
from shapes import awkward, pieces, tube


def scattered(components, seed):
    """Clouds of 1 to 12 points; labels count from 0 in the order of first points."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 13, components)
    labels = np.repeat(np.arange(components), sizes)
    centres = rng.normal(size=(components, 3))
    return centres[labels] + 0.2 * rng.normal(size=(len(labels), 3)), labels


@pytest.mark.parametrize(("components", "seed"), [(2, 0), (7, 1), (40, 2), (150, 3)])
def test_the_links_are_a_minimum_spanning_tree(components, seed):
    v, labels = scattered(components, seed)
    links = spanning_links(v, labels)
    apart = cdist(v, v)
    between = np.zeros((components, components))
    for a in range(components):
        for b in range(a):
            between[a, b] = apart[np.ix_(labels == a, labels == b)].min()
    lengths = np.linalg.norm(v[links[:, 0]] - v[links[:, 1]], axis=1)
    assert lengths.sum() == pytest.approx(minimum_spanning_tree(between).sum())


@pytest.mark.parametrize("seed", range(3))
def test_parents_come_first_and_the_largest_component_is_the_root(seed):
    v, labels = scattered(25, seed)
    reached = {int(np.bincount(labels).argmax())}
    for child, parent in labels[spanning_links(v, labels)].tolist():
        assert parent in reached and child not in reached
        reached.add(child)
    assert len(reached) == 25


def test_components_that_touch_have_a_link_without_length():
    v = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 0], [5, 0, 0.0]])
    links = spanning_links(v, np.array([0, 0, 0, 1, 2]))
    assert links.tolist() == [[3, 1], [4, 2]]


def test_a_mesh_of_one_component_has_none():
    assert tube().links.shape == (0, 2)
    assert len(site_rings(tube())[0]) == len(tube().vertices) + 1


def test_links_are_sites_after_the_vertices():
    mesh = awkward()
    V = len(mesh.vertices)
    indptr, rings = site_rings(mesh)
    assert len(mesh.links) == 2 and len(indptr) == V + 3
    for b, link in enumerate(mesh.links):
        np.testing.assert_array_equal(rings[indptr[V + b] : indptr[V + b + 1]], link)


def test_the_unit_changes_nothing():
    mesh = pieces().mesh(3)
    for unit in (1e-6, 1e6):
        np.testing.assert_array_equal(Mesh(unit * mesh.vertices, mesh.faces).links, mesh.links)
