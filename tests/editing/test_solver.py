"""Truths of the handle solver: handles are met, poses are kept, nothing breaks it."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from deformer import Handle, HandleSolver, load_model
from deformer.editing.green_functions import HandleBasis
from deformer.editing.refinement import Refinement
from deformer.editing.rest import poses_to_rest, solve_to_rest
from deformer.editing.search import CodeSearch
from deformer.errors import InputError
from deformer.geometry.rotations import log_to_rotation
from distances import largest
from shapes import large_model

SPREAD = list(range(4, 120, 12))
pytestmark = pytest.mark.filterwarnings("error")


def pose_between(model, a=2, b=3):
    """A decoded shape in the middle of the training codes."""
    z = 0.5 * (model.codes[a] + model.codes[b])
    return z, model.decode(z)


def test_no_handles_give_the_mean_where_such_shapes_stand(model):
    pose = HandleSolver(model).solve()
    # Handle solves decode with 16 bits a weight.
    np.testing.assert_allclose(pose.vertices, model.decode(model.latent_mean), atol=1e-5)
    np.testing.assert_allclose(pose.z, model.latent_mean, atol=1e-9)
    assert pose.residual.shape == (0,)
    assert pose.prior_distance == pytest.approx(0, abs=1e-9)
    assert pose.energy == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("rigid", [True, False])
@pytest.mark.parametrize("relaxation", [0, 10])
def test_hard_handles_are_met(model, diagonal, rigid, relaxation):
    solver = HandleSolver(model, rigid=rigid, relaxation=relaxation)
    rng = np.random.default_rng(0)
    _, shape = pose_between(model)
    for count in (1, 2, 3, 10, 40):
        vertices = rng.choice(120, count, replace=False)
        targets = shape[vertices] + 0.1 * rng.normal(size=(count, 3))
        solver.set_handles(vertices, targets, hard=True)
        pose = solver.solve()
        assert largest(pose.vertices[vertices] - targets) < 1e-6 * diagonal
        np.testing.assert_allclose(
            pose.residual, np.linalg.norm(pose.vertices[vertices] - targets, axis=1), atol=1e-12
        )


def test_hard_by_handle(model, diagonal):
    """Those that are hard are met, the others nearly so; residuals are in the handles' order."""
    solver = HandleSolver(model)
    vertices = np.array([100, 3, 60, 40])
    targets = model.reference.vertices[vertices] + 0.2 * np.random.default_rng(1).normal(
        size=(4, 3)
    )
    hard = [False, True, False, True]
    solver.set_handles(vertices, targets, hard=hard)
    pose = solver.solve()
    assert [handle.hard for handle in solver.handles] == hard
    expected = np.linalg.norm(pose.vertices[vertices] - targets, axis=1)
    np.testing.assert_allclose(pose.residual, expected, atol=1e-12)
    assert pose.residual[[1, 3]].max() < 1e-6 * diagonal
    assert pose.residual[[0, 2]].min() > 1e-6 * diagonal


DEGENERATE = {
    "none": ([], []),
    "one": ([7], [[1.0, 2, 3]]),
    "two": ([7, 90], [[0.0, 0, 0], [1, 1, 0]]),
    "collinear": ([0, 40, 80], [[0.0, 0, 0], [1, 1, 1], [2, 2, 2]]),
    "at one point": ([0, 40, 80], [[1.0, 1, 1]] * 3),
    "duplicate": ([5, 5, 60], [[0.0, 0, 0], [0, 0, 1], [1, 0, 0]]),
    "far away": ([0, 60, 119], [[1e3, 0, 0], [0, 1e4, 0], [0, 0, -1e5]]),
    "very far away": ([0, 60], [[1e9, 0, 0], [0, -1e9, 0]]),
    "turned over": ([0, 4, 119, 115], [[2.0, 0, 0.25], [2, 0, -0.25], [0, 0, 0.25], [0, 0, -0.25]]),
}


@pytest.mark.parametrize("hard", [False, True], ids=["soft", "hard"])
@pytest.mark.parametrize("rigid", [False, True], ids=["still", "rigid"])
@pytest.mark.parametrize("case", DEGENERATE)
def test_nothing_breaks_it(model, case, rigid, hard):
    vertices, targets = DEGENERATE[case]
    solver = HandleSolver(model, rigid=rigid)
    solver.set_handles(vertices, targets, hard=hard)
    for pose in (solver.solve(), solver.solve(warm=True)):
        for value in (pose.vertices, pose.z, pose.rotation, pose.translation, pose.residual):
            assert np.isfinite(value).all()
        assert np.isfinite([pose.prior_distance, pose.energy, pose.milliseconds]).all()
        assert pose.vertices.shape == (120, 3) and pose.residual.shape == (len(vertices),)
        if not rigid:
            assert not pose.rotation.any() and not pose.translation.any()


