"""Meshes of several connected components: where the pieces are is learned with the code."""

import numpy as np
import pytest

from deformer import HandleSolver, MeshSequence, fit_sequence, load_model, train
from deformer.geometry.mesh import connected_components
from deformer.training.mirroring import find_mirror
from distances import largest
from shapes import join, pieces, pieces_model, sequence, tube

pytestmark = pytest.mark.filterwarnings("error")
TUBE, BALL, POINT = slice(0, 120), slice(120, 162), 162


@pytest.fixture(scope="module")
def model():
    return pieces_model()


def centred(p):
    return p - p.mean(axis=-2, keepdims=True)


def test_training_shapes_come_back_with_their_pieces_in_place(model, diagonal):
    """Nothing of the tube says where the ball is: the code does."""
    shapes = pieces().vertices
    ball = shapes[:, BALL].mean(axis=1)
    assert largest(ball - ball.mean(axis=0)) > 0.1 * diagonal
    found = centred(model.decode(model.encode(shapes)))
    assert largest(found - centred(shapes)) < 0.005 * diagonal


def test_a_code_is_a_pose_of_the_solver(model, diagonal):
    """The solver's single-precision surface, against decoding in double precision."""
    solver = HandleSolver(model)
    solver.set_handles([5], [[0, 0, 0]])
    for z in model.codes[::3]:
        pose = solver.restore(z, np.zeros(3), np.zeros(3))
        assert largest(pose.vertices - model.decode(z)) < 2e-4 * diagonal


@pytest.mark.parametrize("hard", [True, False])
def test_a_handle_on_a_piece_moves_the_piece(model, diagonal, hard):
    """Handles at the two ends of the tube and one on the ball recover an example."""
    shapes = pieces().vertices
    vertices = [0, 60, 119, 130, 140]
    solver = HandleSolver(model, noise=0.001)
    for shape in shapes[[2, 5, 9]]:
        solver.set_handles(vertices, shape[vertices], hard=hard)
        pose = solver.solve()
        assert largest(pose.vertices - shape) < 0.05 * diagonal
        if hard:
            assert largest(pose.vertices[vertices] - shape[vertices]) < 1e-9 * diagonal


def test_the_jacobian_of_a_handle_on_a_piece(model):
    """By central differences, of the positions by all vertices and by landmarks."""
    solver = HandleSolver(model)
    solver.set_handles([3, 150, POINT], np.zeros((3, 3)))
    z, step = model.codes[4], 1e-3 * np.eye(model.components)
    positions = [solver.basis.exact_positions(), solver.basis.landmark_positions()]
    for here in positions:
        ends = [(here.at(z + s).positions, here.at(z - s).positions) for s in step]
        expected = np.stack([(a - b) / 2e-3 for a, b in ends], axis=-1)
        found = here.at(z).derivative()
        assert np.abs(found - expected).max() < 2e-3 * np.abs(expected).max()


def test_a_sequence_follows_the_pieces(model, diagonal):
    shapes = pieces().vertices
    vertices = np.array([0, 30, 60, 90, 119, 120, 130, 140, 150])
    found = fit_sequence(model, vertices, shapes[:, vertices], smoothness=0.0, noise=0.001)
    assert largest(found.vertices - shapes) < 0.05 * diagonal


def test_it_is_kept_with_the_model(model, tmp_path):
    model.save(tmp_path / "model")
    again = load_model(tmp_path / "model")
    z = model.codes[3]
    np.testing.assert_allclose(again.decode(z), model.decode(z), atol=1e-12)


def test_mirror_images_mirror_where_the_pieces_are():
    """Two tubes side by side, of which one moves: in the image it is the other one."""
    shapes, gap = sequence(6), np.array([0.0, 0.0, 1.0])
    both = join(tube(), tube())
    lift = 0.3 * np.sin(np.arange(6))[:, None, None] * [0, 1, 0]
    vertices = np.concatenate(
        [shapes.vertices[:1] * np.ones((6, 1, 1)) - gap, lift + tube().vertices + gap], 1
    )
    mirror, plane = find_mirror(MeshSequence(vertices, both.faces))
    images = mirror.images(vertices)
    expected = plane.mirror(vertices[:, plane.opposite])
    assert largest(images - expected) < 1e-6


@pytest.mark.parametrize(("count", "components"), [(97, None), (200, 8)])
def test_many_pieces_train_and_fit(count, components):
    """More pieces than a mesh has sample vertices for its bend limits: each a triangle.

    Their motion is a wave of two dimensions: few components say where hundreds of pieces are.
    """
    rng = np.random.default_rng(0)
    places = 3.0 * rng.normal(size=(count, 1, 3))
    corners = np.array([[0.0, 0, 0], [0.3, 0, 0], [0, 0.3, 0]])
    swing = np.sin(places[:, :, :1] + np.linspace(0, 5, 6)[:, None, None, None])
    vertices = (places + corners + swing * [0, 0, 0.6]).reshape(6, -1, 3)
    shapes = MeshSequence(vertices, np.arange(3 * count).reshape(-1, 3))
    assert connected_components(shapes.faces, 3 * count)[0] == count
    model = train(shapes, components=components)
    size = model.reference.bounding_diagonal
    found = model.decode(model.encode(vertices))
    assert largest(centred(found) - centred(vertices)) < 0.005 * size
    solver = HandleSolver(model, noise=0.001)
    chosen = np.arange(0, 3 * count, 31)
    solver.set_handles(chosen, vertices[4][chosen])
    assert largest(solver.solve().vertices - vertices[4]) < 0.05 * size


@pytest.mark.slow
def test_the_network_of_the_paper_knows_the_pieces_too():
    shapes = pieces()
    model = train(shapes, components=8, config="paper", device="cpu")
    found, true = model.decode(model.fit(shapes.vertices)), shapes.vertices
    ball, tubes = ([p[:, part].mean(axis=1) for p in (found, true)] for part in (BALL, TUBE))
    # Where the ball is from the tube, against a ball that does not slide.
    apart, expected = (b - t for b, t in zip(ball, tubes, strict=True))
    spread = np.linalg.norm(expected - expected.mean(axis=0), axis=1)
    error = np.linalg.norm(apart - expected, axis=1)
    assert (error**2).mean() < 0.25 * (spread**2).mean()
