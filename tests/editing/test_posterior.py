"""Uncertainty against sampling, and the promise of its suggestions."""

from dataclasses import replace

import numpy as np
import pytest

from deformer import HandleSolver, InputError, SurfacePoint
from deformer.editing import green_functions, uncertainty
from deformer.editing.misfit_field import rebuilding_error


def solved(model, vertices, **options):
    solver = HandleSolver(model, **options)
    solver.set_handles(vertices, model.decode(model.codes[2])[vertices])
    solver.solve()
    return solver


def test_deviation_is_that_of_sampled_shapes(model):
    """Without handles the posterior is the prior: draw codes close to it and look at shapes.

    What no code expresses is added.
    """
    solver = HandleSolver(model, rigid=False)
    solver.solve()
    share = 0.02  # small enough for shapes to be linear in codes
    y = np.random.default_rng(0).normal(size=(4000, model.components))
    shapes = model.decode(model.prior.mean + share * y @ model.prior.factor.T)
    field = solver.basis.misfit_field  # each vertex is a site
    missed = 3 * np.diag(field.covariance)[np.argsort(field.sites)]
    expected = np.sqrt(shapes.var(axis=0).sum(axis=1) / share**2 + missed)
    found = uncertainty(solver).deviation
    np.testing.assert_allclose(found, expected, rtol=0.06)


@pytest.mark.parametrize("freedom", [1.0, 0.02])
def test_gain_is_what_another_handle_takes_away(model, freedom):
    solver = solved(model, [4, 60], freedom=freedom)
    before = uncertainty(solver)
    for vertex in (before.suggestion, 17, 100):
        pose = solver.solve(warm=True)
        other = HandleSolver(model, freedom=freedom)
        other.set_handles([4, 60, vertex], [*(h.target for h in solver.handles),
                                            pose.vertices[vertex]])  # fmt: skip
        other.restore(pose.z, pose.rotation, pose.translation)
        after = uncertainty(other)
        left = (after.deviation**2).sum() / (before.deviation**2).sum()
        assert 1 - left == pytest.approx(before.gain[vertex], abs=0.02)


def test_the_suggestion_gains_most_and_is_no_handle_yet(model):
    handles = [4, 60, 119]
    found = uncertainty(solved(model, handles))
    assert found.suggestion not in handles
    assert found.gain[found.suggestion] == found.gain.max() <= 1
    assert found.gain.min() >= 0
    assert found.gain[handles].max() < 0.6 * found.gain.max()


def test_handles_hold_what_is_near_them(model):
    found = uncertainty(solved(model, [4, 60, 119]))
    assert found.deviation[[4, 60, 119]].max() < 0.5 * found.deviation.max()


def conditioned(C, h, R):
    """C (3V, 3V) given observations of the positions `h` (3H, 3V) with noise covariance R."""
    known = C @ h.T
    return C - known @ np.linalg.solve(h @ known + R, known.T)


@pytest.mark.parametrize("misfits", [(0.0, 0.0), (0.03, 0.03)])
def test_it_is_the_conditional_gaussian_of_prior_and_misfit(model, misfits):
    """Against dense matrices: tangents by differences, one formula for all vertices at once."""
    model = replace(model, handle_misfits=misfits)
    V, D = len(model.reference.vertices), model.reference.bounding_diagonal
    a, b, c = model.reference.faces[40].tolist()
    between = np.zeros(V)
    between[[a, b, c]] = 0.2, 0.3, 0.5
    places = np.vstack([np.eye(V)[[4, 60, 119]], between])
    weights, kinds = np.array([0.5, 1.0, 3.0, 2.0]), ["soft", "exact", "soft", "exact"]
    solver = HandleSolver(model, noise=0.02)
    targets = places @ model.decode(model.codes[2])
    vertices = [4, 60, 119, SurfacePoint((a, b, c), (0.2, 0.3, 0.5))]
    solver.set_handles(vertices, targets, weights, kinds=kinds)
    solver.solve()
    energy, x = solver.energy, np.asarray(solver.solution)

    def at(x):
        p = model.decode_centred(energy.code(x))
        return energy.move(x, p - p.mean(axis=0)).ravel()

    steps = 1e-4 * np.eye(len(x))
    J = np.stack([(at(x + h) - at(x - h)) / 2e-4 for h in steps], axis=1)
    P, _ = energy.prior_equations(x)
    K = model.poisson.foundation_rows(np.arange(V))
    K *= rebuilding_error(model, model.tangents(model.latent_mean)) ** 2 / np.diag(K).mean()
    C = J @ np.linalg.solve(P, J.T) + np.kron(K, np.eye(3))
    noise = np.where(np.array(kinds) == "soft", 0.02 / np.sqrt(weights), 1e-6) * D
    left = conditioned(C, np.kron(places, np.eye(3)), np.diag(np.repeat(noise**2, 3)))
    found = uncertainty(solver)
    expected = np.sqrt(np.diag(left).reshape(V, 3).sum(axis=1))
    np.testing.assert_allclose(found.deviation, expected, rtol=0.01, atol=5e-4 * D)
    assert found.deviation[60] < 1e-3 * D < found.deviation[4]
    for vertex in (found.suggestion, 20, 90):
        more = conditioned(
            left, np.kron(np.eye(V)[[vertex]], np.eye(3)), (0.02 * D) ** 2 * np.eye(3)
        )
        gain = 1 - np.trace(more) / np.trace(left)
        assert found.gain[vertex] == pytest.approx(gain, rel=0.02)


@pytest.mark.parametrize("kind", ["soft", "exact"])
def test_no_suggestion_repeats_a_handle(model, kind):
    """Suggested handles are placed one after the other, in a model of few examples, too."""
    solver = HandleSolver(replace(model, handle_misfits=(0.05, 0.05)), noise=0.05)
    shape, placed, total = model.decode(model.codes[2]), [60], np.inf
    for _ in range(12):
        solver.set_handles(placed, shape[placed], kinds=kind)
        solver.solve()
        found = uncertainty(solver)
        assert found.suggestion not in placed and not found.gain[placed].any()
        left = float(np.square(found.deviation).sum())
        assert left < total
        placed, total = [*placed, found.suggestion], left


def test_between_sites_gains_are_interpolated(model, monkeypatch):
    handles = [4, 60]
    every = uncertainty(solved(model, handles))
    monkeypatch.setattr(green_functions, "_SITES", 40)
    solver = solved(model, handles)
    assert not np.isin(handles, solver.basis.misfit_field.sites).any()
    some = uncertainty(solver)
    np.testing.assert_allclose(some.deviation, every.deviation, rtol=0.15)
    assert some.gain[some.suggestion] == pytest.approx(every.gain[some.suggestion], rel=0.2)
    assert np.corrcoef(some.gain, every.gain)[0, 1] > 0.9
    assert not some.gain[handles].any() and (some.gain >= 0).all()


def test_before_any_solution_there_is_none(model):
    with pytest.raises(InputError, match="solve"):
        uncertainty(HandleSolver(model))
