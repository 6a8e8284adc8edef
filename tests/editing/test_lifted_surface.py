"""Drags of large meshes, which are solved for nodes while handles move."""

from dataclasses import replace

import numpy as np
import pytest

from deformer import Floor, HandleSolver, SurfacePoint, load_model, solve_to_rest
from deformer.editing import lifted_surface
from deformer.editing.nodes import Nodes
from misfits import MISFIT
from refined import refined
from shapes import pieces_model, random_rotation, small_model

COUNT = 400


def pair(model, monkeypatch, **options):
    """A solver by nodes, and one of the same model without."""
    of = Nodes.of
    monkeypatch.setattr(Nodes, "of", lambda system: of(system, COUNT))
    by_nodes = HandleSolver(model, **options)
    assert by_nodes.basis.moving is not by_nodes.basis.surface
    monkeypatch.setattr(Nodes, "of", lambda system: None)
    by_all = HandleSolver(model, **options)
    assert by_all.basis.moving is by_all.basis.surface
    return by_nodes, by_all


@pytest.fixture(scope="module")
def tube():
    return refined(small_model(), 2)


@pytest.fixture(scope="module")
def pieces():
    return refined(pieces_model(), 2)


@pytest.fixture(scope="module")
def flag():
    return load_model("flag")


@pytest.fixture
def model(request):
    return request.getfixturevalue(request.param)


MODELS = pytest.mark.parametrize("model", ["tube", "pieces", "flag"], indirect=True)
TUBE = pytest.mark.parametrize("model", ["tube"], indirect=True)


def path(model, count, seed=0, frames=6):
    """Vertices (count,), and their targets (frames, count, 3) from one example past another."""
    rng = np.random.default_rng(seed)
    a, b = (model.decode(z) for z in model.codes[rng.choice(len(model.codes), 2, replace=False)])
    handles = rng.choice(len(a), count, replace=False)
    off = 0.03 * model.reference.bounding_diagonal * rng.normal(size=(count, 3))
    t = np.linspace(0, 1, frames)[:, None, None]
    return handles, (1 - t) * a[handles] + t * (b[handles] + off)


def apart(model, one, other):
    """Largest distance of vertices, in bounding diagonals."""
    return np.linalg.norm(one - other, axis=1).max() / model.reference.bounding_diagonal


def drags(solvers, handles, targets, **options):
    """Poses (frames, solvers) of the same drag with each solver."""
    for solver in solvers:
        solver.set_handles(handles, targets[0], **options)
        solver.solve()
    for goal in targets[1:]:
        for solver in solvers:
            solver.set_handles(handles, goal, **options)
        yield [solver.solve(warm=True) for solver in solvers]


def error(model, pose, by_all):
    """Distance of a frame to the surface of all vertices, of the same code and rigid motion."""
    true = by_all.restore(pose.z, pose.rotation, pose.translation)
    assert pose.energy < 1.05 * true.energy + 0.05
    return apart(model, pose.vertices, true.vertices)


@pytest.mark.parametrize("hard", [True, False])
@MODELS
def test_frames_are_near_the_surface_of_all_vertices(model, hard, monkeypatch):
    by_nodes, by_all = pair(model, monkeypatch, relaxation=0)
    handles, targets = path(model, 6)
    frames = drags([by_nodes], handles, targets, hard=hard)
    for goal, (pose,) in zip(targets[1:], frames, strict=True):
        by_all.set_handles(handles, goal, hard=hard)
        assert error(model, pose, by_all) < 1e-2
        if hard:
            assert apart(model, pose.vertices[handles], goal) < 1e-6
    # Targets that stay are solved for all vertices.
    assert error(model, by_nodes.solve(warm=True), by_all) < 2e-5


@pytest.mark.parametrize("model", ["tube", "flag"], indirect=True)
def test_a_drag_comes_to_the_rest_of_all_vertices(model, monkeypatch):
    by_nodes, by_all = pair(model, monkeypatch)
    handles, targets = path(model, 6, seed=4)
    for _ in drags([by_nodes], handles, targets, hard=True):
        pass
    rest = solve_to_rest(by_nodes)
    by_all.set_handles(handles, targets[-1], hard=True)
    true = by_all.restore(rest.z, rest.rotation, rest.translation)
    assert apart(model, rest.vertices, true.vertices) < 2e-5
    assert rest.energy < 1.01 * by_all.solve().energy


