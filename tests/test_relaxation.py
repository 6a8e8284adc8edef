"""Truths of exact handles: the smallest change, and as-rigid-as-possible relaxation."""

import numpy as np
import pytest

from deformer.mesh import Mesh
from deformer.poisson import PoissonSystem
from deformer.relaxation import Relaxation, meet_exactly
from deformer.rotations import polar
from shapes import MESHES, bend, random_rotation

NAMES = pytest.mark.parametrize("name", MESHES)


def prepare(mesh, count=5, seed=0):
    """System, different handle vertices and their Green rows."""
    system = PoissonSystem(mesh)
    rng = np.random.default_rng(seed)
    vertices = np.sort(rng.choice(len(mesh.vertices), count, replace=False))
    return system, vertices, system.green_rows(vertices)


def relax(system, rest, green, vertices, targets, rounds):
    """Relaxed positions from a cold start."""
    return Relaxation(system).solve(system.laplacian @ rest, green, vertices, targets, rounds)


def rigidity_energy(system, rest, p):
    """Σ_i min_R Σ_j c_ij ‖(p_i − p_j) − R (rest_i − rest_j)‖² (Sorkine and Alexa 2007)."""
    rows = np.repeat(np.arange(len(p)), np.diff(system.indptr))
    new, old = p[rows] - p[system.rings], rest[rows] - rest[system.rings]
    B = np.zeros((len(p), 3, 3))
    np.add.at(B, rows, system.c[:, None, None] * new[:, :, None] * old[:, None, :])
    R = polar(B)[0][rows]
    return (system.c * ((new - np.einsum("eab,eb->ea", R, old)) ** 2).sum(axis=1)).sum()


@NAMES
def test_exact_handles_by_the_whole_constrained_system(name):
    """Against a dense solve of [L Eᵀ; E 0] for the change with the least Laplacian energy."""
    mesh = MESHES[name]
    system, vertices, green = prepare(mesh)
    rng = np.random.default_rng(1)
    p = bend(mesh.vertices, 1.0)
    targets = p[vertices] + rng.normal(size=(5, 3))
    found = meet_exactly(p, green, vertices, targets)
    np.testing.assert_array_equal(found[vertices], targets)
    V = len(p)
    E = np.eye(V)[vertices]
    matrix = np.block([[system.laplacian.toarray(), E.T], [E, np.zeros((5, 5))]])
    right = np.concatenate([np.zeros((V, 3)), targets - p[vertices]])
    np.testing.assert_allclose(found - p, np.linalg.solve(matrix, right)[:V], atol=1e-7)


@NAMES
def test_one_handle_moves_everything_along(name):
    mesh = MESHES[name]
    _, vertices, green = prepare(mesh, 1)
    move = np.array([1.0, -2, 3])
    found = meet_exactly(mesh.vertices, green, vertices, mesh.vertices[vertices] + move)
    np.testing.assert_allclose(found, mesh.vertices + move, atol=1e-8)


@NAMES
def test_handles_that_are_met_change_nothing(name):
    mesh = MESHES[name]
    system, vertices, green = prepare(mesh)
    for rest in (mesh.vertices, bend(mesh.vertices, 1.0)):
        for rounds in (0, 1, 5):
            found = relax(system, rest, green, vertices, rest[vertices], rounds)
            np.testing.assert_allclose(found, rest, atol=1e-8)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@NAMES
def test_all_vertices_moved_rigidly_are_a_rigid_motion(name, unit):
    mesh = Mesh(unit * MESHES[name].vertices, MESHES[name].faces)
    R = random_rotation(np.random.default_rng(2), 2.5)
    goal = mesh.vertices @ R.T + unit
    system = PoissonSystem(mesh)
    vertices = np.arange(len(goal))
    green = system.green_rows(vertices)
    for rounds in (0, 3):
        found = relax(system, mesh.vertices, green, vertices, goal, rounds)
        np.testing.assert_array_equal(found, goal)


@pytest.mark.parametrize("name", ["tube", "sphere"])
@pytest.mark.parametrize("angle", [0.3, 0.8, 2.0])
def test_some_vertices_moved_rigidly_take_the_rest_along(name, angle):
    """Rounds converge to the rigid motion, whose energy is zero."""
    mesh = MESHES[name]
    system, vertices, green = prepare(mesh, 12)
    R = random_rotation(np.random.default_rng(3), angle)
    goal = mesh.vertices @ R.T + [1, 2, 3]
    found = relax(system, mesh.vertices, green, vertices, goal[vertices], 600)
    np.testing.assert_allclose(found, goal, atol=2e-3 * mesh.bounding_diagonal)


@NAMES
def test_the_energy_of_rigidity_never_rises(name):
    mesh = MESHES[name]
    system, vertices, green = prepare(mesh, 6)
    rng = np.random.default_rng(4)
    rest = bend(mesh.vertices, 0.7)
    targets = rest[vertices] + 0.4 * rng.normal(size=(6, 3))
    energies = []
    for rounds in range(8):
        p = relax(system, rest, green, vertices, targets, rounds)
        np.testing.assert_allclose(p[vertices], targets, atol=1e-6 * mesh.bounding_diagonal)
        energies.append(rigidity_energy(system, rest, p))
    assert (np.diff(energies) <= 1e-9 * energies[0]).all(), energies
    assert energies[-1] < 0.9 * energies[0]


@NAMES
def test_rounds_in_several_calls_go_on_where_they_were(name):
    """A drag that stands still converges as one long solve does."""
    mesh = MESHES[name]
    system, vertices, green = prepare(mesh, 6)
    rest = bend(mesh.vertices, 0.7)
    targets = rest[vertices] + 0.2 * np.random.default_rng(6).normal(size=(6, 3))
    kept = Relaxation(system)
    energies = [
        rigidity_energy(
            system, rest, kept.solve(system.laplacian @ rest, green, vertices, targets, 2)
        )
        for _ in range(6)
    ]
    assert (np.diff(energies) <= 1e-9 * energies[0]).all(), energies
    once = rigidity_energy(system, rest, relax(system, rest, green, vertices, targets, 2))
    assert energies[0] == pytest.approx(once) and energies[-1] < once
    kept.reset()
    np.testing.assert_allclose(
        kept.solve(system.laplacian @ rest, green, vertices, targets, 2),
        relax(system, rest, green, vertices, targets, 2),
        atol=1e-12,
    )


def test_relaxation_does_not_depend_on_the_frame():
    mesh = MESHES["tube"]
    system, vertices, green = prepare(mesh, 6)
    rng = np.random.default_rng(5)
    rest = bend(mesh.vertices, 1.0)
    targets = rest[vertices] + 0.2 * rng.normal(size=(6, 3))
    R, t = random_rotation(rng), rng.normal(size=3)
    here = relax(system, rest, green, vertices, targets, 4)
    turned = relax(system, rest @ R.T + t, green, vertices, targets @ R.T + t, 4)
    np.testing.assert_allclose(turned, here @ R.T + t, atol=1e-8)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", ["at one point", "on a line", "turned over", "far"])
@NAMES
def test_impossible_targets_stay_finite(name, kind):
    mesh = MESHES[name]
    system, vertices, green = prepare(mesh, 6)
    targets = {
        "at one point": np.zeros((6, 3)),
        "on a line": np.outer(np.arange(6.0), [1, 1, 0]),
        "turned over": mesh.vertices[vertices] * [-1, -1, 1],
        "far": mesh.vertices[vertices] * 1e9,
    }[kind]
    found = relax(system, mesh.vertices, green, vertices, targets, 5)
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(found[vertices], targets)
