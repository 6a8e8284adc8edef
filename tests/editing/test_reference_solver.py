"""Truths of the plain handle solver that the fast one is held against."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import sparse
from scipy.spatial.transform import Rotation

from deformer import AdamSettings, DeformationModel, FeatureScaler, HandleSolver, ModelConfig, train
from deformer.geometry.mesh import site_rings
from deformer.model.latent_prior import fit_prior
from networks import random_network
from paths import ROOT
from scripts import module_of
from settings import QUICK_ADAM
from shapes import awkward, sequence, small_model, tube, two_components

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("error")]
BOTH = pytest.mark.parametrize("layers", [(9,), (7, 5)], ids=["one layer", "two layers"])


ReferenceSolver = module_of(ROOT / "benchmarks" / "reference_solver.py").ReferenceSolver


@cache
def trained(layers):
    if layers == (9,):
        return small_model()
    training = replace(QUICK_ADAM, layers=layers, epochs=150, mixed_shapes=0)
    config = ModelConfig(name="deep", components=4, training=training)
    return train(sequence(), config=config, device="cpu")


def untrained(mesh, layers, components=4, size=0.3, turn=2.0):
    """A model with random weights of some size and rotation vectors up to `turn`."""
    network, _ = random_network(mesh, layers, components, size)
    codes = np.random.default_rng(0).normal(size=(12, components))
    config = ModelConfig("random", components, AdamSettings(layers))
    scaler = FeatureScaler(-turn, turn, -0.3, 1.8)
    return DeformationModel(mesh, config, scaler, network.weights, codes, fit_prior(codes), {})


def gradients(model, z):
    """Decoded gradients (V+B, 3, 3) of vertices and links by formula, in double precision."""
    indptr, rings = site_rings(model.reference)
    V, degree = len(indptr) - 1, np.diff(indptr)
    mean = sparse.csr_array((1.0 / np.repeat(degree, degree), rings, indptr), shape=(V, V))
    weights = {name: w.astype(np.float64) for name, w in model.weights.arrays.items()}
    x = weights["C"] @ z
    for n in reversed(range(len(model.config.layers))):
        point, neighbour = weights[f"convs.{n}.point"], weights[f"convs.{n}.neighbour"]
        x = np.tanh(x @ point + (mean @ x) @ neighbour + weights[f"convs.{n}.bias_back"])
    q = model.scaler.unscale(x)
    S = q[:, [3, 4, 5, 4, 6, 7, 5, 7, 8]].reshape(-1, 3, 3)
    return Rotation.from_rotvec(q[:, :3]).as_matrix() @ S


def decoded(model, z):
    """Decoded shape (V, 3) in double precision; the model's own decoder may round."""
    p = model.poisson.solve(gradients(model, z))
    place = 0 if model.rigid_prior is None else model.rigid_prior.centroid(z)
    return p + model.reference.bounding_diagonal * place


def edit(model, seed):
    """Handles at random vertices, their targets near those of a random shape of the prior."""
    rng = np.random.default_rng(seed)
    vertices = rng.choice(120, rng.integers(1, 8), replace=False)
    z = model.prior.mean + model.prior.factor @ rng.normal(size=model.components)
    noise = 0.02 * model.reference.bounding_diagonal * rng.normal(size=(len(vertices), 3))
    return vertices, model.decode(z)[vertices] + noise


def unknowns(model, pose):
    y = np.linalg.solve(model.prior.factor, pose.z - model.prior.mean)
    return np.concatenate([y, pose.rotation, pose.translation / model.reference.bounding_diagonal])


def distance(a, b):
    return np.linalg.norm(a - b, axis=-1).max()


def search_once(*solvers):
    """Have solvers of the same handles share one search, which does not depend on the rounds."""
    found = solvers[0]._search()
    for solver in solvers:
        solver._search = lambda: found


def relaxed_energy(model, pose, p):
    """Σ_i min over R_i of Σ_j c_ij ‖(p_i − p_j) − R_i (x_i − x_j)‖², x the decoded shape."""
    x, weights = model.decode(pose.z), model.poisson.weights
    total = 0.0
    for i in range(len(x)):
        ring = slice(*weights.indptr[i : i + 2])
        j, c = weights.indices[ring], weights.data[ring]
        fit = Rotation.align_vectors(p[i] - p[j], x[i] - x[j], weights=c)
        total += fit[1] ** 2
    return total


