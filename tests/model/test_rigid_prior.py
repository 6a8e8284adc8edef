"""Truths of the prior of rigid motions: what is fitted is what was put in, and handles feel it."""

from dataclasses import replace

import numpy as np
import pytest

from deformer import HandleSolver, load_model
from deformer.geometry.rotations import log_to_rotation
from deformer.model.rigid_prior import (
    DIFFUSE_PRIOR,
    RigidPrior,
    diffuse_prior_cost,
    fit_rigid_prior,
)
from shapes import icosphere, small_model

TIGHT = RigidPrior(0.02, 0.005)


@pytest.mark.parametrize(("rotation", "translation"), [(0.05, 0.1), (0.2, 0.01), (0.0, 0.0)])
def test_motions_are_found_again(rotation, translation):
    rng = np.random.default_rng(0)
    shape = icosphere(1).vertices * [1.0, 0.7, 0.4]
    R = log_to_rotation(rotation * rng.normal(size=(400, 3)))
    moved = shape @ R.transpose(0, 2, 1) + 3.0 * translation * rng.normal(size=(400, 1, 3))
    codes = rng.normal(size=(400, 2))
    found = fit_rigid_prior(codes, np.repeat(shape[None], 400, axis=0), moved, 3.0)
    # A little is believed before any shape is seen: 0.01, as if by one shape.
    assert found.rotation == pytest.approx(np.hypot(rotation, 0.01 / 20), rel=0.1)
    assert found.translation == pytest.approx(np.hypot(translation, 0.01 / 20), rel=0.1)


def test_where_shapes_of_a_code_stand_is_learned():
    """A linear law is found again, of more codes than examples too; what has none is only mean."""
    rng = np.random.default_rng(1)
    shape = icosphere(1).vertices
    shape = shape - shape.mean(axis=0)
    offset, gain = np.array([0.3, -0.2, 0.1]), rng.normal(size=(3, 4))
    codes = rng.normal(size=(60, 4))
    moved = shape + 2.0 * (offset + codes @ gain.T + 1e-4 * rng.normal(size=(60, 3)))[:, None]
    decoded = np.repeat(shape[None], 60, axis=0)
    found = fit_rigid_prior(codes, decoded, moved, 2.0)
    fresh = rng.normal(size=(5, 4))
    np.testing.assert_allclose(found.centroid(fresh), offset + fresh @ gain.T, atol=1e-3)
    assert found.translation < 2e-3
    noise = fit_rigid_prior(rng.normal(size=(60, 90)), decoded, moved, 2.0)
    np.testing.assert_allclose(noise.centroid(np.zeros(90)), moved.mean((0, 1)) / 2.0, atol=0.3)
    spread = (moved.mean(axis=1) / 2.0).std()
    assert 0.5 * spread < noise.translation < 1.5 * spread


def test_examples_stand_where_they_were_where_that_cannot_be_told_from_better():
    """A law with a small part that the codes cannot tell."""
    decoded = np.repeat(_ball()[None], 12, axis=0)
    kept = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        codes = rng.normal(size=(12, 40)) * np.geomspace(1.0, 0.05, 40)
        law = codes @ rng.normal(size=(40, 3)) + 0.1 * rng.normal(size=(12, 3))
        found = fit_rigid_prior(codes, decoded, decoded + 2.0 * law[:, None], 2.0)
        kept.append(np.abs(found.centroid(codes) - law).max() < 1e-3 * law.std())
    assert sum(kept) >= 6


def test_codes_that_tell_nothing_move_nothing():
    """Exact examples would need large gains, with which other codes go anywhere."""
    rng = np.random.default_rng(0)
    decoded = np.repeat(_ball()[None], 200, axis=0)
    noise, codes = rng.normal(size=(200, 3)), rng.normal(size=(200, 150))
    found = fit_rigid_prior(codes, decoded, decoded + 2.0 * noise[:, None], 2.0)
    assert found.centroid(codes).std() < 0.5 * noise.std()


def _ball():
    v = icosphere(1).vertices
    return v - v.mean(axis=0)


def test_the_tighter_the_more_freedom_costs():
    tighter = diffuse_prior_cost(RigidPrior(0.01, 0.005))
    assert tighter == pytest.approx(diffuse_prior_cost(TIGHT) + 6 * np.log(2))
    assert diffuse_prior_cost(TIGHT) > diffuse_prior_cost(DIFFUSE_PRIOR) > 0


