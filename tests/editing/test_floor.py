"""Truths of a floor: nothing passes it, contacts slide, and without contact nothing changes."""

import numpy as np
import pytest

from deformer import Floor, HandleSolver, InputError, fit_sequence, solve_to_rest
from distances import largest
from shapes import small_model


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture
def floor(model):
    """A little under the first example, whose up axis is y."""
    lowest = model.decode(model.codes[0])[:, 1].min()
    return Floor.at(model, float(lowest) - 0.02)


def solver_at(model, vertices, floor=None, kinds="soft"):
    """A solver with handles on the first example's surface."""
    found = HandleSolver(model, noise=0.007, freedom=0.01)
    found.set_prior(mean=model.codes[0])
    shown = found.restore(model.codes[0], np.zeros(3), np.zeros(3)).vertices
    found.set_floor(floor)
    found.set_handles(vertices, shown[vertices], kinds=kinds)
    return found, shown


@pytest.mark.parametrize("kinds", ["soft", "exact"])
def test_no_vertex_passes_the_floor_while_dragged_nor_at_rest(model, floor, diagonal, kinds):
    solver, shown = solver_at(model, [115, 4], floor, kinds)
    free, _ = solver_at(model, [115, 4], None, kinds)
    down = shown[115] - [0.0, 0.3 * diagonal, 0.0]
    for share in np.linspace(0.1, 1.0, 8):
        target = shown[115] + share * (down - shown[115])
        assert floor.depths(solver.drag(115, target).vertices).max() <= 1e-12 * diagonal
        free.drag(115, target)
    pose = solve_to_rest(solver)
    assert solver.at_rest
    assert floor.depths(pose.vertices).max() <= 1e-12 * diagonal
    assert floor.depths(solve_to_rest(free).vertices).max() > 0.1 * diagonal


def test_the_prior_does_most_and_the_projection_little(model, floor, diagonal):
    """The code's own shape hardly passes the floor: the body bends instead of being cut flat."""
    solver, shown = solver_at(model, [115], floor)
    target = shown[115] - [0.0, 0.3 * diagonal, 0.0]
    for share in np.linspace(0.1, 1.0, 8):
        solver.drag(115, shown[115] + share * (target - shown[115]))
    pose = solve_to_rest(solver)
    bare = HandleSolver(model).restore(pose.z, pose.rotation, pose.translation)
    assert floor.depths(bare.vertices).max() < 0.02 * diagonal


def test_while_nothing_passes_poses_are_those_without_a_floor(model, floor, diagonal):
    poses = []
    for chosen in (None, Floor.at(model, floor.height - diagonal)):
        solver, shown = solver_at(model, [115], chosen)
        for step in range(4):
            solver.drag(115, shown[115] + [0.0, 0.02 * step * diagonal, 0.0])
        poses.append(solve_to_rest(solver).vertices)
    np.testing.assert_array_equal(*poses)


def test_contacts_slide(model, diagonal):
    """A drag along the floor takes the body along it as far as without a floor."""
    shown = solver_at(model, [60])[1]
    floor = Floor.at(model, float(shown[:, 1].min()) + 0.01 * diagonal)
    moved = []
    for chosen in (None, floor):
        solver, shown = solver_at(model, [60, 61, 70], chosen)
        start = shown[[60, 61, 70]]
        solver.set_prior(freedom=1.0)
        for step in range(1, 9):
            shift = np.array([0.0, 0.0, 0.05 * step * diagonal])
            solver.set_handles([60, 61, 70], start + shift, kinds="soft")
            solver.solve(warm=True)
        moved.append(solve_to_rest(solver).vertices - shown)
    along = np.stack(moved)[..., 2].mean(axis=1)
    assert along[1] == pytest.approx(along[0], rel=0.05)
    assert along[0] > 0.2 * diagonal


