"""Truths of models of meshes with seams: whole inside, all vertices of the file outside."""

import numpy as np
import pytest

import deformer
from deformer import HandleSolver, MeshSequence, SurfacePoint, load_model, train
from settings import QUICK_ADAM
from shapes import sequence

OPTIONS = {"config": deformer.ModelConfig("quick", 4, QUICK_ADAM), "device": "cpu"}
# Copies of these vertices come last, in the faces with even numbers.
CHOSEN = [*range(48, 56), 3, 90]


def cut(shapes):
    V = shapes.vertices.shape[1]
    vertices = np.concatenate([shapes.vertices, shapes.vertices[:, CHOSEN]], axis=1)
    faces = shapes.faces.copy()
    for n, v in enumerate(CHOSEN):
        faces[::2][faces[::2] == v] = V + n
    return MeshSequence(vertices, faces)


@pytest.fixture(scope="module")
def models():
    """A model of shapes with seams, and the one inside it."""
    model = train(cut(sequence(8)), **OPTIONS)
    return model, model.closed


@pytest.fixture(scope="module")
def closed(models):
    return models[0].seams.closed


def test_it_learns_what_it_would_without_seams(models):
    whole = train(sequence(8), **OPTIONS)
    np.testing.assert_array_equal(whole.reference.faces, models[1].reference.faces)
    np.testing.assert_array_equal(whole.reference.vertices, models[1].reference.vertices)
    np.testing.assert_allclose(whole.codes, models[1].codes, atol=1e-3)


def test_shapes_come_back_in_the_order_of_the_file(models, closed):
    model, whole = models
    shapes = cut(sequence(8))
    z = model.encode(shapes.vertices)
    np.testing.assert_array_equal(z, whole.encode(sequence(8).vertices))
    np.testing.assert_array_equal(model.decode(z), whole.decode(z)[:, closed])
    np.testing.assert_array_equal(model.decode(z[2]), whole.decode(z[2])[closed])
    np.testing.assert_array_equal(model.reference.faces, shapes.faces)
    np.testing.assert_array_equal(model.fit(shapes.vertices[3]), whole.fit(sequence(8).vertices[3]))
    with pytest.raises(deformer.InputError, match=r"130"):
        model.encode(sequence(8).vertices)


def test_saved_models_have_their_seams(models, tmp_path):
    models[0].save(tmp_path / "model")
    loaded = load_model(tmp_path / "model")
    np.testing.assert_array_equal(loaded.seams.closed, models[0].seams.closed)
    assert loaded.fingerprint == models[0].fingerprint
    codes = models[0].codes
    np.testing.assert_array_equal(loaded.decode(codes), models[0].decode(codes))


@pytest.mark.parametrize("hard", [False, True])
def test_handles_may_name_any_vertex(models, closed, hard):
    model, whole = models
    target = sequence(8).vertices[5]
    vertices = [120, 129, 3 + 60, 10]
    solvers = HandleSolver(model), HandleSolver(whole)
    poses = []
    for solver, index in zip(solvers, (vertices, closed[vertices]), strict=True):
        solver.set_handles(index, target[closed[vertices]], hard=hard)
        solver.solve()
        poses.append(solver.drag(int(index[0]), target[closed[120]] + 0.05))
    assert [handle.vertex for handle in solvers[0].handles] == vertices
    np.testing.assert_allclose(poses[0].vertices, poses[1].vertices[closed], atol=1e-9)
    np.testing.assert_allclose(poses[0].residual, poses[1].residual, atol=1e-9)
    found = deformer.uncertainty(solvers[0])
    expected = deformer.uncertainty(solvers[1])
    np.testing.assert_allclose(found.deviation, expected.deviation[closed], rtol=1e-6)
    np.testing.assert_allclose(found.gain, expected.gain[closed], atol=1e-9)


def test_two_handles_at_one_place_are_one(models, closed):
    """At the mean of their targets, as one vertex that is given twice."""
    model, whole = models
    p = model.reference.vertices
    solver, other = HandleSolver(model), HandleSolver(whole)
    targets = p[[48, 120, 10]] + [[0, 0.1, 0], [0, 0.3, 0], [0, 0, 0]]
    solver.set_handles([48, 120, 10], targets, hard=True)
    other.set_handles([48, 48, 10], targets, hard=True)
    np.testing.assert_allclose(solver.solve().vertices, other.solve().vertices[closed], atol=1e-6)