@pytest.mark.parametrize("mesh", [tube(), awkward(), two_components()], ids=["a", "b", "c"])
@pytest.mark.parametrize("layers", [(9,), (6,), (7, 5), (6, 5, 4)], ids=str)
def test_decodes_as_the_model(mesh, layers):
    model = untrained(mesh, layers)
    solver = ReferenceSolver(model)
    for z in np.random.default_rng(1).normal(size=(3, 4)):
        np.testing.assert_allclose(solver.decode(z), decoded(model, z), rtol=0, atol=1e-9)
        np.testing.assert_allclose(solver.decode(z), model.decode(z), rtol=0, atol=1e-6)


@BOTH
def test_decodes_as_the_trained_model(layers):
    model = trained(layers)
    solver = ReferenceSolver(model)
    for z in model.codes:
        np.testing.assert_allclose(solver.decode(z), decoded(model, z), rtol=0, atol=1e-9)
        np.testing.assert_allclose(solver.decode(z), model.decode(z), rtol=0, atol=1e-6)


def test_no_handles_give_the_mean():
    model = small_model()
    pose = ReferenceSolver(model).solve()
    np.testing.assert_allclose(pose.vertices, decoded(model, model.prior.mean), atol=1e-9)
    assert pose.energy == 0 and pose.residual.shape == (0,)


@BOTH
@pytest.mark.parametrize("seed", range(2))
def test_energy_by_formula(layers, seed):
    model = trained(layers)
    solver, D = ReferenceSolver(model, noise=0.02), model.reference.bounding_diagonal
    rng = np.random.default_rng(seed)
    vertices, targets = edit(model, seed)
    weights = rng.uniform(0.5, 2, len(vertices))
    solver.set_handles(vertices, targets, weights)
    x = rng.normal(size=model.components + 6)
    x[:-6] *= 5.0  # beyond what the examples bend
    centre = model.reference.vertices.mean(axis=0)
    p = decoded(model, model.prior.mean + model.prior.factor @ x[:-6])[vertices] - centre
    p = Rotation.from_rotvec(x[-6:-3]).apply(p) + centre + D * x[-3:]
    expected = (weights[:, None] * (p - targets) ** 2).sum() / (0.02 * D) ** 2
    expected += (x[:-6] ** 2).sum()
    limits = model.bend_limits
    bends = limits.directions @ (model.prior.mean + model.prior.factor @ x[:-6])
    outside = np.maximum(np.maximum(bends - limits.high, limits.low - bends), 0) / limits.slack
    assert outside.any()
    expected += (outside**2).sum()
    rotation, translation = (x[-6:-3] ** 2).sum(), (x[-3:] ** 2).sum()
    near = model.rigid_prior
    odds = 2 * np.log(0.99 / 0.01) + 6 * np.log(0.3 / near.rotation / near.translation)
    anywhere = rotation / 0.09 + translation + odds
    motion = min(rotation / near.rotation**2 + translation / near.translation**2, anywhere)
    assert solver.energy(x) == pytest.approx(expected + motion, rel=1e-9)
    fast = HandleSolver(model, noise=0.02).energy
    assert fast.stiffness(x)[0][-6:] @ x[-6:] ** 2 + fast.stiffness(x)[1] == pytest.approx(motion)
    assert fast.stiffness(0.001 * x)[1] == 0


@BOTH
@pytest.mark.parametrize("rigid", [True, False])
def test_the_solution_is_stationary(layers, rigid):
    model = trained(layers)
    solver = ReferenceSolver(model, rigid=rigid)
    solver.set_handles(*edit(model, 0))
    pose = solver.solve()
    x = unknowns(model, pose)
    assert solver.energy(x) == pytest.approx(pose.energy, rel=1e-9)
    assert rigid or not x[-6:].any()
    h = 1e-3
    for e in h * np.eye(len(x))[: None if rigid else -6]:
        below, above = solver.energy(x - e), solver.energy(x + e)
        curvature = below - 2 * pose.energy + above
        assert curvature > 0
        # How far along this unknown the energy's parabola has its minimum.
        assert abs(0.5 * h * (below - above) / curvature) < 1e-5


@pytest.mark.parametrize("seed", range(6))
def test_agrees_with_the_fast_solver(seed):
    agree(small_model(), seed, rigid=seed % 5 > 0)


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_agrees_with_the_fast_solver_on_two_layers(seed):
    agree(trained((7, 5)), seed, rigid=True)