def test_coincident_vertices_as_handles():
    """Two vertices at one place in the reference, not in all shapes, asked to part or to stay."""
    from deformer import MeshSequence, train
    from deformer.network.config import ModelConfig
    from settings import QUICK_ADAM
    from shapes import sequence

    shapes = sequence(5)
    vertices = shapes.vertices.copy()
    vertices[0, 20] = vertices[0, 21]
    config = ModelConfig("quick", 2, replace(QUICK_ADAM, mixed_shapes=0))
    model = train(MeshSequence(vertices, shapes.faces), config=config, device="cpu")
    solver = HandleSolver(model)
    p = model.reference.vertices
    for hard in (False, True):
        for apart in (0.0, 0.3):
            targets = p[[20, 21, 100]] + [[0, 0, apart], [0, 0, 0], [0, 0, 0]]
            solver.set_handles([20, 21, 100], targets, hard=hard)
            pose = solver.solve()
            assert np.isfinite(pose.vertices).all()
            if hard:
                assert pose.residual.max() < 1e-6


def test_handles_of_a_known_pose_recover_it(model, diagonal):
    z, shape = pose_between(model)
    solver = HandleSolver(model)
    solver.set_handles(SPREAD, shape[SPREAD])
    pose = solver.solve()
    assert largest(pose.vertices - shape) < 0.01 * diagonal
    assert pose.residual.max() < 0.005 * diagonal
    # The code recovers it too, on its own.
    free = model.decode(pose.z)
    assert largest(free - free.mean(0) - shape + shape.mean(0)) < 0.03 * diagonal
    K = model.components
    white = np.linalg.solve(np.linalg.cholesky(model.latent_covariance), z - model.latent_mean)
    assert pose.prior_distance < 1.1 * np.linalg.norm(white) + 0.1 and len(pose.z) == K


def test_the_pose_is_the_decoded_code_moved_rigidly(model):
    _, shape = pose_between(model)
    R = log_to_rotation([0.2, -0.1, 0.3])
    solver = HandleSolver(model)
    solver.set_handles(SPREAD, shape[SPREAD] @ R.T + [0.1, 0.2, 0.3])
    pose = solver.solve()
    centre = model.reference.vertices.mean(axis=0)
    moved = (model.decode(pose.z) - centre) @ log_to_rotation(pose.rotation).T
    np.testing.assert_allclose(pose.vertices, moved + centre + pose.translation, atol=1e-5)
    white = np.linalg.solve(np.linalg.cholesky(model.latent_covariance), pose.z - model.latent_mean)
    assert pose.prior_distance == pytest.approx(np.linalg.norm(white), rel=1e-6)


@pytest.mark.parametrize("angle", [0.2, 0.5, 1.5])
def test_a_rigidly_moved_target_set_carries_the_pose(model, diagonal, angle):
    """The motion is found, up to the faint pull that keeps the whole where it was."""
    _, shape = pose_between(model)
    R = log_to_rotation(angle * np.array([0.6, 0.0, 0.8]))
    goal = shape @ R.T + [0.5, -0.3, 0.2]
    solver = HandleSolver(model, freedom=1.0)
    solver.set_handles(SPREAD, shape[SPREAD])
    here = solver.solve().vertices
    solver.set_handles(SPREAD, goal[SPREAD])
    there = solver.solve().vertices
    bound = 0.01 * (1 + angle)
    assert largest(there - (here @ R.T + [0.5, -0.3, 0.2])) < bound * diagonal
    assert largest(there - goal) < bound * diagonal


@pytest.mark.parametrize("hard", [False, True])
def test_a_translated_target_set_translates_the_pose(model, diagonal, hard):
    _, shape = pose_between(model)
    # With a learned rigid prior, to stand elsewhere is of another cost.
    solver = HandleSolver(model, freedom=1.0)
    solver.set_handles(SPREAD, shape[SPREAD], hard=hard)
    here = solver.solve().vertices
    move = np.array([3.0, -2.0, 1.0])
    solver.set_handles(SPREAD, shape[SPREAD] + move, hard=hard)
    assert largest(solver.solve().vertices - here - move) < 2e-3 * diagonal


@pytest.mark.parametrize("angle", [0.5, 1.5])
def test_hard_handles_turned_by_an_angle_turn_the_pose(model, diagonal, angle):
    _, shape = pose_between(model)
    R = log_to_rotation(angle * np.array([0.0, 0.6, 0.8]))
    solver = HandleSolver(model)
    solver.set_handles(SPREAD, shape[SPREAD] @ R.T + [1, 2, 3], hard=True)
    assert largest(solver.solve().vertices - (shape @ R.T + [1, 2, 3])) < 0.015 * diagonal


def test_without_rigid_motion_the_shape_stays(model, diagonal):
    _, shape = pose_between(model)
    solver = HandleSolver(model, rigid=False)
    solver.set_handles(SPREAD, shape[SPREAD])
    assert largest(solver.solve().vertices - shape) < 0.01 * diagonal
    solver.set_handles(SPREAD, shape[SPREAD] + [10.0, 0, 0])
    pose = solver.solve()
    np.testing.assert_allclose(
        pose.vertices.mean(axis=0), model.decode(pose.z).mean(axis=0), atol=1e-5
    )
    assert not pose.rotation.any() and not pose.translation.any()