@pytest.fixture(scope="module")
def model():
    return replace(small_model(), rigid_prior=TIGHT)


def test_a_lone_handle_bends_the_body_and_does_not_carry_it(model):
    v = model.reference.vertices
    goal = v[[100]] + [0, 0.03 * model.reference.bounding_diagonal, 0]
    poses = {}
    for freedom in (None, 1.0):
        solver = HandleSolver(model, noise=0.007, freedom=freedom)
        solver.set_handles([100], goal)
        poses[freedom] = np.linalg.norm(solver.solve().translation)
    assert poses[None] < 0.3 * poses[1.0]


def test_handles_far_away_take_the_body_along(model):
    diagonal = model.reference.bounding_diagonal
    chosen = [3, 40, 60, 100]
    there = model.reference.vertices @ log_to_rotation([0, 0.8, 0]).T + [5.0 * diagonal, 0, 0]
    solver = HandleSolver(model)
    solver.set_handles(chosen, there[chosen])
    pose = solver.solve()
    # Five diagonals away even one diagonal as a deviation still pulls a little.
    assert pose.residual.max() < 0.02 * diagonal
    assert np.linalg.norm(pose.vertices - there, axis=1).max() < 0.1 * diagonal
    near, cost = solver.energy.stiffness(np.zeros(solver.energy.size))
    assert cost == 0 and near[-1] == pytest.approx(0.005**-2)


def test_a_drag_away_is_followed_without_end(model):
    """Warm frames leave the training shapes' place when it is dearer than any place."""
    diagonal = model.reference.bounding_diagonal
    chosen = [3, 40, 60, 100]
    solver = HandleSolver(model)
    solver.set_handles(chosen, model.reference.vertices[chosen])
    solver.solve()
    for step in np.linspace(0, 2.0 * diagonal, 40):
        solver.set_handles(chosen, model.reference.vertices[chosen] + [step, 0, 0])
        pose = solver.solve(warm=True)
    for _ in range(3):
        pose = solver.solve(warm=True)
    assert pose.residual.max() < 0.02 * diagonal


def test_a_code_brings_its_place_along(model):
    """Without handles, and to a handle's derivative."""
    K = model.components
    offset, gain = np.array([0.1, 0.2, -0.3]), 0.05 * np.random.default_rng(2).normal(size=(3, K))
    placed = replace(model, rigid_prior=RigidPrior(0.02, 0.005, offset, gain))
    z = model.codes[0]
    solver = HandleSolver(placed)
    solver.set_prior(mean=z)
    place = model.reference.bounding_diagonal * (offset + gain @ z)
    away = model.decode(z) - model.decode(z).mean(axis=0) + model.reference.vertices.mean(axis=0)
    np.testing.assert_allclose(placed.decode(z), away + place, atol=1e-9)
    np.testing.assert_allclose(solver.solve().vertices, placed.decode(z), atol=1e-4)
    energy = solver.energy
    x = 0.1 * np.random.default_rng(3).normal(size=energy.size)
    p, dp = np.zeros((1, 3)), np.zeros((1, 3, K))
    slope = energy.tangents(x, p, dp)[0]
    for n in range(energy.size):
        step = 1e-6 * (np.arange(energy.size) == n)
        change = (energy.move(x + step, p) - energy.move(x - step, p))[0] / 2e-6
        np.testing.assert_allclose(slope[:, n], change, atol=1e-6)


def test_it_is_kept_with_the_model(model, tmp_path):
    K = model.components
    rigid_prior = RigidPrior(0.02, 0.005, np.arange(3.0), np.arange(3.0 * K).reshape(3, K))
    for stands in (TIGHT, rigid_prior):
        replace(model, rigid_prior=stands).save(tmp_path / "placed")
        found = load_model(tmp_path / "placed").rigid_prior
        assert found.deviations == stands.deviations
        assert found.arrays.keys() == stands.arrays.keys()
        for name, array in stands.arrays.items():
            np.testing.assert_array_equal(found.arrays[name], array)
    replace(model, rigid_prior=None).save(tmp_path / "placed")
    assert load_model(tmp_path / "placed").rigid_prior is None
