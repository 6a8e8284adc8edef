"""Features of links: where the connected components of a shape are."""

import numpy as np
import pytest

from deformer import extract_features
from deformer.acap.features import FeatureExtractor, extract_all
from deformer.acap.gradients import features_to_gradients
from deformer.acap.poisson import PoissonSystem
from deformer.geometry.mesh import connected_components
from deformer.geometry.rotations import log_to_rotation
from shapes import MESHES, pieces, random_rotation, two_components


def scattered(mesh, seed, size=1.0):
    """The mesh with every component turned and moved on its own."""
    rng = np.random.default_rng(seed)
    labels = connected_components(mesh.faces, len(mesh.vertices))[1]
    p = mesh.vertices.copy()
    for part in (labels == k for k in range(labels.max() + 1)):
        turned = p[part] @ random_rotation(rng).T
        p[part] = turned + size * mesh.bounding_diagonal * rng.normal(size=3)
    return p


def centred(p):
    return p - p.mean(axis=0)


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("seed", range(3))
def test_shapes_come_back_with_their_components_in_place(name, seed):
    mesh = MESHES[name]
    p = scattered(mesh, seed)
    q = FeatureExtractor(mesh).extract_sites(p)
    assert q.shape == (len(p) + len(mesh.links), 9)
    found = PoissonSystem(mesh).reconstruct(q)
    np.testing.assert_allclose(centred(found), centred(p), atol=1e-8 * mesh.bounding_diagonal)


def test_a_sequence_comes_back_too():
    shapes = pieces()
    q = extract_all(FeatureExtractor(shapes.mesh(0)), shapes.vertices, links=True)
    found = PoissonSystem(shapes.mesh(0)).reconstruct(q)
    for p, expected in zip(found, shapes.vertices, strict=True):
        np.testing.assert_allclose(centred(p), centred(expected), atol=1e-8)
    # Features of the vertices alone are the public ones.
    np.testing.assert_array_equal(q[:, : shapes.vertices.shape[1]], extract_features(shapes))


def test_displacements_turn_with_the_body():
    mesh = two_components()
    p = mesh.vertices + np.where(np.arange(len(mesh.vertices))[:, None] < 120, 0.0, [0.3, 0.1, 0.2])
    R = random_rotation(np.random.default_rng(1), 2.0)
    extractor = FeatureExtractor(mesh)
    still, turned = extractor.extract_sites(p)[-1], extractor.extract_sites(p @ R.T + 5.0)[-1]
    np.testing.assert_allclose(turned[3:], still[3:], atol=1e-9)
    np.testing.assert_allclose(log_to_rotation(turned[:3]), R, atol=1e-9)
    # Without a displacement a link has the feature of its neighbour.
    q = extractor.extract_sites(mesh.vertices @ R.T)
    np.testing.assert_allclose(q[-1], q[mesh.links[0, 1]], atol=1e-9)


def test_a_vertex_without_a_face_turns_with_its_neighbour():
    shapes = pieces()
    extractor = FeatureExtractor(shapes.mesh(0))
    last = shapes.vertices.shape[1] - 1
    ((_, neighbour),) = [link for link in shapes.mesh(0).links.tolist() if link[0] == last]
    q = extractor.extract(shapes.vertices[3])
    np.testing.assert_array_equal(q[last, :3], q[neighbour, :3])
    np.testing.assert_array_equal(q[last, 3:], [1, 0, 0, 1, 0, 1])


@pytest.mark.parametrize("angle", [2.5, 3.1, 3.3, 5.0])
def test_components_turn_the_same_way_round(angle):
    """A ball that turns a little further than its tube does not jump to the other way round."""
    mesh = two_components()
    ball = connected_components(mesh.faces, len(mesh.vertices))[1] == 1
    axis = np.array([0.0, 0.6, 0.8])
    p = mesh.vertices @ log_to_rotation(angle * axis).T
    p[ball] = mesh.vertices[ball] @ log_to_rotation((angle + 0.2) * axis).T
    q = FeatureExtractor(mesh).extract(p)
    apart = np.linalg.norm(q[ball, None, :3] - q[None, ~ball, :3], axis=2)
    np.testing.assert_allclose(apart, 0.2, atol=1e-6)
    np.testing.assert_allclose(features_to_gradients(q)[ball][0] @ axis, axis, atol=1e-9)