def test_weights_decide_between_handles(model):
    """Two handles that cannot both be met: the heavier one is nearer to its target."""
    p = model.reference.vertices
    vertices = [0, 119]
    targets = p[vertices] + [[0.0, 0, 0], [1.5, 0, 0]]
    solver = HandleSolver(model)
    residuals = []
    for weights in ([1, 1], [100, 1], [1, 100]):
        solver.set_handles(vertices, targets, weights=weights)
        residuals.append(solver.solve().residual)
    assert residuals[1][0] < residuals[0][0] and residuals[1][1] > residuals[0][1]
    assert residuals[2][1] < residuals[0][1] and residuals[2][0] > residuals[0][0]
    assert residuals[1][0] < residuals[1][1] and residuals[2][1] < residuals[2][0]


def test_a_double_handle_is_one_of_double_weight_at_the_mean(model):
    p = model.reference.vertices
    a, b = p[50] + [0.0, 0.2, 0], p[50] + [0.0, 0, 0.2]
    solver = HandleSolver(model)
    solver.set_handles([50, 10, 50], [a, p[10], b], weights=[1, 1, 3])
    twice = solver.solve()
    solver.set_handles([50, 10], [(a + 3 * b) / 4, p[10]], weights=[4, 1])
    np.testing.assert_allclose(solver.solve().vertices, twice.vertices, atol=1e-7)
    assert twice.residual.shape == (3,)


def test_the_order_of_handles_does_not_matter(model):
    _, shape = pose_between(model)
    solver = HandleSolver(model)
    for hard in (False, True):
        solver.set_handles(SPREAD, shape[SPREAD] * 1.05, hard=hard)
        one = solver.solve()
        solver.set_handles(SPREAD[::-1], shape[SPREAD[::-1]] * 1.05, hard=hard)
        other = solver.solve()
        np.testing.assert_allclose(other.vertices, one.vertices, atol=1e-7)
        np.testing.assert_allclose(other.residual, one.residual[::-1], atol=1e-7)


def test_a_solve_does_not_depend_on_what_was_solved_before(model):
    _, shape = pose_between(model)
    fresh = HandleSolver(model)
    fresh.set_handles(SPREAD, shape[SPREAD])
    expected = fresh.solve()
    used = HandleSolver(model)
    rng = np.random.default_rng(2)
    for _ in range(3):
        used.set_handles(rng.choice(120, 5, replace=False), rng.normal(size=(5, 3)), hard=True)
        used.solve()
        used.solve(warm=True)
    used.set_handles(SPREAD, shape[SPREAD])
    for found in (used.solve(), used.solve()):
        np.testing.assert_allclose(found.vertices, expected.vertices, atol=1e-7)
        np.testing.assert_allclose(found.z, expected.z, atol=1e-6)
        assert found.energy == pytest.approx(expected.energy)


def test_handles_that_come_and_go_leave_no_trace(model):
    """Kept Green rows are those of the vertices, whichever order they came in."""
    _, shape = pose_between(model)
    solver = HandleSolver(model)
    for chosen in ([90, 4], [4, 16, 90], [16], [30, 16, 4], SPREAD):
        solver.set_handles(chosen, shape[chosen] * 1.1, hard=True)
        found = solver.solve()
        fresh = HandleSolver(model)
        fresh.set_handles(chosen, shape[chosen] * 1.1, hard=True)
        # Sums in another order may end the relaxation a round earlier.
        np.testing.assert_allclose(found.vertices, fresh.solve().vertices, atol=2e-4)


def test_handles_that_are_gone_keep_no_memory(model):
    """What is kept for a handle (a Green row, its coefficients) goes with it."""
    solver = HandleSolver(model)

    def visit(vertices):
        for vertex in vertices:
            solver.set_handles([vertex], [[0.0, 0, 0]])

    tracemalloc.start()
    try:
        visit([0, 1])
        before = tracemalloc.get_traced_memory()[0]
        visit(range(2, 120))
        growth = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    # Four numbers a vertex and handle; a tenth of the handles that were there may linger.
    assert growth < 0.1 * 118 * 4 * 120 * 8


@pytest.mark.parametrize("hard", [False, True])
def test_dragging_ends_where_a_cold_solve_does(model, diagonal, hard):
    """Along a short path, a tenth of the diagonal, where there is one basin."""
    _, shape = pose_between(model)
    vertices = [4, 28, 52, 76, 100, 116]
    goal = shape[116] + 0.1 * diagonal * np.array([0.0, 0.6, 0.8])
    solver = HandleSolver(model)
    solver.set_handles(vertices, shape[vertices], hard=hard)
    solver.solve()
    for s in np.linspace(0, 1, 7)[1:]:
        solver.drag(116, (1 - s) * shape[116] + s * goal)
        # A frame takes one step of the rotations; the mouse rests for three more.
        for _ in range(3):
            pose = solver.solve(warm=True)
        cold = HandleSolver(model)
        cold.set_handles(vertices, [handle.target for handle in solver.handles], hard=hard)
        expected = cold.solve()
        assert largest(pose.vertices - expected.vertices) < 0.02 * diagonal
        assert pose.energy == pytest.approx(expected.energy, rel=0.02, abs=1e-3)
    assert solver.handles[5] == Handle(116, tuple(goal), 1.0, "exact" if hard else "soft")


