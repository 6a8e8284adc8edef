"""Truths of the frame: decoded gradients, exact handles, and rigid relaxation."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deformer.acap.features import FeatureExtractor
from deformer.acap.gradients import features_to_gradients
from deformer.acap.poisson import PoissonSystem
from deformer.editing.arap import DecodedSurface
from deformer.editing.exact_rows import schur_inverse
from deformer.editing.kernels import fit_step
from deformer.geometry.mesh import Mesh, MeshSequence
from deformer.geometry.rotations import log_to_rotation, polar
from distances import largest
from shapes import MESHES, bend, icosphere, random_rotation

NAMES = pytest.mark.parametrize("name", MESHES)
NOWHERE = np.eye(3), np.zeros(3)


class Given:
    """A decoder that gives the same features for every code."""

    pointwise = False
    components = 2
    gain, offset = np.ones(9), np.zeros(9)

    def __init__(self, q):
        self.q = q

    def single_features(self, z):
        return self.q


def decoder_of(mesh, vertices):
    """Of the features that take the mesh to `vertices`."""
    shapes = MeshSequence(np.stack([mesh.vertices, vertices]), mesh.faces)
    return Given(FeatureExtractor(shapes.mesh(0)).extract_sites(vertices))


def prepare(mesh, rest, count=5, seed=0):
    """Surface in the pose `rest` with exact handles; the handle vertices and the system."""
    return prepare_decoder(mesh, decoder_of(mesh, rest), count, seed)


def prepare_decoder(mesh, decoder, count=5, seed=0):
    """The same in the pose that a decoder gives."""
    system = PoissonSystem(mesh)
    surface = DecodedSurface(decoder, system)
    V = len(mesh.vertices)
    vertices = np.sort(np.random.default_rng(seed).choice(V, count, replace=False))
    hold(surface, vertices, system)
    surface.decode(np.zeros(2))
    return surface, vertices, system


def hold(surface, vertices, system):
    rows = system.green_rows(vertices)
    surface.set_exact(vertices, [surface.ordered(row) for row in rows], rows[:, vertices])


def solve(surface, targets):
    surface.solve()
    surface.move_to_targets(targets)
    return surface.positions(*NOWHERE)


def relax(surface, targets, rounds, steps=8):
    p = solve(surface, targets)
    for _ in range(rounds):
        surface.relax(steps)
        p = solve(surface, targets)
    return p


def rigidity_energy(system, x, p):
    """Σ_i min_R Σ_j c_ij ‖(p_i − p_j) − R (x_i − x_j)‖²."""
    rows = np.repeat(np.arange(len(p)), np.diff(system.indptr))
    new, old = p[rows] - p[system.rings], x[rows] - x[system.rings]
    B = np.zeros((len(p), 3, 3))
    np.add.at(B, rows, system.c[:, None, None] * new[:, :, None] * old[:, None, :])
    R = polar(B)[0][rows]
    return (system.c * ((new - np.einsum("eab,eb->ea", R, old)) ** 2).sum(axis=1)).sum()


@pytest.mark.parametrize("name", [*MESHES, "ball"])
def test_decoded_gradients_and_positions(name):
    """Against double precision; features of many turns, negative and past half a turn, too."""
    mesh = MESHES[name] if name in MESHES else icosphere(3)
    system = PoissonSystem(mesh)
    V = len(mesh.vertices)
    q = 4.0 * np.random.default_rng(0).normal(size=(V + len(mesh.links), 9))
    q[0, :3] = 0.0
    q[1, :3] = [0, 0, np.pi]
    q[2, :3] = [0, 40.0, 0]
    surface = DecodedSurface(Given(q), system)
    vertices = np.array([1, V // 2, V - 1])
    coefficients = system.position_coefficients(system.green_rows(vertices))
    surface.set_handles_by_block([surface.block_coefficients(a) for a in coefficients])
    T = features_to_gradients(q)
    found = surface.decode(np.zeros(2))
    np.testing.assert_allclose(surface.gradients, T[:V], atol=2e-5 * np.abs(T).max())
    expected = system.solve(T) - system.centroid
    size = np.abs(expected).max()
    np.testing.assert_allclose(found, expected[vertices], atol=1e-5 * size)
    surface.solve()
    surface.move_to_targets(np.zeros((0, 3)))
    np.testing.assert_allclose(surface.positions(*NOWHERE), expected, atol=2e-5 * size)
    R = random_rotation(np.random.default_rng(1), 1.0)
    surface.solve()
    surface.move_to_targets(np.zeros((0, 3)))
    moved = surface.positions(R, np.array([1.0, 2, 3]))
    np.testing.assert_allclose(moved, expected @ R.T + [1, 2, 3], atol=2e-5 * size)


@NAMES
def test_exact_handles_by_the_whole_constrained_system(name):
    """Against a dense solve of [L Eᵀ; E 0] for the change with the least Laplacian energy."""
    mesh = MESHES[name]
    rest = bend(mesh.vertices, 1.0)
    surface, vertices, system = prepare(mesh, rest)
    targets = rest[vertices] + np.random.default_rng(1).normal(size=(5, 3))
    found = solve(surface, targets)
    V = len(rest)
    E = np.eye(V)[vertices]
    matrix = np.block([[system.laplacian.toarray(), E.T], [E, np.zeros((5, 5))]])
    right = np.concatenate([np.zeros((V, 3)), targets - rest[vertices]])
    change = np.linalg.lstsq(matrix, right)[0][:V]
    np.testing.assert_allclose(found[vertices], targets, atol=2e-5)
    if len(system.reference.links) == 0:
        np.testing.assert_allclose(found - rest, change, atol=5e-5)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
@NAMES
def test_bending_rows_by_the_whole_system(name, unit):
    """K⁺ of K = L A⁻¹ L / α + L, dense, up to what is the same for all vertices."""
    mesh = Mesh(unit * MESHES[name].vertices, MESHES[name].faces)
    system = PoissonSystem(mesh)
    L, V = system.laplacian.toarray(), len(mesh.vertices)
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.zeros(V)
    np.add.at(area, mesh.faces, np.linalg.norm(normals, axis=1)[:, None] / 6)
    area = np.maximum(area, 1e-6 * area.mean())
    K = L @ np.diag(area.sum() / (100.0 * area)) @ L + L
    vertices = np.array([0, V // 2, V - 1])
    green = system.green_rows(vertices)
    found = system.bending_rows(vertices, green)
    unit_loads = np.eye(V)[vertices]
    # What the rows of two vertices differ by is what opposite loads on these do.
    load = np.diff(unit_loads, axis=0)
    difference = np.diff(found, axis=0)
    np.testing.assert_allclose(K @ difference.T, load.T, atol=1e-9 * np.abs(K).max())
    if name != "awkward":
        expected = np.linalg.lstsq(K, load.T, rcond=None)[0].T
        expected += (difference - expected).mean(axis=1, keepdims=True)
        np.testing.assert_allclose(difference, expected, atol=1e-6 * np.abs(found).max())
    # What is missed and how it is spread must agree: Gᵀμ at the handles is G_hh μ.
    np.testing.assert_allclose(found[:, vertices], found[:, vertices].T, atol=1e-9)


def test_the_schur_inverse_of_one_handle_is_a_translation():
    np.testing.assert_allclose(
        schur_inverse(np.array([[0.7]])) @ [2.0, 0.0], [0.0, 2.0], atol=1e-12
    )


@pytest.mark.parametrize("integrable", [True, False])
@NAMES
def test_handles_that_are_met_change_nothing(name, integrable):
    """Also of a shape whose gradients no shape has: it is at rest where it is."""
    mesh = MESHES[name]
    decoder = decoder_of(mesh, mesh.vertices)
    if not integrable:
        decoder.q = decoder.q + 0.3 * np.random.default_rng(7).normal(size=decoder.q.shape)
    surface, vertices, system = prepare_decoder(mesh, decoder)
    rest = system.solve(features_to_gradients(decoder.q))
    for rounds in (0, 1, 5):
        found = relax(surface, rest[vertices], rounds)
        assert largest(found - rest) < 2e-5 * mesh.bounding_diagonal


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
@NAMES
def test_a_rigid_motion_of_all_vertices(name, unit):
    mesh = Mesh(unit * MESHES[name].vertices, MESHES[name].faces)
    R = random_rotation(np.random.default_rng(2), 2.5)
    goal = mesh.vertices @ R.T + unit
    system = PoissonSystem(mesh)
    surface = DecodedSurface(decoder_of(mesh, mesh.vertices), system)
    vertices = np.arange(len(goal))
    hold(surface, vertices, system)
    surface.decode(np.zeros(2))
    assert largest(relax(surface, goal, 3) - goal) < 1e-4 * mesh.bounding_diagonal


@pytest.mark.parametrize("name", ["tube", "sphere"])
@pytest.mark.parametrize("angle", [0.3, 0.8, 2.0])
def test_some_vertices_moved_rigidly_take_the_rest_along(name, angle):
    """Rounds converge to the rigid motion, whose energy is zero."""
    mesh = MESHES[name]
    surface, vertices, _ = prepare(mesh, mesh.vertices, 12)
    R = random_rotation(np.random.default_rng(3), angle)
    goal = mesh.vertices @ R.T + [1, 2, 3]
    found = relax(surface, goal[vertices], 400)
    np.testing.assert_allclose(found, goal, atol=2e-3 * mesh.bounding_diagonal)


@NAMES
def test_the_energy_of_rigidity_falls(name):
    mesh = MESHES[name]
    rest = bend(mesh.vertices, 0.7)
    surface, vertices, system = prepare(mesh, rest, 6)
    targets = rest[vertices] + 0.4 * np.random.default_rng(4).normal(size=(6, 3))
    energies = [rigidity_energy(system, rest, solve(surface, targets))]
    for _ in range(12):
        surface.relax(8)
        p = solve(surface, targets)
        np.testing.assert_allclose(p[vertices], targets, atol=2e-5 * mesh.bounding_diagonal)
        energies.append(rigidity_energy(system, rest, p))
    # Over-relaxed first rounds of large rotations may go too far, but not far.
    assert (np.diff(energies) <= 0.02 * energies[0]).all(), energies
    assert energies[-1] == min(energies) and energies[-1] < 0.95 * energies[0]


@NAMES
def test_rotations_are_kept_until_they_are_reset(name):
    """A drag goes on where it was: decoding again does not lose them."""
    mesh = MESHES[name]
    rest = bend(mesh.vertices, 0.7)
    surface, vertices, _ = prepare(mesh, rest, 6)
    targets = rest[vertices] + 0.2 * np.random.default_rng(6).normal(size=(6, 3))
    fresh = relax(surface, targets, 0)
    once = relax(surface, targets, 3)
    surface.decode(np.zeros(2))
    again = solve(surface, targets)
    assert largest(again - once) < 2e-5 * mesh.bounding_diagonal
    assert largest(fresh - once) > 1e-3 * mesh.bounding_diagonal
    surface.reset()
    surface.decode(np.zeros(2))
    assert largest(solve(surface, targets) - fresh) < 2e-5 * mesh.bounding_diagonal


def test_relaxation_does_not_depend_on_the_frame():
    mesh = MESHES["tube"]
    rest = bend(mesh.vertices, 1.0)
    rng = np.random.default_rng(5)
    R, t = random_rotation(rng), rng.normal(size=3)
    surface, vertices, _ = prepare(mesh, rest, 6)
    targets = rest[vertices] + 0.2 * rng.normal(size=(6, 3))
    here = relax(surface, targets, 4)
    surface, vertices, _ = prepare(mesh, rest @ R.T + t, 6)
    there = relax(surface, targets @ R.T + t, 4)
    np.testing.assert_allclose(there, here @ R.T + t, atol=1e-4)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", ["at one point", "on a line", "turned over", "far"])
@NAMES
def test_impossible_targets_stay_finite(name, kind):
    mesh = MESHES[name]
    surface, vertices, _ = prepare(mesh, mesh.vertices, 6)
    targets = {
        "at one point": np.zeros((6, 3)),
        "on a line": np.outer(np.arange(6.0), [1, 1, 0]),
        "turned over": mesh.vertices[vertices] * [-1, -1, 1],
        "far": mesh.vertices[vertices] * 1e9,
    }[kind]
    found = relax(surface, targets, 5)
    assert np.isfinite(found).all()
    assert largest(found[vertices] - targets) < 1e-4 * max(1.0, np.abs(targets).max())


@pytest.mark.parametrize("shape", [(1, 0.7, 0.4), (1, 0.01, 0.005), (1, 0.8, 0)])
def test_a_few_steps_reach_the_closest_rotation(shape):
    """Also for needles and flat rings, whose second and third singular values are small."""
    rng = np.random.default_rng(3)
    U = np.linalg.qr(rng.normal(size=(16, 3, 3)))[0]
    U *= np.linalg.det(U)[:, None, None]
    axis = rng.normal(size=(16, 3))
    R = log_to_rotation(0.4 * axis / np.linalg.norm(axis, axis=1, keepdims=True))
    A = R @ np.einsum("nab,b,ncb->nac", U, shape, U)
    quaternions = np.repeat([1.0, 0, 0, 0], 16).astype(np.float32)
    block = A.transpose(1, 2, 0).ravel().astype(np.float32)
    for _ in range(5):
        fit_step(block, quaternions)
    w, x, y, z = quaternions.reshape(4, 16)
    found = Rotation.from_quat(np.column_stack([x, y, z, w])).as_matrix()
    np.testing.assert_allclose(found, R, atol=2e-3 if shape[1] < 0.1 else 1e-5)
