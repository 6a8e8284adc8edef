"""Truths of models with an error of their own: the shape deforms by what their codes miss."""

from dataclasses import replace

import numpy as np
import pytest

from deformer import HandleSolver, solve_to_rest
from deformer.editing.handle_errors import ModelErrors, whitening
from deformer.errors import InputError
from misfits import HANDLES, MISFIT, NOISE


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


def test_the_covariance_is_that_of_targets_and_of_the_model():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 8))
    K = A @ A.T
    weights = rng.uniform(0.2, 3.0, 6)
    covariance = NOISE**2 * np.diag(1 / weights) + MISFIT**2 * K
    W = whitening(weights, NOISE, MISFIT, K)
    np.testing.assert_allclose(W.T @ W, np.linalg.inv(covariance), rtol=1e-9, atol=1e-6)
    gain = ModelErrors(MISFIT, K).expected(weights, NOISE)
    np.testing.assert_allclose(gain, MISFIT**2 * K @ np.linalg.inv(covariance), atol=1e-9)


def test_a_handle_of_no_weight_tells_nothing():
    K = np.full((3, 3), 0.5) + 0.5 * np.eye(3)
    weights = np.array([[1.0, 0.0, 2.0], [1.0, 1.0, 1.0]])
    W = whitening(weights, NOISE, MISFIT, K)
    own = whitening(weights[0, [0, 2]], NOISE, MISFIT, K[np.ix_([0, 2], [0, 2])])
    assert (W[0][:, 1] == 0).all()
    precision = (W[0].T @ W[0])[np.ix_([0, 2], [0, 2])]
    np.testing.assert_allclose(precision, own.T @ own, rtol=1e-9)
    # Nor does it keep the others from telling where it is.
    assert ModelErrors(MISFIT, K).expected(weights, NOISE)[0, 1, 0] > 0.1


def test_near_handles_are_off_alike(model):
    basis = HandleSolver(model).basis
    tree = np.linalg.norm(model.reference.vertices - model.reference.vertices[0], axis=1)
    near, far = int(np.argsort(tree)[1]), int(tree.argmax())
    basis.set_points([0, near, far])
    K = basis.model_errors(1.0).correlation
    np.testing.assert_allclose(np.diag(K), 1.0)
    assert K[0, 1] > 0.5 > 0.1 > abs(K[0, 2]) and np.linalg.eigvalsh(K).min() > 0
    basis.set_points([far, 0])
    np.testing.assert_allclose(basis.model_errors(1.0).correlation[0, 1], K[0, 2], atol=1e-9)


def test_the_minimum_is_that_of_the_correlated_errors(doubtful, targets):
    """The gradient at the solution, by differences of an energy with the inverse covariance."""
    weights = np.geomspace(0.5, 2, len(HANDLES))
    solver, _ = posed(doubtful, targets, weights=weights)
    energy, x = solver.energy, np.asarray(solver.solution)
    assert energy.errors is not None
    covariance = NOISE**2 * np.diag(1 / weights) + MISFIT**2 * energy.errors.correlation
    precision = np.linalg.inv(covariance * energy.diagonal**2)

    def value(x):
        p = doubtful.decode(energy.code(x))
        off = energy.move(x, p - p.mean(axis=0))[HANDLES] - targets
        stiffness, cost = energy.stiffness(x)
        bent, _ = energy.excess_bending(x)
        own = np.einsum("hi,hg,gi->", off, precision, off)
        return own + stiffness @ x**2 + (bent**2).sum() + cost

    p = doubtful.decode(energy.code(x))
    here = value(x)
    np.testing.assert_allclose(energy.value(x, (p - p.mean(axis=0))[HANDLES]), here, rtol=1e-6)
    for n in range(len(x)):
        for h in (-1e-2, 1e-2):
            aside = x.copy()
            aside[n] += h
            assert value(aside) > here - 1e-4 * abs(here)


def test_soft_handles_keep_the_targets_share_of_their_error(doubtful, targets):
    weights = np.geomspace(0.1, 10, len(HANDLES))
    solver, pose = posed(doubtful, targets, weights=weights)
    energy, x = solver.energy, np.asarray(solver.solution)
    p = doubtful.decode(pose.z)
    p -= p.mean(axis=0)
    off = energy.move(x, p)[HANDLES] - targets
    assert energy.errors is not None
    kept = np.eye(len(HANDLES)) - energy.errors.expected(weights, energy.noise)
    expected = np.linalg.norm(kept @ off, axis=1)
    assert expected.max() > 1e-3 * energy.diagonal
    np.testing.assert_allclose(pose.residual, expected, atol=2e-4 * energy.diagonal)