def test_a_warm_solve_of_other_handles_ends_where_a_cold_one_does(model, diagonal):
    """Handles come between two frames; the last solution is only where to start."""
    _, shape = pose_between(model)
    _, goal = pose_between(model, 3, 4)
    solver = HandleSolver(model)
    solver.set_handles([4, 60], shape[[4, 60]])
    solver.solve()
    solver.set_handles(SPREAD, goal[SPREAD])
    for _ in range(6):
        warm = solver.solve(warm=True)
    cold = solver.solve()
    assert warm.energy == pytest.approx(cold.energy, rel=0.02, abs=1e-3)
    assert largest(warm.vertices - cold.vertices) < 0.02 * diagonal


@pytest.mark.slow
@pytest.mark.parametrize("hard", [False, True])
def test_a_mesh_of_more_vertices_than_are_searched(hard):
    """The search may look at a part of the vertices; what it finds must hold for all."""
    model = large_model()
    diagonal = model.reference.bounding_diagonal
    handles = np.arange(10, 1440, 130)
    _, shape = pose_between(model)
    solver = HandleSolver(model)
    solver.set_handles(handles, shape[handles], hard=hard)
    pose = solver.solve()
    assert largest(pose.vertices - shape) < 0.015 * diagonal
    if not hard:
        # The energy is the one of all vertices: what is left at the handles, and the prior.
        solver = HandleSolver(model, rigid=False, noise=0.01)
        solver.set_handles(handles, shape[handles] * 1.05)
        pose = solver.solve()
        misfit = (pose.residual**2).sum() / (0.01 * diagonal) ** 2
        prior = pose.prior_distance**2 + (model.bend_limits.excess(pose.z) ** 2).sum()
        assert pose.energy == pytest.approx(misfit + prior, rel=1e-4)
    goal = shape[handles[-1]] + 0.05 * diagonal
    solver.set_handles(handles, shape[handles], hard=hard)
    solver.solve()
    for s in np.linspace(0, 1, 7)[1:]:
        dragged = solver.drag(handles[-1], (1 - s) * shape[handles[-1]] + s * goal)
    cold = solver.solve()
    assert dragged.energy == pytest.approx(cold.energy, rel=0.05, abs=0.05)
    # A drag takes one round of relaxation a frame, a cold solve all that it needs.
    assert largest(dragged.vertices - cold.vertices) < 0.045 * diagonal


def test_dragging_to_the_same_place_stays(model, diagonal):
    _, shape = pose_between(model)
    solver = HandleSolver(model)
    solver.set_handles(SPREAD, shape[SPREAD])
    before = solver.solve()
    after = solver.drag(SPREAD[2], shape[SPREAD[2]])
    assert largest(after.vertices - before.vertices) < 1e-3 * diagonal
    assert after.energy <= before.energy * (1 + 1e-12)


def test_the_energy_is_that_of_its_formula_and_not_above_the_start(model, diagonal):
    """Σ w ‖p_h − q_h‖² / (σ D)² + prior distance² + what bends beyond the examples²."""
    _, shape = pose_between(model)
    solver = HandleSolver(model, rigid=False, noise=0.01)
    targets = shape[SPREAD] * 1.1
    weights = np.linspace(1, 2, len(SPREAD))
    solver.set_handles(SPREAD, targets, weights=weights)
    pose = solver.solve()
    misfit = (weights * pose.residual**2).sum() / (0.01 * diagonal) ** 2
    prior = pose.prior_distance**2 + (model.bend_limits.excess(pose.z) ** 2).sum()
    assert pose.energy == pytest.approx(misfit + prior, rel=1e-5)

    def energy(z):
        p = model.decode(z)[SPREAD]
        away = z - model.latent_mean
        prior = away @ np.linalg.solve(model.latent_covariance, away)
        prior += (model.bend_limits.excess(z) ** 2).sum()
        return (weights * ((p - targets) ** 2).sum(1)).sum() / (0.01 * diagonal) ** 2 + prior

    assert energy(pose.z) == pytest.approx(pose.energy, rel=1e-5)
    for start in (model.latent_mean, *model.codes):
        assert pose.energy <= energy(start) * (1 + 1e-9)
    # A minimum: no code near it is better.
    rng = np.random.default_rng(3)
    factor = np.linalg.cholesky(model.latent_covariance)
    for size in (1e-2, 0.1, 1.0):
        for _ in range(10):
            other = pose.z + size * factor @ rng.normal(size=len(pose.z))
            assert energy(other) >= pose.energy * (1 - 1e-3)