def agree(model, seed, rigid):
    """Soft handles: the same minimum, or that of the oracle is the lower."""
    vertices, targets = edit(model, seed)
    poses = []
    for kind in (ReferenceSolver, HandleSolver):
        # A noise that is given is kept: the default one grows with targets out of reach.
        solver = kind(model, rigid=rigid, noise=model.handle_noise)
        solver.set_handles(vertices, targets)
        poses.append(solver.solve())
    oracle, fast = poses
    # What the fast solver reports is its own estimate: its unknowns are judged by the oracle.
    judge = ReferenceSolver(model, noise=model.handle_noise)
    judge.set_handles(vertices, targets)
    reached = judge.energy(unknowns(model, fast))
    assert oracle.energy <= reached * (1 + 1e-6)
    if reached < oracle.energy * (1 + 1e-3):
        assert distance(oracle.vertices, fast.vertices) < 1e-3 * model.reference.bounding_diagonal


@pytest.mark.parametrize("seed", [4, 8, 9])
def test_cold_solves_leave_local_minima(seed):
    """A wild decoder, which a descent from the mean alone leaves far from the answer."""
    model = untrained(tube(), (6,), components=2, size=1.0, turn=4.0)
    vertices = np.random.default_rng(seed).choice(120, 2, replace=False)
    solver = ReferenceSolver(model, rigid=False, noise=0.05)
    solver.set_handles(vertices, decoded(model, model.codes[seed])[vertices])
    y = np.linalg.solve(model.prior.factor, model.codes[seed] - model.prior.mean)
    pose = solver.solve()
    # The training code itself meets the handles.
    assert pose.energy < y @ y
    assert pose.energy == pytest.approx(solver.solve(warm=True).energy, rel=1e-9)


def test_duplicates_are_one_handle():
    model = small_model()
    solver = ReferenceSolver(model)
    targets = model.reference.vertices[[5, 60, 5]] + [[0, 0, 0], [0, 0.3, 0], [0, 0.2, 0.1]]
    solver.set_handles([5, 60, 5], targets, [1.0, 1.0, 2.0])
    twice = solver.solve()
    mean = (targets[0] + 2 * targets[2]) / 3
    solver.set_handles([60, 5], [targets[1], mean], [1.0, 3.0])
    once = solver.solve()
    np.testing.assert_allclose(twice.vertices, once.vertices, atol=1e-9)
    expected = np.linalg.norm(twice.vertices[[5, 60, 5]] - targets, axis=1)
    np.testing.assert_allclose(twice.residual, expected, atol=1e-12)


@pytest.mark.parametrize("mesh", [tube(), awkward(), two_components()], ids=["a", "b", "c"])
def test_hard_handles_are_met(mesh):
    """By handle, on every kind of mesh; the others only nearly."""
    model = untrained(mesh, (6, 5), components=2)
    solver = ReferenceSolver(model, noise=0.1)
    vertices = [100, 3, 20, 21, 60]
    rng = np.random.default_rng(2)
    targets = model.decode(model.codes[3])[vertices] + 0.05 * rng.normal(size=(5, 3))
    solver.set_handles(vertices, targets, hard=[False, True, True, True, False])
    for pose in (solver.solve(), solver.solve(warm=True), solver.solve(warm=True)):
        assert np.isfinite(pose.vertices).all()
        assert not pose.residual[1:4].any() and pose.residual[[0, 4]].min() > 1e-6


@BOTH
def test_rounds_descend_to_a_stationary_pose(layers):
    model = trained(layers)
    vertices, targets = edit(model, 3)
    descends(model, vertices[:3], targets[:3])


def test_rounds_do_not_mirror():
    """Handles that ask for the mirror image get rotations all the same."""
    vertices = np.arange(40, 80, 3)
    descends(small_model(), vertices, small_model().reference.vertices[vertices] * [1, 1, -1])


def descends(model, vertices, targets):
    """Hard handles: more rounds, less energy; after many neither step changes anything."""
    solvers = [ReferenceSolver(model, noise=1.0, relaxation=n) for n in (0, 3, 600, 601)]
    for solver in solvers:
        solver.set_handles(vertices, targets, hard=True)
    search_once(*solvers)
    poses = [solver.solve() for solver in solvers]
    energies = [relaxed_energy(model, pose, pose.vertices) for pose in poses]
    assert energies[0] > energies[1] > energies[2]
    np.testing.assert_allclose(poses[3].vertices, poses[2].vertices, atol=1e-4)


