"""Truths of handles on faces and off the surface: soft, exact, dragged, in sequences and files."""

import numpy as np
import pytest

from deformer import HandleSolver, InputError, PoissonSystem, SurfacePoint, fit_sequence, io
from deformer.acap import FeatureExtractor, features_to_gradients
from deformer.editing.green_functions import HandleBasis
from deformer.geometry import SurfacePoints
from distances import largest
from shapes import bend, random_rotation


@pytest.fixture(scope="module")
def points(model):
    """Vertices, points of faces, and both off the surface, spread over the tube."""
    D, faces = model.reference.bounding_diagonal, model.reference.faces
    rng = np.random.default_rng(3)
    on = [
        SurfacePoint.on_face(faces, f, rng.dirichlet(np.ones(3)), offset)
        for f, offset in ((10, 0), (70, 0.03 * D), (140, 0), (200, -0.02 * D))
    ]
    return [4, *on, SurfacePoint((100,), offset=0.05 * D), 60]


def at(model, points, vertices):
    return SurfacePoints(points, model.reference.faces).at(vertices)


def positions(basis, T):
    """Handle positions by their coefficients, relative to the centroid."""
    return np.einsum("iab,hib->ha", T, basis.coefficients())


def test_coefficients_turn_normals_exactly_with_a_rigid_motion(model, points):
    basis, reference = HandleBasis(model), model.reference
    basis.set_points(points)
    R = random_rotation(np.random.default_rng(0))
    rest = at(model, points, reference.vertices) - model.poisson.centroid
    sites = len(reference.vertices) + len(reference.links)
    assert np.allclose(positions(basis, np.tile(R, (sites, 1, 1))), rest @ R.T, atol=1e-9)


@pytest.mark.parametrize("angle", [0.5, 1.5])
def test_coefficients_follow_a_bend(model, points, diagonal, angle):
    """Σ T a against the bent mesh: what differs is at most a twentieth of the offset."""
    basis, reference = HandleBasis(model), model.reference
    basis.set_points(points)
    bent = bend(reference.vertices, angle)
    q = FeatureExtractor(reference).extract(bent)
    shape = PoissonSystem(reference).reconstruct(q[: len(bent)])
    found = positions(basis, features_to_gradients(q))
    expected = at(model, points, shape) - model.poisson.centroid
    offsets = [getattr(point, "offset", 0.0) for point in points]
    assert (np.linalg.norm(found - expected, axis=1) <= 0.05 * np.abs(offsets) + 1e-6).all()


@pytest.mark.parametrize("kind", ["exact", "pin"])
def test_exact_handles_are_on_their_targets(model, points, diagonal, kind):
    rng = np.random.default_rng(1)
    targets = at(model, points, model.decode(model.codes[3]))
    targets += 0.02 * diagonal * rng.normal(size=targets.shape)
    solver = HandleSolver(model)
    solver.set_handles(points, targets, kinds=kind)
    for pose in (solver.solve(), solver.solve(warm=True), solver.relax()):
        assert largest(at(model, points, pose.vertices) - targets) < 1e-9 * diagonal
        assert pose.residual.max() < 1e-9 * diagonal


def test_soft_handles_recover_a_training_shape(model, points, diagonal):
    shape = model.decode(model.codes[3])
    targets = at(model, points, shape)
    solver = HandleSolver(model, noise=0.001)
    solver.set_handles(points, targets)
    pose = solver.solve()
    assert np.allclose(
        pose.residual, np.linalg.norm(at(model, points, pose.vertices) - targets, axis=1)
    )
    plain = HandleSolver(model, noise=0.001)
    vertices = [p if isinstance(p, int) else p.vertices[0] for p in points]
    plain.set_handles(vertices, shape[vertices])
    assert largest(pose.vertices - shape) < 1.5 * largest(plain.solve().vertices - shape) + 1e-3


def test_a_corner_is_its_vertex(model):
    faces, targets = model.reference.faces, model.decode(model.codes[2])
    chosen = [10, 80, 150]
    corners = faces[chosen, 2]
    one, other = HandleSolver(model), HandleSolver(model)
    one.set_handles(corners, targets[corners], hard=True)
    other.set_handles(
        [SurfacePoint.on_face(faces, f, (0, 0, 1)) for f in chosen], targets[corners], hard=True
    )
    assert np.array_equal(one.solve().vertices, other.solve().vertices)
    assert [handle.vertex for handle in other.handles] == corners.tolist()