def test_a_misfit_is_given_changed_and_taken_back(model, doubtful, targets):
    given = HandleSolver(model, noise=NOISE, misfit=MISFIT)
    given.set_handles(HANDLES, targets)
    _, expected = posed(doubtful, targets)
    np.testing.assert_allclose(given.solve().vertices, expected.vertices, atol=1e-9)
    given.set_prior(misfit=0.0)
    _, trusted = posed(model, targets)
    np.testing.assert_allclose(given.solve().vertices, trusted.vertices, atol=1e-9)
    with pytest.raises(InputError, match="misfit"):
        given.set_prior(misfit=-0.1)


def test_the_misfit_is_that_of_the_number_of_handles(model, targets):
    doubtful = replace(model, handle_misfits=(0.01, 0.04))
    middle = int(np.sqrt(5 * 40))
    found = [doubtful.misfit_of(n) for n in (0, 1, 5, middle, 40, 1000)]
    np.testing.assert_allclose(found[:3] + found[4:], [0.01, 0.01, 0.01, 0.04, 0.04])
    assert abs(found[3] - 0.02) < 1e-3
    trusted = replace(model, handle_misfits=(0.0, 0.04))
    assert [trusted.misfit_of(n) for n in (1, 5, 39, 40)] == [0.0, 0.0, 0.0, 0.04]
    trusted = replace(model, handle_misfits=(0.04, 0.0))
    assert [trusted.misfit_of(n) for n in (1, 5, 6, 40)] == [0.04, 0.04, 0.0, 0.0]
    solver = HandleSolver(doubtful)
    for count in (3, 10):
        solver.set_handles(HANDLES[:count], targets[:count])
        solver.solve()
        assert solver.energy.misfit == doubtful.misfit_of(count)
    solver.set_prior(misfit=0.2)
    solver.set_handles(HANDLES[:4], targets[:4])
    assert solver.energy.misfit == 0.2


def test_kinds_mix(doubtful, targets):
    exact = np.arange(len(HANDLES)) % 2 == 0
    _, pose = posed(doubtful, targets, hard=exact.tolist())
    assert pose.residual[exact].max() < 1e-9 < pose.residual[~exact].min()


@pytest.mark.parametrize("kind", ["soft", "exact"])
def test_a_drag_comes_to_rest_at_the_cold_solve(doubtful, targets, kind):
    diagonal = doubtful.reference.bounding_diagonal
    solver, cold = posed(doubtful, targets, kinds=kind)
    start = targets.copy()
    start[0] += 0.3 * diagonal
    solver.set_handles(HANDLES, start, kinds=kind)
    solver.solve()
    for s in np.linspace(0, 1, 6)[1:]:
        pose = solver.drag(int(HANDLES[0]), (1 - s) * start[0] + s * targets[0])
    dragged = pose.vertices
    pose = solve_to_rest(solver)
    assert solver.at_rest
    assert np.abs(pose.vertices - dragged).max() > 3e-3 * diagonal  # they were not there yet
    if kind == "exact":
        assert pose.residual.max() < 1e-9
    assert np.abs(pose.vertices - cold.vertices).max() < 2e-3 * diagonal
    for _ in range(20):
        assert np.array_equal(solver.solve(warm=True).vertices, pose.vertices)
    np.testing.assert_allclose(solver.relax().vertices, pose.vertices, atol=1e-7 * diagonal)
    assert solver.at_rest


def test_nothing_creeps_after_a_cold_solve(doubtful, targets):
    solver, cold = posed(doubtful, targets)
    assert solver.at_rest
    for _ in range(3):
        assert np.array_equal(solver.solve(warm=True).vertices, cold.vertices)
    cold.vertices[:] = 0.0  # the caller's own
    assert solver.solve(warm=True).vertices.any()


def test_a_rest_ends_with_the_handles_kind(doubtful, targets):
    solver, _ = posed(doubtful, targets)
    solver.set_handles(HANDLES, targets, kinds="exact")
    assert not solver.at_rest
    assert solver.solve(warm=True).residual.max() < 1e-9
    while not solver.at_rest:
        pose = solver.solve(warm=True)
    _, cold = posed(doubtful, targets, kinds="exact")
    diagonal = doubtful.reference.bounding_diagonal
    assert np.abs(pose.vertices - cold.vertices).max() < 2e-3 * diagonal


def test_what_drags_share_is_computed_once(doubtful, targets):
    solver, _ = posed(doubtful, targets)
    errors, vertex = solver.energy.errors, int(HANDLES[0])
    assert errors is not None
    weights, noise = solver.energy.weights, solver.energy.noise
    W, E = errors.whitening(weights, noise), errors.expected(weights, noise)
    solver.drag(vertex, targets[0] + 0.01)
    assert solver.energy.errors is errors
    assert errors.whitening(weights, noise) is W and errors.expected(weights, noise) is E
    for w, s in ((2 * weights, noise), (weights, 2 * noise), (weights, noise)):
        expected = whitening(w, s, MISFIT, errors.correlation)
        np.testing.assert_allclose(errors.whitening(w, s), expected, rtol=1e-12)
        np.testing.assert_allclose(
            errors.expected(w, s), MISFIT**2 * errors.correlation @ expected.T @ expected
        )
