"""Noise of example shapes is found and taken off; detail stays."""

import numpy as np
import pytest
import trimesh

import deformer
from deformer.geometry.mesh import MeshSequence, edges
from deformer.network.config import resolve_config
from deformer.training import denoising
from deformer.workspace import Workspace

SEED = 3


def remove_noise(shapes, workspace=None):
    """Positions (N, V, 3) without noise, and the noise."""
    clean, noise = denoising.remove_noise(shapes, workspace or Workspace())
    return clean.vertices, noise


def bent(count, detail=0.0):
    """A ball, drawn long and bent to ever larger angles; detail is along its normals, in edges."""
    ball = trimesh.creation.icosphere(3)
    points = np.array(ball.vertices)
    length = edge_length(points, ball.faces)
    bumps = np.random.default_rng(SEED).normal(size=len(points))
    points = points * (1.0 + detail * length * bumps[:, None])
    shapes = []
    for angle in np.linspace(0.0, 2.0, count):
        x, y, z = (points * [2.0, 1.0, 1.0]).T
        turn = angle * x / 4.0
        shapes.append(np.stack([x - y * np.sin(turn), y * np.cos(turn) + 0.2 * turn * x, z], 1))
    return MeshSequence(np.array(shapes), np.array(ball.faces))


def edge_length(points, faces):
    i, j = edges(faces).T
    return float(np.median(np.linalg.norm(points[i] - points[j], axis=1)))


def with_noise(shapes, share):
    """Noise with a deviation of a share of the median edge, and that deviation."""
    spread = share * edge_length(shapes.vertices[0], shapes.faces)
    noise = np.random.default_rng(SEED + 1).normal(scale=spread, size=shapes.vertices.shape)
    return MeshSequence(shapes.vertices + noise, shapes.faces), spread


def off(truth, estimate):
    return float(np.sqrt(((truth - estimate) ** 2).mean()))


def test_clean_shapes_come_back_as_they_are():
    shapes = bent(8, detail=0.2)
    clean, noise = remove_noise(shapes)
    assert noise == 0.0
    assert clean is shapes.vertices


@pytest.mark.parametrize("share", [0.05, 0.3, 1.0])
def test_noise_is_measured_and_taken_off(share):
    shapes = bent(12)
    noisy, spread = with_noise(shapes, share)
    clean, noise = remove_noise(noisy)
    assert noise == pytest.approx(spread, rel=0.1)
    assert off(shapes.vertices, clean) < 0.4 * spread


def test_detail_that_shapes_share_stays():
    """Bumps as high as the noise, from vertex to vertex as random as noise."""
    smooth, rough = bent(16), bent(16, detail=0.3)
    noisy, spread = with_noise(rough, 0.3)
    clean, noise = remove_noise(noisy)
    assert noise == pytest.approx(spread, rel=0.15)
    assert off(rough.vertices, smooth.vertices) > 0.4 * spread
    assert off(rough.vertices, clean) < 0.5 * spread


def test_too_few_shapes_tell_nothing():
    noisy, _ = with_noise(bent(3), 0.5)
    clean, noise = remove_noise(noisy)
    assert noise == 0.0
    assert clean is noisy.vertices


def test_a_rigid_motion_of_every_shape_does_not_matter():
    noisy, _ = with_noise(bent(6), 0.3)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = noisy.vertices.copy()
    moved[::2] = moved[::2] @ quarter.T + [50.0, 0.0, 0.0]
    expected, noise = remove_noise(noisy)
    found, same = remove_noise(MeshSequence(moved, noisy.faces))
    assert same == pytest.approx(noise, rel=1e-6)
    expected = expected.copy()
    expected[::2] = expected[::2] @ quarter.T + [50.0, 0.0, 0.0]
    assert found == pytest.approx(expected, abs=1e-7)


def test_vertices_of_no_face_stay():
    noisy, _ = with_noise(bent(6), 0.3)
    loose = np.concatenate([noisy.vertices, np.full((6, 1, 3), 7.0)], axis=1)
    clean, _ = remove_noise(MeshSequence(loose, noisy.faces))
    assert clean[:, -1] == pytest.approx(np.full((6, 3), 7.0))
    assert off(noisy.vertices, clean[:, :-1]) > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("reference", [0, 3, 11])
def test_training_learns_from_clean_shapes(reference):
    """Also where the undeformed shape, here the last, is not trained on."""
    shapes = bent(12)
    noisy, spread = with_noise(shapes, 0.3)
    split = {"train": list(range(10)), "test": []}
    model = deformer.train(noisy, 4, epochs=5, split=split, reference=reference)
    share = model.summary["noise"] * model.reference.bounding_diagonal
    assert share == pytest.approx(spread, rel=0.1)
    assert off(shapes.vertices[reference], model.reference.vertices) < 0.5 * spread
    assert off(shapes.vertices[:10], model.decode(model.codes)) < spread


def test_the_papers_configuration_learns_from_what_it_is_given():
    noisy, _ = with_noise(bent(6), 0.3)
    config = resolve_config("paper", components=2, epochs=2)
    model = deformer.train(noisy, config=config)
    assert model.summary["noise"] == 0.0
    assert np.array_equal(model.reference.vertices, noisy.vertices[0])