def test_more_noise_trusts_the_prior_more(model):
    _, shape = pose_between(model)
    found = []
    for noise in (0.001, 0.01, 0.1, 1.0):
        solver = HandleSolver(model, noise=noise)
        solver.set_handles(SPREAD, shape[SPREAD] * 1.1)
        found.append(solver.solve())
    assert np.all(np.diff([pose.prior_distance for pose in found]) < 1e-6)
    assert np.all(np.diff([pose.residual @ pose.residual for pose in found]) > -1e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([0, 120], np.zeros((2, 3))), r"vertices\[1\]: vertex 120 .*0…119"),
        (([0, -1], np.zeros((2, 3))), r"vertices\[1\]: vertex -1 "),
        (([3, 4], [[0, 0, 0], [0, np.nan, 0]]), r"handle 1: target \[0.0, nan, 0.0\]"),
        (([3, 4], [[0, 0, 0], [np.inf, 0, 0]]), "handle 1: target"),
        (([3, 4], np.zeros((2, 3)), [1.0, 0.0]), "handle 1: weight 0"),
        (([3, 4], np.zeros((2, 3)), [-1.0, 1.0]), "handle 0: weight -1"),
        (([3, 4], np.zeros((2, 3)), [1.0, np.nan]), "handle 1: weight nan"),
        (([3, 4], np.zeros((3, 3))), r"\(2, 3\).*\(3, 3\)"),
        (([3], [0.0, 0, 0]), r"\(1, 3\).*\(3,\)"),
        (([3.5], np.zeros((1, 3))), "integers"),
        (([[3]], np.zeros((1, 3))), r"\(1, 1\)"),
        (([3], np.zeros((1, 3)), [1.0, 2.0]), r"weights: expected \(1,\)"),
        (([3], np.zeros((1, 3)), None, [True, False]), r"hard: expected \(1,\)"),
    ],
    ids=str,
)
def test_wrong_handles_are_refused_and_the_old_ones_stay(model, arguments, words):
    solver = HandleSolver(model)
    solver.set_handles([7], [[1.0, 2, 3]])
    with pytest.raises(InputError, match=words):
        solver.set_handles(*arguments)
    assert solver.handles == [Handle(7, (1.0, 2.0, 3.0))]


def test_wrong_drags_are_refused(model):
    solver = HandleSolver(model)
    solver.set_handles([7, 9], np.zeros((2, 3)))
    with pytest.raises(InputError, match=r"vertex 8 has no handle.*\[7, 9\]"):
        solver.drag(8, [0, 0, 0])
    for position in ([0, 0], [0, 0, np.nan], [[0, 0, 0]]):
        with pytest.raises(InputError, match=r"position.*expected"):
            solver.drag(7, position)
    for noise in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="noise"):
            HandleSolver(model, noise=noise)


@pytest.mark.parametrize("hard", [False, True])
def test_settling_ends_where_nothing_improves(model, diagonal, hard):
    _, shape = pose_between(model)
    solver = HandleSolver(model)
    first = solver.solve_to_convergence()
    np.testing.assert_array_equal(first.vertices, HandleSolver(model).solve().vertices)
    solver.set_handles(SPREAD, shape[SPREAD], hard=hard)
    settled = solver.solve_to_convergence(50)
    again = solver.solve(warm=True)
    assert again.energy == pytest.approx(settled.energy, rel=1e-3, abs=1e-6)
    cold = HandleSolver(model)
    cold.set_handles(SPREAD, shape[SPREAD], hard=hard)
    assert largest(settled.vertices - cold.solve().vertices) < 0.02 * diagonal


def test_a_warm_solve_without_a_last_solution_is_a_cold_one(model):
    _, shape = pose_between(model)
    poses = []
    for warm in (False, True):
        solver = HandleSolver(model)
        solver.set_handles(SPREAD, shape[SPREAD] * 1.2, hard=True)
        poses.append(solver.solve(warm=warm).vertices)
    np.testing.assert_array_equal(*poses)


def bent_away(model, solver):
    """Two handles, one of them dragged off; the pose."""
    vertices = [4, 115]
    solver.set_handles(vertices, model.decode(model.codes[3])[vertices], hard=[False, True])
    solver.solve()
    return solver.drag(115, model.reference.vertices[115] + [0.1, -0.4, 0.3])


def test_a_resumed_solution_gives_the_same_pose_whatever_went_before(model, diagonal):
    """Another solver, other handles and solutions in between: the same to rounding."""
    first, second = HandleSolver(model), HandleSolver(model)
    pose = bent_away(model, first)
    solution = pose.z, pose.rotation, pose.translation
    shown = first.restore(*solution)
    np.testing.assert_allclose(shown.z, pose.z, atol=1e-9)
    np.testing.assert_allclose(shown.residual[1], 0, atol=1e-9)
    second.set_handles([70], [[1.0, 1.0, 0.0]], hard=True)
    second.solve()
    handles = first.handles
    second.set_handles(
        [h.vertex for h in handles], [h.target for h in handles], hard=[h.hard for h in handles]
    )
    assert largest(second.restore(*solution).vertices - shown.vertices) < 1e-7 * diagonal
    # And without exact handles it is what the solve itself shows.
    soft = HandleSolver(model)
    soft.set_handles([4], model.decode(model.codes[3])[[4]])
    pose = soft.solve()
    again = soft.restore(pose.z, pose.rotation, pose.translation)
    assert largest(again.vertices - pose.vertices) < 1e-7 * diagonal
    assert again.energy == pytest.approx(pose.energy, rel=1e-6)