def test_a_pose_is_restored_from_its_solution(model, floor, diagonal):
    """Whatever was solved before."""
    solver, shown = solver_at(model, [115], floor)
    for step in range(1, 6):
        solver.drag(115, shown[115] - [0.0, 0.06 * step * diagonal, 0.0])
    pose = solve_to_rest(solver)
    other, _ = solver_at(model, [115], floor)
    other.set_handles([115], [shown[115] - [0.0, 0.3 * diagonal, 0.0]])
    again = other.restore(pose.z, pose.rotation, pose.translation)
    assert largest(again.vertices - pose.vertices) < 1e-6 * diagonal


def test_a_restored_pose_at_rest_stays_on_its_contacts(model, floor, diagonal):
    """Its history chose them: without them the solver finds others, deeper ones alone."""
    solver, shown = solver_at(model, [115, 4], floor)
    for step in range(1, 9):
        solver.drag(115, shown[115] + 0.04 * step * diagonal * np.array([0.2, -1.0, 0.0]))
    pose = solve_to_rest(solver)
    assert pose.contacts
    assert floor.depths(pose.vertices[list(pose.contacts)]).min() > -1e-2 * diagonal
    other, _ = solver_at(model, [115, 4], floor)
    handles = solver.handles
    other.set_handles([h.vertex for h in handles], [h.target for h in handles])
    again = other.restore(pose.z, pose.rotation, pose.translation, pose.contacts)
    assert again.contacts == pose.contacts
    assert again.energy == pytest.approx(pose.energy, rel=1e-9)
    assert largest(solve_to_rest(other).vertices - pose.vertices) < 1e-6 * diagonal
    assert other.restore(pose.z, pose.rotation, pose.translation).contacts == ()


def test_contacts_that_make_no_sense_are_refused(model, floor):
    solver, _ = solver_at(model, [115], floor)
    nothing = model.codes[0], np.zeros(3), np.zeros(3)
    with pytest.raises(InputError, match=r"contacts.*120"):
        solver.restore(*nothing, contacts=[120])
    with pytest.raises(InputError, match="contacts: expected at most 12 vertices, got 13"):
        solver.restore(*nothing, contacts=range(13))
    solver.set_floor(None)
    assert solver.restore(*nothing, contacts=[3]).contacts == ()


def test_a_cold_solve_keeps_above_the_floor_too(model, floor, diagonal):
    solver, shown = solver_at(model, [115], floor)
    solver.set_handles([115], [shown[115] - [0.0, 0.3 * diagonal, 0.0]])
    assert floor.depths(solver.solve().vertices).max() <= 1e-12 * diagonal


def test_without_the_floor_again_a_pose_is_the_free_one(model, floor, diagonal):
    solver, shown = solver_at(model, [115], floor)
    target = shown[115] - [0.0, 0.3 * diagonal, 0.0]
    solver.drag(115, target)
    solver.set_floor(None)
    assert solver.floor is None
    pose = solver.solve()
    free, _ = solver_at(model, [115])
    free.set_handles([115], [target])
    np.testing.assert_allclose(pose.vertices, free.solve().vertices, atol=1e-9 * diagonal)


def test_a_floor_may_slope_and_its_normal_have_any_length():
    floor = Floor(2.0, (0.0, 3.0, 4.0))
    assert floor.normal == pytest.approx((0.0, 0.6, 0.8))
    points = np.array([[5.0, 0.0, 0.0], [1.0, 3.0, 4.0]])
    np.testing.assert_allclose(floor.depths(points), [2.0, -3.0])
    np.testing.assert_allclose(floor.above(points), [[5.0, 1.2, 1.6], [1.0, 3.0, 4.0]])


def test_the_floor_of_a_model_is_where_its_examples_stand(model):
    lowest = [model.decode(code)[:, 1].min() for code in model.codes]
    floor = Floor.under(model)
    assert floor.normal == (0.0, 1.0, 0.0) and min(lowest) <= floor.height <= max(lowest)


