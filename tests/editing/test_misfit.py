"""Truths of models that have an error of their own: the shape deforms by what their codes miss."""

from dataclasses import replace

import numpy as np
import pytest

from deformer import HandleSolver, fit_sequence, uncertainty
from shapes import small_model

HANDLES = np.arange(4, 120, 12)
NOISE, MISFIT = 0.01, 0.03


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture(scope="module")
def doubtful(model):
    return replace(model, handle_misfit=MISFIT)


@pytest.fixture(scope="module")
def targets(model):
    """Handles of a shape that no code has."""
    shape = model.decode(model.codes[1])[HANDLES]
    return np.add(shape * [1.1, 1.0, 0.9], [0.0, 0.1, 0.0])


def posed(model, targets, **kinds):
    weights = kinds.pop("weights", None)
    solver = HandleSolver(model, noise=kinds.pop("noise", NOISE))
    solver.set_handles(HANDLES, targets, weights, **kinds)
    return solver, solver.solve()


def test_exact_handles_are_fitted_as_by_the_noise_of_both(model, doubtful, targets):
    _, pose = posed(doubtful, targets, hard=True)
    _, other = posed(model, targets, hard=True, noise=float(np.hypot(NOISE, MISFIT)))
    np.testing.assert_allclose(pose.z, other.z, atol=1e-9)
    np.testing.assert_allclose(pose.vertices, other.vertices, atol=1e-9)
    assert pose.residual.max() < 1e-9


def test_soft_handles_keep_the_targets_share_of_their_misfit(doubtful, targets):
    """σ²/w / (σ²/w + τ²): with more noise or less weight they stay farther away."""
    weights = np.geomspace(0.1, 10, len(HANDLES))
    solver, pose = posed(doubtful, targets, weights=weights)
    energy, x = solver.energy, np.asarray(solver.solution)
    p = doubtful.decode(pose.z)
    p -= p.mean(axis=0)
    coded = energy.move(x, p)[HANDLES]
    share = (NOISE**2 / weights) / (NOISE**2 / weights + MISFIT**2)
    expected = share * np.linalg.norm(coded - targets, axis=1)
    assert expected.max() > 1e-3 * energy.diagonal
    np.testing.assert_allclose(pose.residual, expected, atol=2e-4 * energy.diagonal)


def test_kinds_mix(doubtful, targets):
    exact = np.arange(len(HANDLES)) % 2 == 0
    _, pose = posed(doubtful, targets, hard=exact.tolist())
    assert pose.residual[exact].max() < 1e-9 < pose.residual[~exact].min()


def test_a_drag_at_rest_is_the_cold_solve(doubtful, targets):
    diagonal = doubtful.reference.bounding_diagonal
    solver, cold = posed(doubtful, targets)
    start = targets.copy()
    start[0] += 0.2 * diagonal
    solver.set_handles(HANDLES, start)
    solver.solve()
    for s in np.linspace(0, 1, 6)[1:]:
        solver.drag(int(HANDLES[0]), (1 - s) * start[0] + s * targets[0])
    for _ in range(300):
        pose = solver.solve(warm=True)
        if solver.at_rest:
            break
    assert solver.at_rest
    assert np.abs(solver.relax().vertices - cold.vertices).max() < 2e-3 * diagonal
    assert np.abs(pose.vertices - cold.vertices).max() < 1e-2 * diagonal


def test_frames_of_a_sequence_are_poses(doubtful, targets):
    """Without smoothness every frame is the pose of its handles."""
    solver = HandleSolver(doubtful, noise=NOISE, freedom=1.0, relaxation=2)
    weights = np.ones((2, len(HANDLES)))
    weights[1, 3] = 0.0
    moved = np.stack([targets, np.add(targets, [0.0, 0.0, 0.2])])
    found = fit_sequence(doubtful, HANDLES, moved, weights=weights, smoothness=0.0, noise=NOISE)
    diagonal = doubtful.reference.bounding_diagonal
    for frame in range(2):
        seen = weights[frame] > 0
        solver.set_handles(HANDLES[seen], moved[frame, seen])
        pose = solver.solve()
        assert np.abs(found.vertices[frame] - pose.vertices).max() < 2e-3 * diagonal
        np.testing.assert_allclose(found.residual[frame, seen], pose.residual, atol=1e-3 * diagonal)


def test_uncertainty_grows_with_the_misfit(model, doubtful, targets):
    certain, doubting = (uncertainty(posed(m, targets)[0]) for m in (model, doubtful))
    assert (doubting.deviation > certain.deviation).all()
    assert doubting.gain.max() < 1