@pytest.mark.parametrize("kind", ["pin", "face", "offset", "orientation", "floor", "misfit"])
@TUBE
def test_every_kind_of_handle(model, kind, monkeypatch):
    """Six handles of which two are of the kind; the others are soft."""
    if kind == "misfit":
        model = replace(model, handle_misfits=(MISFIT, MISFIT))
    by_nodes, by_all = pair(model, monkeypatch, relaxation=0)
    handles, targets = path(model, 6, seed=3)
    points, options = handles.tolist(), {"hard": [True, True, False, False, False, False]}
    if kind == "pin":
        options = {"kinds": ["pin", "pin", *4 * ["soft"]]}
        targets[:, :2] = targets[:1, :2]
    if kind in ("face", "offset"):
        corners = model.reference.faces[[40, 900]].tolist()
        off = 0.02 if kind == "offset" else 0.0
        points[:2] = [SurfacePoint(tuple(face), (0.5, 0.3, 0.2), off) for face in corners]
    if kind == "orientation":
        turn = random_rotation(np.random.default_rng(0), 0.3)
        options["orientations"] = [turn, turn, *4 * [None]]
    if kind == "floor":
        lowest = model.reference.vertices[:, 1].min()
        for solver in (by_nodes, by_all):
            solver.set_floor(Floor(lowest - 0.1))
    frames = drags([by_nodes], points, targets, **options)
    for goal, (pose,) in zip(targets[1:], frames, strict=True):
        by_all.set_handles(points, goal, **options)
        assert error(model, pose, by_all) < 1e-2
        if kind != "floor":
            assert pose.residual[:2].max() < 1e-6 * model.reference.bounding_diagonal
        if kind == "orientation":
            np.testing.assert_allclose(pose.orientation_residual[:2], 0.0, atol=1e-5)


@TUBE
def test_a_pose_that_is_not_a_frame_of_a_drag_is_that_of_all_vertices(model, monkeypatch):
    """To the last digit: cold solves, restored solutions, and the relaxed pose of a frame."""
    by_nodes, by_all = pair(model, monkeypatch)
    handles, targets = path(model, 5, seed=1)
    for _ in drags([by_nodes], handles, targets, hard=True):
        pass
    pose = by_nodes.relax()
    by_all.set_handles(handles, targets[-1], hard=True)
    restored = by_all.restore(pose.z, pose.rotation, pose.translation)
    np.testing.assert_allclose(pose.vertices, restored.vertices, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(by_nodes.solve().vertices, by_all.solve().vertices)


@TUBE
def test_rotations_pass_from_all_vertices_to_nodes_and_back(model, monkeypatch):
    basis = pair(model, monkeypatch)[0].basis
    surface, lifted = basis.surface, basis.moving
    q = np.tile(np.array([0.8, 0.0, -0.6, 0.0], dtype=np.float32), (len(surface.order), 1))
    surface.set_rotations(q)
    lifted.restrict_rotations()
    surface.reset()
    lifted.prolong_rotations()
    np.testing.assert_allclose(surface.quaternions, q, atol=1e-6)
    surface.reset()
    lifted.restrict_rotations()
    surface.set_rotations(q)
    lifted.prolong_rotations()
    assert not surface.has_rotations
    np.testing.assert_allclose(surface.quaternions, np.eye(4)[:1] + 0 * q, atol=1e-6)


def farthest(surface, by_nodes, z):
    """Largest distance of vertices that follow nodes from the surface of a code, no handles."""
    found = []
    for each in (surface, by_nodes):
        each.reset()
        each.decode(z)
        each.solve()
        each.move_to_targets(np.zeros((0, 3)))
        found.append(each.positions(np.eye(3), np.zeros(3)))
    return np.linalg.norm(found[0] - found[1], axis=1).max()


def test_nodes_are_added_for_codes_beyond_the_examples(flag, monkeypatch):
    of, model = Nodes.of, refined(flag, 1)
    monkeypatch.setattr(Nodes, "of", lambda system: of(system, COUNT))
    rng, away = np.random.default_rng(7), []
    beyond = model.prior.mean + 2.0 * rng.normal(size=(5, model.components)) @ model.prior.factor.T
    for deviations in (2.0, 0.0):
        monkeypatch.setattr(lifted_surface, "_DEVIATIONS", deviations)
        basis = HandleSolver(model).basis
        away.append(max(farthest(basis.surface, basis.moving, z) for z in beyond))
    assert away[0] < 0.9 * away[1]
