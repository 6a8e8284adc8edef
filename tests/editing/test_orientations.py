"""Truths of handles with orientations: soft, exact, dragged, and in sequences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deformer import (
    Handle,
    HandleSolver,
    InputError,
    SurfacePoint,
    fit_sequence,
    io,
    local_rotations,
    uncertainty,
)
from deformer.editing.green_functions import HandleBasis
from deformer.editing.orientations import LocalFrame, LocalFrames, turned_by
from deformer.geometry import log_to_rotation
from shapes import large_model, pieces_model, random_rotation, small_model

HANDLES = [4, 60, 110]


@pytest.fixture(scope="module")
def shape(model):
    return model.decode(model.codes[3])


def turned(rotations, seed=0, angle=0.4):
    """Rotations, each turned further by an angle about a random axis."""
    rng = np.random.default_rng(seed)
    return np.stack([random_rotation(rng, angle) @ R for R in rotations])


def distance(a, b):
    return np.linalg.norm(a - b, axis=-1).max()


def test_a_rigid_motion_is_its_rotation(model):
    R = random_rotation(np.random.default_rng(0), 2.5)
    moved = model.reference.vertices @ R.T + [3.0, -2.0, 5.0]
    points = [*HANDLES, SurfacePoint.on_face(model.reference, 40, (0.2, 0.3, 0.5))]
    assert np.allclose(local_rotations(model, points, moved), R, atol=1e-12)


def test_rotations_turn_with_the_shape(model, shape):
    R = random_rotation(np.random.default_rng(1))
    own, other = local_rotations(model, HANDLES, np.stack([shape, shape @ R.T + 1.0]))
    assert np.allclose(other, R @ own, atol=1e-12)
    assert turned_by(own, np.eye(3)).max() > 0.1


def test_stretch_is_no_rotation():
    """An affine map R S of a plane, with a symmetric S in it."""
    rng = np.random.default_rng(2)
    flat = np.column_stack([rng.normal(size=(9, 2)), np.zeros(9)])
    S = np.array([[1.4, 0.3, 0], [0.3, 0.8, 0], [0, 0, 1]])
    R = random_rotation(rng)
    frame = LocalFrame(3, np.arange(9), flat, 0.5)
    assert np.allclose(frame.rotation(flat @ (R @ S).T), R, atol=1e-12)


def energy_by_formula(model, solver, x):
    """Σ w (‖p − q‖² + ½ o l² ‖A − R B‖²) / (σ D)² of handles, and the terms without handles.

    A and B are derivatives of the disc around a handle by its plane's coordinates; l² = σ D².
    """
    energy, D = solver.energy, model.reference.bounding_diagonal
    v, noise = model.reference.vertices, solver.energy.noise
    p = model.decode(energy.code(x)) - model.poisson.centroid - energy.centroid_offset(x)
    p = energy.move(x, p)
    total = 0.0
    for handle in solver.handles:
        disc = list(LocalFrames(model).of(handle.vertex).points[0].vertices)
        around, there = v[disc] - v[disc].mean(axis=0), p[disc] - p[disc].mean(axis=0)
        B = np.linalg.eigh(around.T @ around)[1][:, [2, 1]]
        A = np.linalg.lstsq(around @ B, there, rcond=None)[0].T
        off = ((A - np.array(handle.orientation) @ B) ** 2).sum()
        off *= 0.5 * handle.orientation_weight * noise * D**2
        off += ((p[handle.vertex] - handle.target) ** 2).sum()
        total += handle.weight * off / (noise * D) ** 2
    stiffness, cost = energy.stiffness(x)
    return total + (stiffness * x**2).sum() + cost + (energy.excess_bending(x)[0] ** 2).sum()


@pytest.mark.parametrize("made", [small_model, large_model])
def test_the_energy_and_its_derivative_by_formula(made):
    """Landmarks decide where the descent goes, all vertices what the energy is."""
    model = made()
    solver = HandleSolver(model, noise=0.02)
    goal = model.decode(model.codes[3])
    R = turned(local_rotations(model, HANDLES, goal))
    weights = dict(weights=[1.0, 0.3, 2.0], orientation_weights=[1.0, 4.0, 0.2])
    solver.set_handles(HANDLES, goal[HANDLES] + 0.05, orientations=R, **weights)
    pose = solver.solve()
    assert pose.energy == pytest.approx(energy_by_formula(model, solver, solver.solution), rel=1e-4)
    rng, energy = np.random.default_rng(0), solver.energy
    x = 0.5 * rng.normal(size=energy.size)
    here = solver.basis.exact_positions().at(energy.code(x))
    assert energy.value(x, here.positions) == pytest.approx(
        energy_by_formula(model, solver, x), rel=1e-4
    )
    _, half = energy.normal_equations(x, here)
    for _ in range(3):
        step = 1e-3 * rng.normal(size=energy.size)
        change = energy_by_formula(model, solver, x + step)
        change -= energy_by_formula(model, solver, x - step)
        assert change == pytest.approx(4 * half @ step, rel=2e-3, abs=2e-3 * abs(half).max() * 1e-3)


def test_an_orientation_that_hardly_counts_is_none(model, diagonal, shape):
    R = turned(local_rotations(model, HANDLES, shape), angle=1.5)
    poses = []
    for given in ({}, {"orientations": R, "orientation_weights": [1e-12] * 3}):
        solver = HandleSolver(model)
        solver.set_handles(HANDLES, shape[HANDLES] + 0.03, **given)
        poses.append(solver.solve())
    assert distance(poses[0].vertices, poses[1].vertices) < 1e-4 * diagonal
    assert np.isnan(poses[0].orientation_residual).all()
    assert (poses[1].orientation_residual > 0.5).all()


def test_more_weight_brings_it_closer(model, shape):
    R = turned(local_rotations(model, HANDLES, shape))
    solver, found = HandleSolver(model, noise=0.02), []
    for weight in (0.01, 0.1, 1.0, 10.0):
        solver.set_handles(
            HANDLES, shape[HANDLES], orientations=R, orientation_weights=[weight] * 3
        )
        found.append(np.square(solver.solve().orientation_residual).sum())
    assert found == sorted(found, reverse=True)
    assert found[-1] < 0.9 * found[0]


def test_orientations_tell_more_of_a_shape(model):
    """Two handles with the rotations of a shape are nearer to it than the two handles alone."""
    off = np.zeros(2)
    for z in model.codes[1:8]:
        goal = model.decode(z)
        R = local_rotations(model, [4, 110], goal)
        for n, given in enumerate(({}, {"orientations": R})):
            solver = HandleSolver(model)
            solver.set_handles([4, 110], goal[[4, 110]], **given)
            off[n] += np.square(solver.solve().vertices - goal).sum()
    assert off[1] < 0.5 * off[0]


@pytest.mark.parametrize("kind", ["exact", "pin"])
@pytest.mark.parametrize("angle", [0.4, 2.8])
def test_exact_handles_turn_exactly(model, diagonal, shape, kind, angle):
    points = [4, SurfacePoint.on_face(model.reference, 100, (0.2, 0.3, 0.5)), 110]
    places = np.array([shape[4], shape[list(points[1].vertices)].T @ points[1].weights, shape[110]])
    R = turned(local_rotations(model, points, shape), angle=angle)
    solver = HandleSolver(model)
    solver.set_handles(points, places, kinds=kind, orientations=[R[0], None, R[2]])
    for pose in (solver.solve(), solver.solve(warm=True), solver.relax()):
        own = local_rotations(model, points, pose.vertices)
        assert np.allclose(own[[0, 2]], R[[0, 2]], atol=1e-9)
        assert pose.residual.max() < 1e-9 * diagonal
        assert np.nanmax(pose.orientation_residual) < 1e-7
        assert np.isnan(pose.orientation_residual).tolist() == [False, True, False]


def test_exact_orientations_leave_the_stretch(model, diagonal):
    """A surface that is turned as asked stays as it is, however it is stretched."""
    basis = HandleBasis(model)
    frame = basis.frames.of(60)
    basis.set_points(frame.points)
    exact = basis.exact_handles(frame.points)
    stretch = random_rotation(np.random.default_rng(1)) * [1.3, 0.8, 1.0]
    vertices = model.reference.vertices @ stretch.T
    targets = frame.targets(vertices[60], frame.rotation(vertices))
    index, weights = list(frame.points[0].vertices), [point.weights for point in frame.points]
    assert distance(np.array(weights) @ vertices[index], targets) > 0.001 * diagonal
    moved = vertices.copy()
    exact.correct(moved, targets)
    assert distance(moved, vertices) < 1e-9 * diagonal


def test_the_residual_is_the_angle(model, shape):
    R = turned(local_rotations(model, HANDLES, shape))
    solver = HandleSolver(model)
    solver.set_handles(HANDLES, shape[HANDLES], orientations=R)
    pose = solver.solve()
    own = Rotation.from_matrix(local_rotations(model, HANDLES, pose.vertices))
    expected = (own.inv() * Rotation.from_matrix(R)).magnitude()
    assert np.allclose(pose.orientation_residual, expected, atol=1e-9)
    assert expected.max() > 0.01


def test_exact_handles_off_the_surface_keep_their_distance_beside_turned_ones(
    model, diagonal, shape
):
    marker = SurfacePoint((60,), offset=0.05 * diagonal)
    R = turned(local_rotations(model, [4], shape))
    solver = HandleSolver(model)
    solver.set_handles(
        [4, marker, 110], shape[[4, 60, 110]] + 0.05, hard=True, orientations=[*R, None, None]
    )
    pose = solver.solve()
    assert pose.residual.max() < 1e-9 * diagonal
    assert pose.orientation_residual[0] < 1e-7


def test_one_vertex_with_and_without(model, diagonal, shape):
    """The same vertex twice, once with an orientation: both are met."""
    R = turned(local_rotations(model, [4], shape))
    solver = HandleSolver(model)
    solver.set_handles([4, 4, 110], shape[[4, 4, 110]], hard=True, orientations=[*R, None, None])
    pose = solver.solve()
    assert pose.residual.max() < 1e-9 * diagonal
    assert pose.orientation_residual[0] < 1e-7


def test_everything_turns_together(model, diagonal, shape):
    """Where the body may go anywhere, a motion of all targets moves the pose alone."""
    R = turned(local_rotations(model, HANDLES, shape))
    G, shift = random_rotation(np.random.default_rng(5), 0.7), np.array([0.3, -0.2, 0.1])
    poses = []
    for Q, t in ((np.eye(3), 0.0), (G, shift)):
        centre = model.poisson.centroid
        solver = HandleSolver(model, noise=0.01, freedom=1e4)
        goals = (shape[HANDLES] - centre) @ Q.T + centre + t
        solver.set_handles(HANDLES, goals, hard=True, orientations=Q @ R)
        poses.append((solver.solve().vertices - centre - t) @ Q)
    assert distance(*poses) < 2e-3 * diagonal


def test_a_drag_turns_a_handle(model, diagonal, shape):
    own = local_rotations(model, HANDLES, shape)
    solver = HandleSolver(model)
    solver.set_handles(HANDLES, shape[HANDLES], hard=True, orientations=[*own[:2], None])
    solver.solve()
    goal = turned(own)[0]
    pose = solver.drag(4, shape[4], np.roll(Rotation.from_matrix(goal).as_quat(), 1))
    assert np.allclose(local_rotations(model, [4], pose.vertices)[0], goal, atol=1e-9)
    pose = solver.drag(4, shape[4] + 0.01 * diagonal)
    assert np.allclose(local_rotations(model, [4], pose.vertices)[0], goal, atol=1e-9)
    assert pose.residual.max() < 1e-9 * diagonal
    pose = solver.drag(110, shape[110], goal)
    assert pose.orientation_residual.max() < 1e-7


def test_the_frame_follows_the_noise(model, diagonal, shape):
    R = turned(local_rotations(model, HANDLES, shape))
    changed, fresh = HandleSolver(model, noise=0.002), HandleSolver(model, noise=0.03)
    for solver in (changed, fresh):
        solver.set_handles(HANDLES, shape[HANDLES], orientations=R)
    changed.solve()
    changed.set_prior(noise=0.03)
    assert distance(changed.solve().vertices, fresh.solve().vertices) < 1e-6 * diagonal
    lengths = {point.frame[1] for point in changed.basis.points}
    assert lengths == {point.frame[1] for point in fresh.basis.points}
    assert lengths == {0.03**0.5 * diagonal}


def test_orientations_make_more_certain(model, shape):
    totals = []
    for given in ({}, {"orientations": local_rotations(model, HANDLES, shape)}):
        solver = HandleSolver(model)
        solver.set_handles(HANDLES, shape[HANDLES], **given)
        solver.solve()
        totals.append(np.square(uncertainty(solver).deviation).sum())
    assert totals[1] < totals[0]


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_sequences(model, diagonal, backend):
    if backend == "torch":
        pytest.importorskip("torch")
    shapes = np.stack([model.decode(z) for z in model.codes[:6]])
    R = turned(local_rotations(model, HANDLES, shapes).reshape(-1, 3, 3)).reshape(6, 3, 3, 3)
    R[1, 0] = R[:, 2] = np.nan
    weights = np.ones((6, 3))
    weights[4, 1] = 0
    exact = np.ones((6, 3), dtype=bool)
    exact[5] = False
    given = dict(weights=weights, hard=exact, orientations=R, smoothness=0.1)
    fit = fit_sequence(model, HANDLES, shapes[:, HANDLES], backend=backend, **given)
    own = local_rotations(model, HANDLES, fit.vertices)
    off = np.where(weights > 0, turned_by(own, R), np.nan)
    assert np.allclose(fit.orientation_residual, off, atol=1e-9, equal_nan=True)
    assert np.isnan(off).sum() == 8
    assert np.nanmax(off[:5]) < 1e-7 < 1e-3 < np.nanmax(off[5])
    assert np.nanmax(fit.residual[:5]) < 1e-9 * diagonal
    again = fit_sequence(model, HANDLES, shapes[:, HANDLES], backend="numba", **given)
    assert distance(again.vertices, fit.vertices) < 1e-3 * diagonal
    lists = [[None if np.isnan(r).any() else r.tolist() for r in frame] for frame in R]
    same = fit_sequence(
        model, HANDLES, shapes[:, HANDLES], backend="numba", **{**given, "orientations": lists}
    )
    assert np.array_equal(same.vertices, again.vertices)


def test_frames_without_orientations_are_as_before(model, shape):
    """Orientations that are all missing change nothing."""
    frames = np.stack([shape[HANDLES], model.reference.vertices[HANDLES]])
    plain = fit_sequence(model, HANDLES, frames)
    none = fit_sequence(model, HANDLES, frames, orientations=np.full((2, 3, 4), np.nan))
    assert np.array_equal(plain.vertices, none.vertices)


def test_a_handle_has_its_rotation_as_a_matrix():
    R = log_to_rotation(np.array([0.1, 0.7, -0.3]))
    quaternion = np.roll(Rotation.from_matrix(R).as_quat(), 1)
    for given in (R, R.tolist(), quaternion, (-quaternion).round(3)):
        handle = Handle(3, (0, 0, 0), orientation=given)
        assert np.allclose(handle.orientation, R, atol=1e-3)
        assert handle == Handle(3, (0, 0, 0), orientation=handle.orientation)
    assert Handle(3, (0, 0, 0)).orientation is None


@pytest.mark.parametrize(
    ("given", "parts"),
    [
        ({"orientations": [[1, 0, 0, 0]] * 2}, ["orientations", "list of 3", "2"]),
        ({"orientations": [[2, 0, 0, 0], None, None]}, ["orientations[0]", "length 2"]),
        ({"orientations": [None, None, [1, 0, 0]]}, ["orientations[2]", "(4,) or (3, 3)"]),
        ({"orientations": np.stack([np.diag([1, 1, -1.0])] * 3)}, ["reflection"]),
        ({"orientations": np.ones((3, 3, 3))}, ["orientations[0]", "unit frame"]),
        ({"orientations": [[np.nan, 0, 0, 1], None, None]}, ["orientations[0]", "nan"]),
        ({"orientation_weights": [1, 0, 1]}, ["orientation_weights[1]", "above 0"]),
        ({"orientation_weights": [1, 1e9, 1]}, ["orientation_weights[1]", "10000"]),
        ({"orientation_weights": [1, 1]}, ["orientation_weights", "(3,)"]),
    ],
)
def test_wrong_orientations(model, given, parts):
    solver = HandleSolver(model)
    with pytest.raises(InputError) as caught:
        solver.set_handles(HANDLES, np.zeros((3, 3)), **given)
    for part in parts:
        assert part in str(caught.value)
    assert not solver.handles


def test_files_have_quaternions_or_matrices(tmp_path, model):
    R = log_to_rotation(np.array([0.1, 0.7, -0.3]))
    q = np.roll(Rotation.from_matrix(R).as_quat(), 1)
    row = {"position": [0, 0, 0]}
    rows = [
        {"vertex": 1, **row, "orientation": q.tolist(), "orientation_weight": 0.5},
        {"vertex": 2, **row, "orientation": R.tolist(), "kind": "exact"},
        {"vertex": 3, **row, "orientation": None},
        {"vertex": 4, "position": None, "orientation": q.tolist()},
        {"face": 9, "barycentric": [0.2, 0.3, 0.5], **row, "orientation": (-q).round(4).tolist()},
    ]
    path = tmp_path / "h.json"
    io.write_json(path, {"frames": [rows, []]})
    first, second = io.load_handles(path, 120, model.reference.faces).frames
    assert len(first) == 4 and second == ()
    assert [handle.orientation is None for handle in first] == [False, False, True, False]
    for n in (0, 1, 3):
        assert np.allclose(first[n].orientation, R, atol=1e-3)
    assert [handle.orientation_weight for handle in first] == [0.5, 1, 1, 1]


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ('"orientation": [1, 0, 0]', [".orientation: ", "(4,) or (3, 3)"]),
        ('"orientation": [2, 0, 0, 0]', [".orientation: ", "length 2"]),
        ('"orientation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]', [".orientation: ", "reflection"]),
        ('"orientation": [[1, 1, 0], [0, 1, 0], [0, 0, 1]]', [".orientation: ", "unit frame"]),
        ('"orientation": [[1, 0, 0], [0, 1], [0, 0, 1]]', [".orientation: ", "array of numbers"]),
        ('"orientation": ["a", 0, 0, 1]', [".orientation: ", "numbers"]),
        ('"orientation": [1, null, 0, 0]', [".orientation: ", "numbers"]),
        ('"orientation": [true, false, false, false]', [".orientation: ", "numbers"]),
        ('"orientation": {"w": 1}', [".orientation: ", "numbers"]),
        ('"orientation": 1', [".orientation: ", "(4,) or (3, 3)"]),
        ('"orientation": [1, 0, 0, 0], "offset": 0.1', [".orientation: ", "off the surface"]),
        ('"orientation_weight": 0', [".orientation_weight: ", "above 0"]),
        ('"orientation_weight": 1e9', [".orientation_weight: ", "10000"]),
        ('"rotation": [1, 0, 0, 0]', ["unknown key 'rotation'", "orientation"]),
    ],
)
def test_wrong_files(tmp_path, model, text, parts):
    path = tmp_path / "h.json"
    path.write_text(f'{{"handles": [{{"vertex": 1, "position": [0, 0, 0], {text}}}]}}')
    with pytest.raises(InputError) as caught:
        io.load_handles(path, 120, model.reference.faces)
    message = str(caught.value)
    assert message.startswith(f"{path}: handles[0]") and "\n" not in message
    for part in parts:
        assert part in message


def test_files_name_vertices_without_a_face(tmp_path):
    reference = pieces_model().reference
    V = len(reference.vertices)
    path = tmp_path / "h.json"
    row = {"vertex": V - 1, "position": [0, 0, 0], "orientation": [1, 0, 0, 0]}
    io.write_json(path, {"handles": [row]})
    with pytest.raises(
        InputError, match=rf"handles\[0\]\.orientation: vertex {V - 1} has no faces"
    ):
        io.load_handles(path, V, reference.faces)


def test_points_that_cannot_turn(model):
    off = SurfacePoint((3,), offset=0.1)
    for made, point, text in (
        (model, off, "off the surface"),
        (pieces_model(), len(pieces_model().reference.vertices) - 1, "no surface around it"),
    ):
        solver = HandleSolver(made)
        with pytest.raises(InputError, match=text):
            solver.set_handles([point], np.zeros((1, 3)), orientations=[[1, 0, 0, 0]])
        with pytest.raises(InputError, match=text):
            local_rotations(made, [point], made.reference.vertices)
        assert not solver.handles
        solver.set_handles([5], made.reference.vertices[[5]])
        assert np.isfinite(solver.solve().vertices).all()
