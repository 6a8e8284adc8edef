"""Nodes, and the vertices that follow them."""

import numpy as np
import pytest

from deformer.acap.poisson import PoissonSystem
from deformer.editing.arap import DecodedSurface
from deformer.editing.lifted_surface import LiftedSurface
from deformer.editing.nodes import Nodes
from deformer.geometry.mesh import Mesh
from shapes import MESHES, icosphere, join, random_rotation, strip

BALL = icosphere(3)
SHAPES = {**MESHES, "ball": BALL}


class Constant:
    """A decoder of n sites that has the same feature everywhere."""

    pointwise = False
    components = 2
    gain, offset = np.ones(9), np.zeros(9)

    def __init__(self, count, feature):
        self.q = np.tile(feature, (count, 1))

    def single_features(self, z):
        return self.q


def nodes_of(mesh, share=5):
    return Nodes.of(PoissonSystem(mesh), len(mesh.vertices) // share)


@pytest.mark.parametrize("name", ["tube", "sphere", "components", "ball"])
def test_weights_are_shares_of_nodes_of_the_same_component(name):
    mesh = SHAPES[name]
    nodes = nodes_of(mesh)
    assert np.all(nodes.weights >= 0)
    np.testing.assert_allclose(nodes.weights.sum(axis=1), 1.0, atol=1e-6)
    labels = mesh.labels
    followed = labels[nodes.vertices[nodes.influences]]
    assert np.all((followed == labels[:, None]) | (nodes.weights == 0))
    assert set(labels[nodes.vertices]) == set(labels)
    assert set(mesh.links.ravel()) <= set(nodes.vertices)
    np.testing.assert_array_equal(nodes.vertices[nodes.system.reference.links], mesh.links)


def test_a_small_mesh_has_no_nodes():
    assert Nodes.of(PoissonSystem(BALL)) is None


def test_many_small_components_have_no_nodes():
    """Each would need a node of its own."""
    triangle = Mesh(np.eye(3), np.array([[0, 1, 2]]))
    apart = [Mesh(triangle.vertices + 3.0 * n, triangle.faces) for n in range(60)]
    assert Nodes.of(PoissonSystem(join(*apart)), 30) is None


def test_vertices_do_not_follow_nodes_across_a_gap():
    """Of a strip folded in two, so that its halves are nearer than the nodes are."""
    flat = strip(121, 9, 6.0, 0.4)
    x, y, _ = flat.vertices.T
    far = np.maximum(np.abs(x - 3.0) - 0.05, 0.0)
    side = 0.01 * np.clip((x - 3.0) / 0.05, -1, 1)
    mesh = Mesh(np.column_stack([far, y, side]), flat.faces)
    nodes = nodes_of(mesh, 20)
    along = np.abs(x[nodes.vertices][nodes.influences] - x[:, None])
    assert along[nodes.weights > 0].max() < 1.0


@pytest.mark.parametrize("name", ["tube", "sphere", "components", "ball"])
def test_an_affine_map_is_exact(name):
    """Constant gradients: nodes are where the map takes them, and vertices follow exactly."""
    mesh = SHAPES[name]
    system = PoissonSystem(mesh)
    nodes = nodes_of(mesh)
    V, n, B = len(mesh.vertices), len(nodes.vertices), len(mesh.links)
    S = np.array([[1.2, 0.1, 0.0], [0.1, 0.9, -0.2], [0.0, -0.2, 1.1]])
    feature = np.append([0.4, -0.8, 0.3], S[np.triu_indices(3)])
    surface = DecodedSurface(Constant(V + B, feature), system)
    lifted = LiftedSurface(surface, nodes, Constant(n + B, feature))
    found = []
    coefficients = system.position_coefficients(system.green_rows([1, V // 2, V - 1]))
    R, origin = random_rotation(np.random.default_rng(1), 1.0), np.array([1.0, 2.0, 3.0])
    for one in (surface, lifted):
        one.set_handles_by_block([one.block_coefficients(a) for a in coefficients])
        positions = one.decode(np.zeros(2))
        one.solve()
        one.move_to_targets(np.zeros((0, 3)))
        found.append(np.concatenate([one.positions(R, origin), positions]))
    np.testing.assert_allclose(*found, atol=1e-5 * mesh.bounding_diagonal)