def test_a_normal_of_zero_is_refused():
    with pytest.raises(InputError, match="floor: normal: expected another than zero"):
        Floor(0.0, (0.0, 0.0, 0.0))


def pressed(model, floor, diagonal, frames=16):
    """Handles at vertices (4,) of the first example that go down through a floor, and back."""
    vertices = [3, 40, 80, 115]
    start = model.decode(model.codes[0])[vertices]
    down = 0.2 * diagonal * np.sin(np.linspace(0, np.pi, frames))
    targets = np.repeat(start[None], frames, axis=0)
    targets[..., 1] -= down[:, None]
    return vertices, targets


@pytest.mark.parametrize("backend", ["numba", "torch"])
@pytest.mark.parametrize("hard", [False, True])
def test_no_frame_of_a_sequence_passes_the_floor(model, floor, diagonal, hard, backend):
    """Nor do the shapes of its codes by much: they bend, and are not only cut off."""
    vertices, targets = pressed(model, floor, diagonal)
    options = {"mean": model.codes[0], "freedom": 0.01, "smoothness": 1.0, "backend": backend}
    free = fit_sequence(model, vertices, targets, hard=hard, **options)
    above = fit_sequence(model, vertices, targets, hard=hard, floor=floor, **options)
    assert floor.depths(free.vertices).max() > 0.05 * diagonal
    assert floor.depths(above.vertices).max() < 1e-9 * diagonal
    if not hard:
        solver = HandleSolver(model)
        codes = [
            solver.restore(z, rotation, translation).vertices
            for z, rotation, translation in zip(
                above.z, above.rotation, above.translation, strict=True
            )
        ]
        assert floor.depths(np.array(codes)).max() < 1e-2 * diagonal
    else:
        on_floor = floor.above(targets)
        assert largest(above.vertices[:, vertices] - on_floor) < 1e-6 * diagonal


def test_a_sequence_above_the_floor_is_the_one_without(model, diagonal):
    vertices, targets = pressed(model, None, diagonal)
    low = Floor.at(model, float(targets[..., 1].min()) - diagonal)
    free = fit_sequence(model, vertices, targets)
    np.testing.assert_array_equal(fit_sequence(model, vertices, targets, floor=low).vertices,
                                  free.vertices)  # fmt: skip


def test_gaps_of_a_sequence_are_those_of_single_frames(model, diagonal):
    """Codes are sought that miss the targets by the gaps; exact handles are on them."""
    vertices, targets = pressed(model, None, diagonal)
    gaps = 0.02 * diagonal * np.random.default_rng(2).normal(size=(4, 3))
    options = {"smoothness": 3.0, "misfit": 0.0}
    apart = fit_sequence(model, vertices, targets, gaps=gaps, **options)
    shifted = fit_sequence(model, vertices, targets - gaps, **options)
    np.testing.assert_allclose(apart.z, shifted.z, atol=1e-9)
    exact = fit_sequence(model, vertices, targets, gaps=gaps, hard=True, **options)
    np.testing.assert_allclose(exact.z, shifted.z, atol=1e-9)
    assert largest(exact.vertices[:, vertices] - targets) < 1e-6 * diagonal


@pytest.mark.parametrize("gaps", [np.zeros((3, 3)), np.full((4, 3), np.nan), "ab"])
def test_gaps_of_a_sequence_that_make_no_sense_are_refused(model, diagonal, gaps):
    vertices, targets = pressed(model, None, diagonal)
    with pytest.raises(InputError, match=r"gaps(\[0, 0\])?: expected"):
        fit_sequence(model, vertices, targets, gaps=gaps)


def test_a_floor_of_a_sequence_is_a_floor(model, diagonal):
    vertices, targets = pressed(model, None, diagonal)
    with pytest.raises(InputError, match="floor: expected"):
        fit_sequence(model, vertices, targets, floor=0.0)  # pyright: ignore