def test_a_drag_moves_a_point_and_leaves_pins(model, points, diagonal):
    rest = at(model, points, model.reference.vertices)
    kinds = ["pin", "exact", "exact", "soft", "soft", "exact", "pin"]
    solver = HandleSolver(model)
    solver.set_handles(points, rest, kinds=kinds)
    solver.solve()
    assert [handle.kind for handle in solver.handles] == kinds
    goal = rest[5] + 0.1 * diagonal * np.array([0, 0.6, 0.8])
    for s in np.linspace(0, 1, 5)[1:]:
        pose = solver.drag(points[5], (1 - s) * rest[5] + s * goal)
    exact = np.array([kind != "soft" for kind in kinds])
    targets = np.vstack([rest[:5], goal[None], rest[6:]])
    off = at(model, points, pose.vertices) - targets
    assert largest(off[exact]) < 1e-9 * diagonal
    with pytest.raises(InputError, match="pin"):
        solver.drag(4, goal)
    with pytest.raises(InputError, match="has no handle"):
        solver.drag(SurfacePoint((4,), offset=0.1), goal)


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_sequences(model, points, diagonal, backend):
    if backend == "torch":
        pytest.importorskip("torch")
    shapes = np.stack([model.decode(z) for z in model.codes[:6]])
    targets = at(model, points, shapes)
    exact = np.zeros((6, len(points)), dtype=bool)
    exact[:, 1::2], exact[2] = True, False
    fit = fit_sequence(model, points, targets, hard=exact, smoothness=0.1, backend=backend)
    off = np.linalg.norm(at(model, points, fit.vertices) - targets, axis=2)
    assert np.allclose(fit.residual, off, atol=1e-12)
    assert off[exact].max() < 1e-9 * diagonal
    assert off[~exact].max() > 1e-6 * diagonal
    again = fit_sequence(model, points, targets, hard=exact, smoothness=0.1, backend="numba")
    assert largest(again.vertices - fit.vertices) < 1e-3 * diagonal


def test_wrong_kinds(model):
    solver = HandleSolver(model)
    for given in ({"kinds": "hard"}, {"kinds": ["soft"]}, {"kinds": "pin", "hard": True}):
        with pytest.raises(InputError, match="kinds"):
            solver.set_handles([1, 2], np.zeros((2, 3)), **given)


def test_files_name_points_and_kinds(tmp_path, model):
    path = tmp_path / "h.json"
    faces = model.reference.faces
    path.write_text(
        '{"handles": [{"vertex": 3, "offset": 0.5, "kind": "pin", "position": [1, 2, 3]}, '
        '{"face": 9, "barycentric": [0.2, 0.3, 0.5], "offset": -1, "position": [0, 0, 0]}, '
        '{"face": 9, "barycentric": [0, 0, 1], "kind": "exact", "position": [0, 0, 0]}]}'
    )
    (frame,) = io.load_handles(path, 120, faces).frames
    assert [handle.vertex for handle in frame] == [
        SurfacePoint((3,), offset=0.5),
        SurfacePoint.on_face(faces, 9, (0.2, 0.3, 0.5), -1.0),
        int(faces[9, 2]),
    ]
    assert [handle.kind for handle in frame] == ["pin", "soft", "exact"]
    with pytest.raises(InputError, match="no faces"):
        io.load_handles(path, 120)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ('"face": 1, "barycentric": [1, 1, 0]', ["handles[0]", "barycentric", "sum of 1"]),
        ('"face": 999, "barycentric": [1, 0, 0]', ["handles[0].face", "999"]),
        ('"face": 1', ["handles[0]", "'barycentric'"]),
        ('"face": 1, "vertex": 2, "barycentric": [1, 0, 0]', ["unknown key 'vertex'"]),
        ('"vertex": 1, "barycentric": [1, 0, 0]', ["unknown key 'barycentric'"]),
        ('"vertex": 1, "offset": null', ["handles[0].offset", "None"]),
        ('"vertex": 1, "kind": "hard"', ["handles[0].kind", "hard", "exact"]),
    ],
)
def test_wrong_files(tmp_path, model, text, parts):
    path = tmp_path / "h.json"
    path.write_text(f'{{"handles": [{{{text}, "position": [0, 0, 0]}}]}}')
    with pytest.raises(InputError) as caught:
        io.load_handles(path, 120, model.reference.faces)
    for part in parts:
        assert part in str(caught.value)
