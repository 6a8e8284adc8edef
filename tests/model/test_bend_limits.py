"""Truths of bend limits: examples lie inside, knees bend one way, and nothing else is changed."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from deformer import HandleSolver, MeshSequence, fit_sequence, load_model, train
from deformer.editing.unknowns import Unknowns
from deformer.geometry.geodesics import Geodesics
from deformer.model.bend_limits import choose_samples, fit_bend_limits
from shapes import bend, small_model, tube, two_components


@cache
def knee():
    """A tube that bends to one side only, and what was learned from it."""
    base = tube(8, 15)
    poses = np.stack([bend(base.vertices, angle) for angle in np.linspace(0, 1.2, 9)])
    shapes = MeshSequence(poses, base.faces)
    # Trusted with every target, so that limits alone keep it from bending the other way.
    return shapes, replace(train(shapes, 3, epochs=20, device="cpu"), handle_misfits=(0.0, 0.0))


def kinked(model, angle):
    """Handles at one end of the tube as it is, and at the other as if the tube were bent."""
    rest = model.reference.vertices
    x = rest[:, 0]
    handles = np.flatnonzero((x < x.min() + 0.2) | (x > x.max() - 0.05))[::3]
    return handles, bend(rest, angle)[handles]


@pytest.fixture(scope="module")
def model():
    return small_model()


def test_examples_are_inside(model):
    limits = model.bend_limits
    assert (limits.low <= limits.high).all() and (limits.slack > 0).all()
    assert not np.any(np.abs(limits.excess(model.codes)) > 1e-9)
    # And so is all between them: limits are half-spaces.
    mixed = np.random.default_rng(0).dirichlet(np.ones(len(model.codes)), 50) @ model.codes
    assert not np.any(np.abs(limits.excess(mixed)) > 1e-9)


def test_bends_are_rotations_of_neighbours_to_first_order(model):
    samples, pairs = choose_samples(model.geodesics)
    decoder = model.decoder_at(samples)
    limits = fit_bend_limits(decoder, pairs, model.latent_mean, model.codes)
    step = 1e-5 * np.random.default_rng(1).normal(size=model.components)
    r = [decoder.features(model.latent_mean + s * step)[:, :3] for s in (1, -1)]
    bends = [(turn[pairs[:, 0]] - turn[pairs[:, 1]]).ravel() for turn in r]
    np.testing.assert_allclose(
        limits.directions @ step, 0.5 * (bends[0] - bends[1]), atol=1e-5 * np.abs(step).max()
    )


def test_all_samples_have_neighbours():
    mesh = two_components()
    geodesics = Geodesics(mesh)
    samples, pairs = choose_samples(geodesics, 20)
    assert len(set(samples.tolist())) == len(samples)
    assert len({tuple(pair) for pair in pairs}) == len(pairs) and (pairs[:, 0] < pairs[:, 1]).all()
    assert set(pairs.ravel()) == set(range(len(samples)))


def test_of_a_mesh_of_fewer_vertices_all_are_samples():
    mesh = tube(4, 3)
    samples, _ = choose_samples(Geodesics(mesh), 96)
    assert sorted(samples) == list(range(12))


def test_the_derivative_is_that_of_differences(model):
    energy = HandleSolver(model).energy
    x = np.zeros(energy.size)
    Unknowns(x).code = 4.0 * np.random.default_rng(2).normal(size=energy.components)
    b, slope = energy.excess_bending(x)
    assert len(b) > 0
    for k in range(energy.components):
        there = [x.copy(), x.copy()]
        there[0][k] += 1e-6
        there[1][k] -= 1e-6
        ahead, behind = (energy.excess_bending(at)[0] for at in there)
        np.testing.assert_allclose((ahead - behind) / 2e-6, slope[:, k], rtol=1e-5, atol=1e-5)
    many, slopes = energy.excess_bending(np.stack([x, 0.5 * x]))
    np.testing.assert_allclose((many[0] ** 2).sum(), (b**2).sum())
    np.testing.assert_allclose(
        np.einsum("nk,n->k", slopes[0], many[0]), slope.T @ b, rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize("warm", [False, True], ids=["cold", "dragged"])
def test_a_knee_bends_one_way(warm):
    _, model = knee()
    reached = {}
    for name, limits in (("limited", model.bend_limits), ("free", None)):
        solver = HandleSolver(replace(model, bend_limits=limits), noise=0.02, freedom=1.0)
        handles, _ = kinked(model, 0.0)
        solver.set_handles(handles, model.reference.vertices[handles])
        solver.solve()
        for angle in np.linspace(0, -0.8, 9)[1:] if warm else (-0.8,):
            solver.set_handles(handles, kinked(model, angle)[1])
            pose = solver.solve(warm=warm)
        reached[name] = limits_of(model, pose.z)
    # Without limits it goes as far to the side that no example shows; with them hardly.
    assert reached["free"] > 1.5
    assert reached["limited"] < 0.1 * reached["free"]


def limits_of(model, z):
    """The farthest that any bend goes beyond the examples, in slacks."""
    return np.abs(model.bend_limits.excess(z)).max()


def test_a_knee_bends_as_the_examples_do():
    """To their side limits cost nothing."""
    shapes, model = knee()
    handles, _ = kinked(model, 0.0)
    for shape in shapes.vertices[[3, 6, 8]]:
        poses = []
        for limits in (model.bend_limits, None):
            solver = HandleSolver(replace(model, bend_limits=limits), noise=0.007)
            solver.set_handles(handles, shape[handles])
            poses.append(solver.solve().vertices)
        size = model.reference.bounding_diagonal
        assert np.abs(poses[0] - poses[1]).max() < 2e-3 * size
        assert np.abs(poses[0] - shape).max() < 0.02 * size


def test_sequences_keep_them_too():
    _, model = knee()
    handles, _ = kinked(model, 0.0)
    goals = np.stack([kinked(model, angle)[1] for angle in np.linspace(0, -0.8, 12)])
    kept = fit_sequence(model, handles, goals, noise=0.02)
    free = fit_sequence(replace(model, bend_limits=None), handles, goals, noise=0.02)
    assert limits_of(model, kept.z[-1]) < 0.1 * limits_of(model, free.z[-1])


def test_they_are_kept_with_the_model(model, tmp_path):
    model.save(tmp_path / "with")
    again = load_model(tmp_path / "with")
    for name, array in model.bend_limits.arrays.items():
        np.testing.assert_array_equal(again.bend_limits.arrays[name], array)
    assert again.fingerprint == model.fingerprint
    replace(model, bend_limits=None).save(tmp_path / "without")
    unlimited = load_model(tmp_path / "without")
    assert unlimited.bend_limits is None
    assert unlimited.fingerprint != model.fingerprint