def test_no_rounds_are_the_schur_complement():
    """Of all poses with the handles met, the nearest to the decoded one as a plate bends."""
    model = small_model()
    vertices, targets = edit(model, 4)
    solver = ReferenceSolver(model, rigid=False, relaxation=0)
    solver.set_handles(vertices, targets, hard=True)
    pose = solver.solve()
    L, (v, f) = model.poisson.laplacian, (model.reference.vertices, model.reference.faces)
    double = np.linalg.norm(np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]]), axis=1)
    area = np.bincount(f.ravel(), np.repeat(double / 6, 3), len(v))
    bent = L @ (pose.vertices - decoded(model, pose.z))
    force = L @ (bent / (100.0 * area / area.sum())[:, None]) + bent
    free = np.setdiff1d(np.arange(120), vertices)
    np.testing.assert_allclose(force[free], 0, atol=1e-9)
    assert np.abs(force[vertices]).max() > 1e-3


def test_warm_solves_go_on_with_the_rotations():
    """The first repeats the cold solve's last global step; later ones go on towards the limit."""
    model = small_model()
    vertices, targets = edit(model, 5)
    solver, longer = (ReferenceSolver(model, relaxation=n) for n in (3, 200))
    for each in (solver, longer):
        each.set_handles(vertices, targets, hard=True)
    search_once(solver, longer)
    cold, first, second = solver.solve(), solver.solve(warm=True), solver.solve(warm=True)
    diagonal = model.reference.bounding_diagonal
    assert distance(first.vertices, cold.vertices) < 1e-6 * diagonal
    limit = longer.solve().vertices
    assert distance(second.vertices, limit) < 0.9 * distance(first.vertices, limit)
    assert distance(second.vertices, first.vertices) > 1e-4 * diagonal
    np.testing.assert_allclose(solver.solve().vertices, cold.vertices, atol=1e-12)


def test_warm_solves_follow_a_drag():
    model = small_model()
    vertices, targets = edit(model, 6)
    solver = ReferenceSolver(model)
    solver.set_handles(vertices, targets)
    solver.solve()
    solver.set_handles(vertices, targets + 0.02)
    warm, cold = solver.solve(warm=True), solver.solve()
    assert warm.iterations < cold.iterations
    assert distance(warm.vertices, cold.vertices) < 1e-4 * model.reference.bounding_diagonal


@pytest.mark.parametrize("seed", range(3))
def test_agrees_with_the_fast_solver_on_hard_handles(seed):
    """With rigid relaxation, which both take in as many rounds."""
    model = small_model()
    vertices, targets = edit(model, seed)
    poses = []
    for kind in (ReferenceSolver, HandleSolver):
        solver = kind(model, noise=model.handle_noise, relaxation=10)
        solver.set_handles(vertices, targets, hard=True)
        poses.append(solver.solve())
    assert poses[0].energy == pytest.approx(poses[1].energy, rel=1e-4)
    apart = distance(poses[0].vertices, poses[1].vertices)
    assert apart < 1e-3 * model.reference.bounding_diagonal


@pytest.mark.parametrize("seed", range(2))
def test_agrees_with_the_fast_solver_after_a_drag(seed):
    """Three frames after the mouse has stopped."""
    model = small_model()
    vertices, targets = edit(model, seed)
    diagonal = model.reference.bounding_diagonal
    way = 0.1 * diagonal * np.random.default_rng(seed).normal(size=3) / 3**0.5
    poses = []
    for kind in (ReferenceSolver, HandleSolver):
        solver = kind(model, noise=model.handle_noise)
        solver.set_handles(vertices, targets)
        solver.solve()
        for share in (0.25, 0.5, 0.75, 1.0, 1.0, 1.0, 1.0):
            moved = targets.copy()
            moved[0] += share * way
            solver.set_handles(vertices, moved)
            pose = solver.solve(warm=True)
        poses.append(pose)
    assert poses[0].energy == pytest.approx(poses[1].energy, rel=1e-4)
    assert distance(poses[0].vertices, poses[1].vertices) < 1e-3 * diagonal