def test_a_drag_relaxes_to_the_pose_that_resuming_its_solution_gives(model, diagonal):
    """At one code a frame of a drag and the relaxed pose differ; relaxing twice changes nothing."""
    solver = HandleSolver(model)
    with pytest.raises(InputError, match="solve first"):
        solver.relax()
    _, shape = pose_between(model)
    solver.set_handles(SPREAD, shape[SPREAD], hard=True)
    solver.solve()
    # Targets that no code reaches: much is left to rigid relaxation.
    aside = 0.05 * diagonal * np.random.default_rng(0).normal(size=(len(SPREAD), 3))
    solver.set_handles(SPREAD, shape[SPREAD] + aside, hard=True)
    frame = solver.solve(warm=True)
    relaxed = solver.relax()
    np.testing.assert_allclose(relaxed.z, frame.z, atol=1e-9)
    assert relaxed.energy == pytest.approx(frame.energy, rel=1e-6)
    assert largest(relaxed.vertices - frame.vertices) > 1e-3 * diagonal
    again = solver.restore(frame.z, frame.rotation, frame.translation)
    assert largest(again.vertices - relaxed.vertices) < 1e-7 * diagonal
    assert largest(solver.relax().vertices - relaxed.vertices) < 1e-7 * diagonal


def test_a_prior_about_another_code(model, diagonal):
    """Without handles the pose is that code's; a solver begun that way agrees with one changed."""
    # Of one cost of the rigid motion: only a cold solve looks for the cheaper of two.
    solver = HandleSolver(model, freedom=1.0)
    bent_away(model, solver)
    solver.set_prior(mean=model.codes[5])
    pose = solver.solve(warm=True)
    for _ in range(5):
        pose = solver.solve(warm=True)
    other = HandleSolver(model, freedom=1.0)
    other.set_prior(mean=model.codes[5])
    bent_away(model, other)
    assert pose.energy < 1.02 * other.solve().energy
    solver.set_handles([], np.zeros((0, 3)))
    free = solver.solve()
    np.testing.assert_allclose(free.z, model.codes[5], atol=1e-9)
    np.testing.assert_allclose(free.vertices, model.decode(model.codes[5]), atol=1e-5 * diagonal)


def test_a_change_of_the_prior_moves_nothing_by_itself(model):
    solver = HandleSolver(model)
    pose = bent_away(model, solver)
    before = solver.energy.code(solver.solution)
    solver.set_prior(mean=model.codes[1], noise=0.02, freedom=0.5)
    np.testing.assert_allclose(solver.energy.code(solver.solution), before, atol=1e-9)
    assert solver.energy.noise == 0.02 and solver.energy.freedom == 0.5
    assert np.isfinite(pose.energy)


def test_a_lone_handle_carries_the_shape_along_or_bends_it(model, diagonal):
    goal = model.decode(model.codes[0])[115] + [0.0, 0.3, 0.0]
    shifts = []
    for freedom in (1.0, 0.01):
        solver = HandleSolver(model, freedom=freedom)
        solver.set_prior(mean=model.codes[0])
        solver.set_handles([115], [goal])
        pose = solver.solve()
        assert pose.residual[0] < 0.02 * diagonal
        shifts.append(np.linalg.norm(pose.translation))
    assert shifts[0] > 0.2 and shifts[1] < 0.05


@pytest.mark.parametrize(
    ("wrong", "said"),
    [({"noise": 0.0}, "noise"), ({"freedom": -1.0}, "freedom"), ({"noise": np.nan}, "noise"),
     ({"mean": [1.0]}, "mean: expected .6,"), ({"mean": [np.inf] * 6}, "expected a finite")],
)  # fmt: skip
def test_a_prior_that_makes_no_sense_is_refused(model, wrong, said):
    with pytest.raises(InputError, match=said):
        HandleSolver(model).set_prior(**wrong)


def test_a_change_of_the_prior_between_new_handles_and_their_solve(model):
    """Where the handles lie in the last solution is not known there yet."""
    _, shape = pose_between(model)
    solver = HandleSolver(model)
    solver.set_handles(SPREAD[:3], shape[SPREAD[:3]])
    solver.solve()
    solver.set_handles(SPREAD, shape[SPREAD])
    solver.set_prior(noise=0.01)
    found = solver.solve(warm=True)
    other = HandleSolver(model)
    other.set_handles(SPREAD[:3], shape[SPREAD[:3]])
    other.solve()
    other.set_prior(noise=0.01)
    other.set_handles(SPREAD, shape[SPREAD])
    expected = other.solve(warm=True)
    np.testing.assert_allclose(found.vertices, expected.vertices, atol=1e-5)
    assert np.isfinite(found.energy)