def test_exact_handles_that_contradict_each_other_are_told(models, caplog):
    model, p = models[0], models[0].reference.vertices
    solver = HandleSolver(model)
    solver.set_handles([48, 120], p[[48, 120]], hard=True)
    solver.set_handles([48, 120], p[[48, 120]] + [[0, 0, 0], [0, 0.2, 0]])
    assert not caplog.records
    for _ in range(2):
        solver.set_handles([48, 120], p[[48, 120]] + [[0, 0, 0], [0, 0.2, 0]], hard=True)
    (record,) = caplog.records
    assert "48 and 120, are one point" in record.message and "0.2 apart" in record.message


def test_orientations_and_points_of_the_surface(models, closed):
    model, whole = models
    shape = cut(sequence(8)).vertices[6]
    points = [121, SurfacePoint((120, 121, 10), (0.25, 0.25, 0.5))]
    own = [int(closed[121]), SurfacePoint((int(closed[120]), int(closed[121]), 10), (1, 1, 2))]
    R = deformer.local_rotations(model, points, shape)
    expected = deformer.local_rotations(whole, own, shape[:120])
    np.testing.assert_allclose(R, expected, atol=1e-12)
    targets = shape[[121, 10]]
    poses = []
    for each, places in ((model, points), (whole, own)):
        solver = HandleSolver(each)
        solver.set_handles(places, targets, orientations=R)
        poses.append(solver.solve())
    np.testing.assert_allclose(poses[0].vertices, poses[1].vertices[closed], atol=1e-9)


def test_sequences_of_handles(models, closed):
    model, whole = models
    frames = cut(sequence(8)).vertices[2:6]
    vertices = [120, 10, 90]
    found = deformer.fit_sequence(model, vertices, frames[:, vertices])
    expected = deformer.fit_sequence(whole, closed[vertices], frames[:, vertices])
    np.testing.assert_allclose(found.vertices, expected.vertices[:, closed], atol=1e-9)
    with pytest.raises(deformer.InputError, match="vertex 48 is given twice"):
        deformer.fit_sequence(model, [48, 120], frames[:, [48, 120]])


def test_layouts_name_one_of_the_vertices_at_a_place(models, closed):
    model, whole = models
    found, expected = deformer.layout(model, [3, 6]), deformer.layout(whole, [3, 6])
    np.testing.assert_array_equal(found.vertices, expected.vertices)
    np.testing.assert_allclose(found.deviation, expected.deviation[closed])
    np.testing.assert_array_equal(found.region, expected.region[closed])
    fixed = deformer.layout(model, 4, fixed=[125], exclude=[48])
    assert fixed.vertices[0] == 125 and not {48, 120} & set(fixed.vertices.tolist())
    for options in ({"fixed": [48], "exclude": [120]}, {"fixed": [48, 120]}):
        with pytest.raises(deformer.InputError, match="fixed: vertex"):
            deformer.layout(model, 4, **options)


def test_components_and_new_shapes(models, closed):
    model, whole = models
    own, other = deformer.ComponentAnalysis(model), deformer.ComponentAnalysis(whole)
    for k in range(4):
        support = other.activations.support(k)
        np.testing.assert_array_equal(own.activations.support(k), support[closed])
        assert own.describe(k).extent == pytest.approx(other.describe(k).extent)
        assert closed[own.describe(k).centre] == other.describe(k).centre
    for space in ("latent", "features", "linear"):
        shape = deformer.Synthesis(whole).shape({0: 0.7}, space)
        found = deformer.Synthesis(model).shape({0: 0.7}, space)
        np.testing.assert_allclose(found, shape[closed], atol=1e-12)
        keys = cut(sequence(8)).vertices[[1, 5]]
        path = deformer.interpolate(model, keys, 3, space).vertices
        np.testing.assert_array_equal(path[:, 120:], path[:, CHOSEN])
        assert np.abs(path.mean(axis=1)[[0, -1]] - keys.mean(axis=1)).max() < 1e-12
    np.testing.assert_allclose(
        deformer.transfer(model, model, model.codes[4]),
        deformer.transfer(whole, whole, model.codes[4])[closed],
        atol=1e-12,
    )


def test_distances_go_across_seams(models, closed):
    np.testing.assert_array_equal(models[0].distances(125), models[1].distances(53)[closed])
