"""Truths of the Poisson system: manufactured solutions, free translations, Green rows."""

import numpy as np
import pytest

from deformer.acap.features import FeatureExtractor
from deformer.acap.poisson import PoissonSystem
from deformer.errors import InputError
from deformer.geometry.laplacian import cotan_weights
from deformer.geometry.mesh import Mesh, connected_components
from deformer.geometry.rotations import log_to_rotation
from shapes import (
    MESHES,
    bend,
    random_rotation,
    twist,
)

NAMES = pytest.mark.parametrize("name", MESHES)


def random_gradients(mesh, seed=0, size=0.5, links=False):
    rng = np.random.default_rng(seed)
    count = len(mesh.vertices) + (len(mesh.links) if links else 0)
    return np.eye(3) + size * rng.normal(size=(count, 3, 3))


def energy(mesh, T, p):
    """Σ_i Σ_j c_ij ‖(p_i − p_j) − T_i (v_i − v_j)‖², edge by edge."""
    weights = cotan_weights(mesh).tocoo()
    i, j = weights.row, weights.col
    v = mesh.vertices
    turned = np.einsum("eab,eb->ea", T[i], v[i] - v[j])
    return (weights.data * ((p[i] - p[j] - turned) ** 2).sum(axis=1)).sum()


@NAMES
def test_one_linear_map_everywhere_maps_the_reference(name):
    mesh = MESHES[name]
    A = np.random.default_rng(1).normal(size=(3, 3))
    p = PoissonSystem(mesh).solve(np.tile(A, (len(mesh.vertices), 1, 1)))
    labels = connected_components(mesh.faces, len(mesh.vertices))[1]
    expected = mesh.vertices @ A.T
    for k in range(labels.max() + 1):
        part = labels == k
        shift = expected[part].mean(axis=0) - p[part].mean(axis=0)
        np.testing.assert_allclose(p[part] + shift, expected[part], atol=1e-9)


@NAMES
def test_manufactured_solution(name):
    """Make p, form L p, solve, compare: the system that is factored is the one that is shown."""
    mesh = MESHES[name]
    system = PoissonSystem(mesh)
    p = np.random.default_rng(2).normal(size=mesh.vertices.shape)
    found = system.back_substitute(system.laplacian @ p)
    np.testing.assert_allclose(found - found.mean(0), p - p.mean(0), atol=1e-7)


@NAMES
def test_solution_satisfies_its_equations(name):
    mesh = MESHES[name]
    system = PoissonSystem(mesh)
    T = random_gradients(mesh)
    b = system.rhs(T)
    assert np.abs(system.laplacian @ system.solve(T) - b).max() < 1e-8 * np.abs(b).max()
    # Nothing pulls on the whole: both sides sum to zero.
    np.testing.assert_allclose(b.sum(axis=0), 0, atol=1e-10 * np.abs(b).max() * len(b))
    np.testing.assert_allclose(system.laplacian @ np.ones(len(b)), 0, atol=1e-10)


@NAMES
def test_right_hand_side_is_the_sum_over_the_ring(name):
    mesh = MESHES[name]
    T = random_gradients(mesh)
    weights = cotan_weights(mesh).tocoo()
    i, j = weights.row, weights.col
    terms = np.einsum("eab,eb->ea", T[i] + T[j], mesh.vertices[i] - mesh.vertices[j])
    expected = np.zeros_like(mesh.vertices)
    np.add.at(expected, i, 0.5 * weights.data[:, None] * terms)
    system = PoissonSystem(mesh)
    # Bridges between components pull their ends along, but cancel in L p = b as a pair.
    if len(system.reference.links) == 0:
        np.testing.assert_allclose(system.rhs(T), expected, atol=1e-11)


@NAMES
def test_solution_minimises_the_energy(name):
    """No disturbance of the solution is better, for gradients that no shape has."""
    mesh = MESHES[name]
    T = random_gradients(mesh)
    p = PoissonSystem(mesh).solve(T)
    best = energy(mesh, T, p)
    rng = np.random.default_rng(3)
    for size in (1e-4, 1e-2, 1.0):
        for _ in range(5):
            assert energy(mesh, T, p + size * rng.normal(size=p.shape)) > best * (1 - 1e-12)
    one = np.zeros_like(p)
    one[7, 1] = 1e-4
    assert energy(mesh, T, p + one) > best and energy(mesh, T, p - one) > best


@NAMES
def test_solutions_are_centred_on_the_reference(name):
    mesh = MESHES[name]
    moved = Mesh(mesh.vertices + np.array([100.0, -50, 7]), mesh.faces)
    T = random_gradients(mesh)
    p = PoissonSystem(moved).solve(T)
    np.testing.assert_allclose(p.mean(axis=0), moved.vertices.mean(axis=0), atol=1e-9)
    np.testing.assert_allclose(p - [100, -50, 7], PoissonSystem(mesh).solve(T), atol=1e-8)