@pytest.mark.parametrize("hard", [False, True])
@pytest.mark.parametrize("diagonals", [1.0, 10.0, 1000.0])
def test_a_drag_far_away_and_back_comes_to_the_cold_solve(model, diagonal, diagonals, hard):
    vertices = [3, 40, 80]
    solver = HandleSolver(model)
    targets = model.reference.vertices[vertices] + 0.01 * diagonal
    solver.set_handles(vertices, targets, hard=hard)
    cold = solver.solve()
    solver.drag(3, targets[0] + [diagonals * diagonal, 0.0, 0.0])
    pose = solver.drag(3, targets[0])
    for _ in range(100):
        before, pose = pose, solver.solve(warm=True)
        if solver.at_rest and pose.energy > before.energy * (1 - 1e-4):
            break
    assert solver.at_rest
    assert pose.energy <= 1.01 * cold.energy
    np.testing.assert_allclose(solver.relax().vertices, cold.vertices, atol=2e-2 * diagonal)


def test_a_minimum_that_is_not_the_lowest_is_left_at_rest_alone(model, diagonal):
    solver = HandleSolver(model)
    vertices = [3, 40, 80]
    targets = model.reference.vertices[vertices] + 0.01 * diagonal
    solver.set_handles(vertices, targets)
    cold = solver.solve()
    turned = cold.rotation + np.array([0.0, 0.0, np.pi])  # the handles nearly fit upside down, too
    solver.restore(cold.z, turned, cold.translation)
    streamed = solver.solve_to_convergence(40)
    energies = [streamed.energy]
    while not solver.at_rest:
        energies.append(solver.solve(warm=True).energy)
    assert np.diff(energies).max() <= 1e-9 * energies[0]  # never up
    assert energies[-1] <= 1.01 * cold.energy


def test_the_last_frame_of_a_drag_is_nearly_a_minimum(model, diagonal):
    """Moves as large as those of a fast hand; what is left is done at rest, and shows."""
    rng = np.random.default_rng(5)
    moved = []
    for _ in range(12):
        vertices = rng.choice(len(model.reference.vertices), 3, replace=False)
        start = model.reference.vertices[vertices]
        end = start[0] + 0.4 * diagonal * rng.normal(size=3)
        solver = HandleSolver(model, noise=0.007)
        solver.set_handles(vertices, start)
        solver.solve()
        for share in np.linspace(0, 1, 9)[1:]:
            frame = solver.drag(int(vertices[0]), (1 - share) * start[0] + share * end)
        refined = solver.solve_to_convergence(20)
        assert refined.energy >= 0.98 * frame.energy
        moved.append(np.abs(solver.model.decode(frame.z) - solver.model.decode(refined.z)).max())
    assert np.median(moved) < 1e-2 * diagonal


def test_a_rest_refines_no_start_that_leads_back(model, diagonal, monkeypatch):
    """Only those that lead to another minimum than the one that the solver rests in."""
    refined = []
    converge = Refinement.converge

    def count(self, *arguments):
        refined.append(arguments)
        return converge(self, *arguments)

    monkeypatch.setattr(Refinement, "converge", count)
    vertices = [3, 40, 80]
    solver = HandleSolver(model, noise=0.007)
    solver.set_handles(vertices, model.reference.vertices[vertices] + 0.02 * diagonal)
    cold = solver.solve()
    minima = len(refined)
    refined.clear()
    solver.restore(cold.z, cold.rotation, cold.translation)
    last = solve_to_rest(solver)
    assert solver.at_rest and len(refined) == minima - 1
    assert last.energy <= cold.energy * (1 + 1e-9)


def test_a_rest_shows_the_relaxed_surface_before_other_starts(model, diagonal, monkeypatch):
    """What the user sees is at rest early; other starts, which seldom lead lower, take longer."""
    poses, tried = [], []
    explore = CodeSearch._explore

    def note(self, *arguments):
        tried.append(len(poses))
        return explore(self, *arguments)

    monkeypatch.setattr(CodeSearch, "_explore", note)
    vertices = [3, 40, 80, 110]
    start = model.reference.vertices[vertices]
    solver = HandleSolver(model, noise=0.007)
    solver.set_handles(vertices, start, hard=True)
    solver.solve()
    for share in (0.5, 1.0):
        frame = solver.drag(3, start[0] + 0.1 * share * diagonal)
    for pose in poses_to_rest(solver):
        poses.append(pose)
    assert solver.at_rest and len(tried) > 1 and tried[0] > 0
    np.testing.assert_array_equal(poses[tried[0] - 1].vertices, poses[-1].vertices)
    assert largest(frame.vertices - poses[-1].vertices) > 1e-4 * diagonal


@pytest.mark.parametrize("hard", [False, True])
def test_handles_on_a_pose_that_bends_more_than_any_example_move_nothing(model, diagonal, hard):
    z = model.latent_mean + 3.0 * (model.codes[3] - model.latent_mean)
    assert model.bend_limits.excess(z).any()
    solver = HandleSolver(model, noise=0.007)
    solver.set_prior(mean=z)
    shape = solver.solve().vertices
    vertices = [3, 40, 80]
    solver.set_handles(vertices, shape[vertices], hard=hard)
    pose = solve_to_rest(solver)
    assert pose.energy < 1e-9 and largest(pose.vertices - shape) < 1e-4 * diagonal
    solver.set_prior(mean=model.latent_mean)  # bends that far have their price again
    solver.set_handles(vertices, shape[vertices])
    assert solver.solve().energy > 0.1


