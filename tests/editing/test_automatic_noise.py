"""Truths of the noise that a solver chooses by itself."""

import numpy as np

import deformer
from deformer import HandleSolver, fit_sequence

HANDLES = np.arange(4, 120, 12)


def stretched(model, factor):
    """Targets of a shape whose length no code has."""
    targets = model.decode(model.codes[1])[HANDLES]
    centre = targets.mean(axis=0)
    return centre + factor * (targets - centre)


def likely(model, pose):
    return pose.prior_distance**2 <= 0.75 * model.components


def test_targets_in_reach_have_the_models_noise(model):
    solver = HandleSolver(model)
    for code in model.codes:
        solver.set_handles(HANDLES, model.decode(code)[HANDLES])
        solver.solve()
        assert solver.energy.noise == model.handle_noise


def test_targets_out_of_reach_leave_the_code_likely(model):
    targets = stretched(model, 1.6)
    solver, fixed = HandleSolver(model), HandleSolver(model, noise=model.handle_noise)
    for s in (solver, fixed):
        s.set_handles(HANDLES, targets)
    pose, contorted = solver.solve(), fixed.solve()
    assert not likely(model, contorted) and fixed.energy.noise == model.handle_noise
    assert likely(model, pose) and solver.energy.noise > model.handle_noise
    again = solver.solve()
    assert np.array_equal(again.vertices, pose.vertices)


def test_a_drag_comes_to_the_same_and_back(model):
    near, far = stretched(model, 1.0), stretched(model, 1.6)
    solver = HandleSolver(model)
    solver.set_handles(HANDLES, near)
    solver.solve()
    for s in np.linspace(0, 1, 9)[1:]:
        solver.set_handles(HANDLES, (1 - s) * near + s * far)
        solver.solve(warm=True)
    for _ in range(200):
        pose = solver.solve(warm=True)
        if solver.at_rest:
            break
    assert solver.at_rest and likely(model, pose)
    solver.set_handles(HANDLES, near)
    for _ in range(200):
        solver.solve(warm=True)
        if solver.at_rest:
            break
    assert solver.energy.noise == model.handle_noise


def test_set_prior_ends_it(model):
    solver = HandleSolver(model)
    solver.set_prior(noise=0.003)
    solver.set_handles(HANDLES, stretched(model, 1.6))
    solver.solve()
    assert solver.energy.noise == 0.003


def test_a_sequence_has_one_noise(model):
    targets = np.stack([stretched(model, 1.6)] * 5)
    solver = HandleSolver(model, freedom=1.0)
    solver.set_handles(HANDLES, targets[0])
    solver.solve()
    found = fit_sequence(model, HANDLES, targets)
    same = fit_sequence(model, HANDLES, targets, noise=solver.energy.noise)
    assert np.allclose(found.vertices, same.vertices, atol=1e-9)


def test_a_figure_with_pinned_feet_is_not_contorted():
    """Its head is pulled farther up than it reaches: hands do not rise to the face for it."""
    model = deformer.load_model("humanoid")
    rest = model.reference.vertices
    feet_and_head = [3213, 3352, 1532, 1657, 110]
    targets = rest[feet_and_head].copy()
    targets[-1, 2] += 0.27
    solver = HandleSolver(model)
    solver.set_handles(feet_and_head, targets)
    assert likely(model, solver.solve())