def test_components_keep_their_shape_and_are_carried_along():
    """The ball rides on the tube: turned as a whole, both turn about one centre."""
    mesh = MESHES["components"]
    system = PoissonSystem(mesh)
    R = random_rotation(np.random.default_rng(5))
    p = system.solve(np.tile(R, (len(mesh.vertices), 1, 1)))
    centre = mesh.vertices.mean(axis=0)
    np.testing.assert_allclose(p, (mesh.vertices - centre) @ R.T + centre, atol=1e-9)
    # Turning the ball alone leaves the tube as it was, and the ball rigid.
    ball = system.reference.labels == 1
    T = np.where(ball[:, None, None], R, np.eye(3))
    p = system.solve(T)
    v = mesh.vertices
    still = p[~ball] - v[~ball]
    np.testing.assert_allclose(still, np.tile(still[0], (len(still), 1)), atol=1e-9)
    expected = (v[ball] - v[ball].mean(0)) @ R.T
    np.testing.assert_allclose(p[ball] - p[ball].mean(0), expected, atol=1e-9)
    assert np.linalg.norm(p[ball].mean(0) - p[~ball].mean(0)) < mesh.bounding_diagonal


@NAMES
def test_green_rows_give_positions_without_a_solve(name):
    mesh = MESHES[name]
    system = PoissonSystem(mesh)
    V = len(mesh.vertices)
    handles = [0, V // 3, V - 1]
    green = system.green_rows(handles)
    coefficients = system.position_coefficients(green)
    assert green.shape == (3, V) and coefficients.shape == (3, V + len(mesh.links), 3)
    for seed in range(3):
        T = random_gradients(mesh, seed, links=True)
        p = system.solve(T)[handles]
        np.testing.assert_allclose(system.centroid + green @ system.rhs(T), p, atol=1e-8)
        by_coefficients = system.centroid + np.einsum("iab,hib->ha", T, coefficients)
        np.testing.assert_allclose(by_coefficients, p, atol=1e-8)


@NAMES
def test_green_rows_are_the_pseudo_inverse(name):
    """L G = e − 1/V, each row sums to zero, and G_hk = G_kh."""
    mesh = MESHES[name]
    system = PoissonSystem(mesh)
    V = len(mesh.vertices)
    handles = np.array([3, V // 2, V - 2])
    green = system.green_rows(handles)
    expected = np.eye(V)[handles] - 1 / V
    np.testing.assert_allclose(green @ system.laplacian.T, expected, atol=1e-8)
    np.testing.assert_allclose(green.sum(axis=1), 0, atol=1e-8)
    block = green[:, handles]
    np.testing.assert_allclose(block, block.T, atol=1e-9 * np.abs(block).max())
    assert np.linalg.eigvalsh(block)[0] > 0


def test_a_batch_is_its_shapes_one_by_one():
    """More shapes than are solved at once, in any leading dimensions."""
    mesh = MESHES["tube"]
    extractor, system = FeatureExtractor(mesh), PoissonSystem(mesh)
    p = [bend(twist(mesh.vertices, a), 1 - a) for a in np.linspace(-1, 1, 44)]
    q = np.array([extractor.extract(x) for x in p])
    single = np.array([system.reconstruct(x) for x in q])
    np.testing.assert_allclose(system.reconstruct(q), single, atol=1e-12)
    np.testing.assert_allclose(
        system.reconstruct(q.reshape(4, 11, -1, 9)), single.reshape(4, 11, -1, 3), atol=1e-12
    )
    assert system.reconstruct(q[:0]).shape == (0, len(mesh.vertices), 3)


def test_reconstruct_solves_with_the_gradients_of_the_features():
    mesh = MESHES["sphere"]
    system = PoissonSystem(mesh)
    r = np.array([0.3, -2.0, 4.0])
    q = np.tile([*r, 1.0, 0, 0, 1, 0, 1], (len(mesh.vertices), 1))
    expected = mesh.vertices @ log_to_rotation(r).T
    np.testing.assert_allclose(system.reconstruct(q), expected, atol=1e-10)


def test_wrong_features_are_refused():
    with pytest.raises(InputError, match=r"120, 9\)"):
        PoissonSystem(MESHES["tube"]).reconstruct(np.zeros((3, 120, 6)))


@NAMES
def test_foundation_rows_are_greens_functions_of_a_plate_on_a_foundation(name):
    """K⁻¹ K_h = e_h with K⁻¹ = (L A⁻¹ L + (α + β) L + α β A) / (α − β), A of sum 1."""
    mesh = MESHES[name]
    system = PoissonSystem(mesh)
    v, V = mesh.vertices, len(mesh.vertices)
    corners = v[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.zeros(V)
    np.add.at(area, mesh.faces, np.linalg.norm(normal, axis=1)[:, None] / 6)
    A = np.maximum(area / area.sum(), 1e-6 / V)
    L, alpha, beta = system.laplacian.toarray(), 100.0, 30.0
    K = system.foundation_rows(np.arange(V))
    product = L @ ((L @ K) / A[:, None]) + (alpha + beta) * L @ K + alpha * beta * A[:, None] * K
    tolerance = 1e-7 * (1.0 + (L.diagonal() ** 2 / A).max() * np.abs(K).max())
    np.testing.assert_allclose(product / (alpha - beta), np.eye(V), atol=min(tolerance, 1e-2))
    assert np.linalg.eigvalsh(0.5 * (K + K.T)).min() > -1e-9 * np.abs(K).max()