def test_a_solver_with_nothing_to_do_comes_to_rest(model):
    """Without handles, and at handles that are where they would be anyway: an energy of zero."""
    solver = HandleSolver(model)
    vertices = solver.solve().vertices
    for handles in ([], [5, 90]):
        solver.set_handles(handles, vertices[handles])
        solver.restore(model.latent_mean, np.zeros(3), np.zeros(3))
        for _ in range(100):
            solver.solve(warm=True)
        assert solver.at_rest


@pytest.mark.parametrize("hard", [False, True])
def test_a_rest_is_never_above_the_cold_solve(model, diagonal, hard):
    """After any path, with handles that other poses also nearly meet."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        vertices = rng.choice(len(model.reference.vertices), 4, replace=False)
        ends = model.reference.vertices[vertices] + 0.5 * diagonal * rng.normal(size=(4, 4, 3))
        solver = HandleSolver(model)
        solver.set_handles(vertices, ends[0], hard=hard)
        solver.solve()
        for end in ends[1:]:
            for share in np.linspace(0, 1, 4):
                solver.drag(int(vertices[0]), (1 - share) * ends[0, 0] + share * end[0])
        while not solver.at_rest:
            pose = solver.solve(warm=True)
        energy = solver.solve().energy
        assert pose.energy <= 1.01 * energy


@pytest.mark.parametrize("hard", [False, True])
def test_targets_out_of_reach_are_refused_and_leave_no_trace(model, diagonal, hard):
    solver = HandleSolver(model)
    target = model.reference.vertices[[3]]
    solver.set_handles([3], target, hard=hard)
    solver.solve()
    for size in (1e11, 1e25, 1e160):
        with pytest.raises(InputError, match=r"bounding diagonals away .* check its units"):
            solver.drag(3, [size * diagonal, 0.0, 0.0])
        with pytest.raises(InputError, match=r"handle 0: target .* check its units"):
            solver.set_handles([3], [[0.0, size * diagonal, 0.0]])
    far = solver.drag(3, [5e9 * diagonal, 0.0, 0.0])
    assert np.isfinite(far.vertices).all()
    assert np.isfinite(solver.drag(3, target[0]).vertices).all()


def test_rows_of_a_handle_do_not_depend_on_the_handles_that_came_with_it():
    """Bit by bit: a solution that is stored has the same pose in a solver of another history."""
    model = large_model()
    points = list(range(0, len(model.reference.vertices), 97))[:13]
    one_by_one, at_once = HandleBasis(model), HandleBasis(model)
    for count in range(1, len(points) + 1):
        one_by_one.set_points(points[:count])
        one_by_one.set_exact(points[:count])
    at_once.set_points(points)
    for rows in (
        lambda basis: basis.coefficients(),
        lambda basis: basis.set_exact(points).rows,
        lambda basis: basis.misfit_rows(),
    ):
        np.testing.assert_array_equal(rows(one_by_one), rows(at_once))


def test_a_drag_out_of_reach_does_not_stop_short_of_its_minimum():
    """The energy of a far target is large, and a step that gains little of it may lead far."""
    model = load_model("humanoid")
    diagonal = model.reference.bounding_diagonal
    solver = HandleSolver(model, noise=0.007, freedom="auto")
    solver.set_prior(mean=model.codes[0])
    start = solver.restore(model.codes[0], np.zeros(3), np.zeros(3)).vertices[2785]
    solver.set_handles([2785], [start])
    end, bow = np.array([[0.057, 0.033, -0.135], [0.048, 0.107, -0.031]]) * diagonal
    for share in np.linspace(0, 1, 41)[1:]:
        frame = solver.drag(2785, start + share * end + np.sin(np.pi * share) * bow)
    rest = solve_to_rest(solver)
    assert rest.energy > 0.99 * frame.energy
    assert np.abs(rest.vertices - frame.vertices).max() < 0.05 * diagonal


@pytest.mark.parametrize("seed", range(4))
def test_a_soft_handle_stays_where_its_code_is_although_pins_are_reached(model, diagonal, seed):
    """As the surface came to rest, reaching the pins pulled it off the soft handle's target."""
    vertices, pull = [3, 5, 12, 110], np.random.default_rng(seed).normal(size=3)
    targets = model.reference.vertices[vertices].copy()
    targets[3] += 0.2 * diagonal * pull / np.linalg.norm(pull)
    solver = HandleSolver(model, noise=0.007, misfit=0.0)
    solver.set_handles(vertices, targets, kinds=["pin", "pin", "pin", "soft"])
    rest = solve_to_rest(solver)
    at = solver.energy.move(solver.solution, solver.basis.surface.decode(rest.z))
    assert largest(rest.vertices[vertices[:3]] - targets[:3]) < 1e-9
    assert largest(at[:3] - targets[:3]) > 0.01 * diagonal  # the code does not reach the pins
    assert largest(rest.vertices[110] - at[3]) < 3e-3 * diagonal
