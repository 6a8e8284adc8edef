"""Edge lengths and dihedral angles: measures, derivatives, reconstruction, handle fits."""

from functools import cache

import numpy as np
import pytest

from deformer.acap.poisson import PoissonSystem
from deformer.baselines._connection import Connection, orthonormal_on_average
from deformer.baselines._edge_space import EdgeDeformation, EdgeSpace, FitIterate, rigidly_aligned
from deformer.baselines._shell import Shell
from deformer.baselines.edges import EdgeSplocs
from deformer.errors import InputError
from deformer.geometry.mesh import Mesh, MeshSequence
from deformer.geometry.metrics import e_rms
from deformer.io import load_shapes
from deformer.model.latent_prior import LatentPrior
from deformer.training.sparse_components import LocalisedSettings
from paths import DATA
from shapes import (
    bend,
    icosphere,
    join,
    random_rotation,
    sequence,
    strip,
    tube,
    twist,
    two_components,
)

SCAPE = DATA / "scape-obj"
ALL = LocalisedSettings(sparsity=0.0, rounds=20)
HANDLES = [3, 40, 77, 110]
MESHES = {"tube": tube(), "strip": strip(), "sphere": icosphere(1), "components": two_components()}


@cache
def learned():
    return EdgeSplocs(ALL, 0.01).fit(sequence(), 8)


@pytest.mark.parametrize("fold", [-2.0, -0.5, 0.0, 1.0, 3.0])
def test_measures_of_two_triangles_on_a_hinge(fold):
    """A unit square with a diagonal along x: one side stays in the plane, the other is folded."""
    right = [0.5, -0.5 * np.cos(fold), -0.5 * np.sin(fold)]
    p = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.5, 0], right])
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0.5, 0.5, 0], [0.5, -0.5, 0]], [[0, 1, 2], [1, 0, 3]])
    shell = Shell(mesh)
    hinge = int(np.flatnonzero(shell.inner)[0])
    assert shell.inner.sum() == 1
    np.testing.assert_array_equal(shell.hinges[hinge], [0, 1, 2, 3])
    lengths, angles = shell.measure(p)
    np.testing.assert_allclose(lengths[hinge], 1.0)
    np.testing.assert_allclose(np.delete(lengths, hinge), 0.5**0.5)
    np.testing.assert_allclose(np.abs(angles[hinge]), np.abs(fold), atol=1e-12)
    # Twice the length is a change of 1, times √100; β = √3 · 1² / (½ + ½).
    np.testing.assert_allclose(
        shell.features(2.0 * p)[hinge], [10.0, 3**0.25 * angles[hinge]], atol=1e-12
    )
    assert not shell.features(p)[~shell.inner, 1].any()


def test_changes_of_angle_go_the_short_way_round():
    """From almost shut on one side to almost shut on the other: 0.2, not 2π − 0.2."""

    def folded(fold):
        right = [0.5, -0.5 * np.cos(fold), -0.5 * np.sin(fold)]
        return np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.5, 0], right])

    shell = Shell(Mesh(folded(np.pi - 0.1), [[0, 1, 2], [1, 0, 3]]))
    turn = shell.features(folded(np.pi + 0.1))[shell.inner, 1] / shell.unit[shell.inner, 1]
    np.testing.assert_allclose(np.abs(turn), 0.2, atol=1e-9)


def test_mirrored_frames_are_turned_back():
    rng = np.random.default_rng(9)
    R = np.stack([random_rotation(rng) for _ in tube().faces])
    mixed = R @ np.array([[2.0, 0.3, 0.1], [0.2, 1.0, 0.4], [0.0, 0.1, -0.5]])
    X = orthonormal_on_average(mixed, np.zeros(len(mixed), dtype=np.int64))
    np.testing.assert_allclose(np.linalg.det(X), 1.0)
    np.testing.assert_allclose(
        X @ X.transpose(0, 2, 1), np.tile(np.eye(3), (len(X), 1, 1)), atol=1e-9
    )


def test_angles_are_positive_where_the_surface_is_convex():
    assert (Shell(icosphere(1)).rest_angles > 0).all()
    inside_out = Mesh(icosphere(1).vertices, icosphere(1).faces[:, ::-1])
    assert (Shell(inside_out).rest_angles < 0).all()


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES.keys())
def test_jacobian_is_the_derivative_of_the_features(mesh):
    rng = np.random.default_rng(0)
    shell, h = Shell(mesh), 1e-6
    p = mesh.vertices + 0.02 * rng.normal(size=mesh.vertices.shape)
    for _ in range(3):
        d = rng.normal(size=p.shape)
        found = (shell.features(p + h * d) - shell.features(p - h * d)) / (2 * h)
        np.testing.assert_allclose(
            shell.jacobian(p) @ d.ravel(), found.ravel(), rtol=1e-5, atol=1e-5
        )


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES.keys())
def test_rigid_motions_and_the_unit_of_length_do_not_show(mesh):
    rng = np.random.default_rng(1)
    shape = mesh.vertices + 0.01 * rng.normal(size=mesh.vertices.shape)
    features = Shell(mesh).features(shape)
    moved = shape @ random_rotation(rng).T + rng.normal(size=3)
    np.testing.assert_allclose(Shell(mesh).features(moved), features, atol=1e-9)
    large = Shell(Mesh(1e3 * mesh.vertices, mesh.faces))
    np.testing.assert_allclose(large.features(1e3 * shape), features, atol=1e-9)


POSES = {
    "bend": (tube(), lambda v: bend(v, 2.5)),
    "twist": (tube(8, 31), lambda v: twist(v, 2.5 * np.pi)),
    "sphere": (icosphere(2), lambda v: v * [1.0, 0.6, 1.7] + 0.1 * np.sin(3 * v[:, ::-1])),
    "strip": (strip(), lambda v: bend(v, 4.0, 3.0)),
}


@pytest.mark.parametrize("mesh, pose", POSES.values(), ids=POSES.keys())
def test_two_linear_solves_give_back_a_mesh(mesh, pose):
    """Where the measures are those of a mesh nothing is left for Gauss–Newton to do."""
    shell, target = Shell(mesh), pose(mesh.vertices)
    target = target @ random_rotation(np.random.default_rng(2)).T
    p = Connection(shell, PoissonSystem(mesh)).shape(shell.features(target))
    assert np.abs(rigidly_aligned(p, target) - target).max() < 1e-6 * mesh.bounding_diagonal
    np.testing.assert_allclose(p.mean(axis=0), mesh.vertices.mean(axis=0), atol=1e-9)


def test_each_component_has_a_frame_of_its_own():
    mesh = join(tube(), icosphere(1))
    shell = Shell(mesh)
    target = np.concatenate([bend(tube().vertices, 2.0), 1.3 * icosphere(1).vertices])
    p = Connection(shell, PoissonSystem(mesh)).shape(shell.features(target))
    V = len(tube().vertices)
    assert np.abs(rigidly_aligned(p[:V], target[:V]) - target[:V]).max() < 1e-6
    assert np.abs(rigidly_aligned(p[V:], target[V:]) - target[V:]).max() < 1e-6


@pytest.mark.skipif(not SCAPE.exists(), reason="the SCAPE example meshes are not here")
def test_a_human_pose_comes_back_without_its_frame():
    shapes = load_shapes(SCAPE).subset([0, 30])
    shell = Shell(shapes.mesh(0))
    p = Connection(shell, PoissonSystem(shapes.mesh(0))).shape(shell.features(shapes.vertices[1]))
    assert e_rms(shapes.vertices[1], p, "rigid") < 1e-6


def test_gauss_newton_finds_the_shape_from_the_reference():
    shell = Shell(tube())
    target = bend(twist(tube().vertices, 0.5), 0.8)
    p = shell.closest(shell.features(target), tube().vertices, 60, 1e-12)
    assert np.abs(rigidly_aligned(p, target) - target).max() < 1e-5


def test_gauss_newton_lowers_the_energy_of_measures_of_no_mesh():
    shell = Shell(tube())
    rng = np.random.default_rng(3)
    wanted = shell.features(bend(tube().vertices, 1.0))
    wanted[shell.inner] += 0.1 * rng.normal(size=wanted[shell.inner].shape)
    start = Connection(shell, PoissonSystem(tube())).shape(wanted)
    p = shell.closest(wanted, start)

    def energy(p):
        return (shell.difference(p, wanted) ** 2).sum()

    assert energy(p) < energy(start)
    # A minimum: the gradient is nothing beside the start's.
    slope = [shell.jacobian(x).T @ shell.difference(x, wanted).ravel() for x in (p, start)]
    assert np.linalg.norm(slope[0]) < 0.03 * np.linalg.norm(slope[1])


def _space():
    """Two directions of features that are, at the base, those of a moving mesh."""
    mesh = tube()
    shell = Shell(mesh)
    base = bend(mesh.vertices, 0.7)
    rng = np.random.default_rng(4)
    d = np.stack([np.cos(3 * mesh.vertices[:, [1, 2, 0]]), rng.normal(size=mesh.vertices.shape)])
    J = shell.jacobian(base)
    components = np.stack([(J @ e.ravel()).reshape(-1, 2) for e in d])
    return EdgeSpace(shell, PoissonSystem(mesh), shell.features(base), components), base, d


def test_tangents_are_the_motion_that_changes_the_features():
    space, base, d = _space()
    turned = np.cross([0.3, -0.2, 0.5], base) + np.array([1.0, 2.0, 3.0])
    for found, motion in zip(space.tangents(base), d, strict=True):
        # The same but for a rigid motion, to which the tangent is orthogonal.
        np.testing.assert_allclose(
            space.shell.jacobian(base) @ (found - motion).ravel(), 0.0, atol=1e-4
        )
        np.testing.assert_allclose(np.vdot(found, turned), 0.0, atol=1e-6 * np.linalg.norm(turned))


def _handles(base, pulled):
    """Goals (3V,) beside the handles of a shape, and the pull (3V,) on them, or infinite."""
    goals, pull = base + 0.02, np.zeros(base.shape)
    pull[HANDLES] = 0.3 if pulled else np.inf
    return goals.ravel(), pull.ravel()


@pytest.mark.parametrize("pulled", [False, True])
def test_gradient_of_the_handle_energy_is_its_derivative(pulled):
    space, base, _ = _space()
    prior = LatentPrior(np.array([0.1, -0.2]), np.array([[2.0, 0.5], [0.5, 1.0]]))
    own = EdgeDeformation(space, prior, base[None], np.zeros((1, 2)))
    goals, pull = _handles(base, pulled)
    rng = np.random.default_rng(5)
    # A weight that makes the residual and the prior count about the same.
    fit = FitIterate(
        own, goals, pull, 1e-5, base + 0.01 * rng.normal(size=base.shape), np.array([0.3, -0.4])
    )
    _, _, right, below = fit.normal_equations()
    gradient = -2.0 * fit.weight * np.concatenate([right, below])
    h = 1e-6
    for _ in range(3):
        d = rng.normal(size=len(gradient))
        found = (fit.moved(h * d).energy - fit.moved(-h * d).energy) / (2 * h)
        np.testing.assert_allclose(gradient @ d, found, rtol=1e-5)


@pytest.mark.parametrize("pulled", [False, True])
def test_step_of_a_handle_fit_solves_the_whole_system(pulled):
    """Eliminating the positions gives what one dense solve gives."""
    space, base, _ = _space()
    prior = LatentPrior(np.zeros(2), np.eye(2))
    own = EdgeDeformation(space, prior, base[None], np.zeros((1, 2)))
    goals, pull = _handles(base, pulled)
    rng = np.random.default_rng(6)
    fit = FitIterate(
        own, goals, pull, 3.0, base + 0.01 * rng.normal(size=base.shape), np.array([0.3, -0.4])
    )
    J = np.hstack([space.shell.jacobian(fit.p).toarray()[:, fit.free], -own.slopes.T])
    A, g = J.T @ J, J.T @ fit.residual
    springs = np.append(pull[fit.free], np.zeros(2)) / 3.0
    A += np.diag(springs)
    g += springs * np.append((fit.p.ravel() - goals)[fit.free], np.zeros(2))
    A[-2:, -2:] += np.eye(2) / 3.0
    g[-2:] += fit.y / 3.0
    A += 0.1 * np.diag(np.diag(A))
    np.testing.assert_allclose(fit.step(0.1), -np.linalg.solve(A, g), rtol=1e-5, atol=1e-8)


def test_training_shapes_come_back_in_their_own_frame():
    own = EdgeSplocs(ALL, 0.01).fit(sequence(), 12)
    rng = np.random.default_rng(7)
    shapes = sequence().vertices[[1, 4, 6]]
    turned = shapes @ random_rotation(rng).T + [1.0, 0.0, -3.0]
    codes = own.encode(turned)
    assert codes.shape == (3, 15)
    np.testing.assert_allclose(codes[:, :12], own.encode(shapes)[:, :12], atol=1e-6)
    # In thousandths; the tube is 2 long.
    assert e_rms(turned, own.decode(codes)) < 2.0
    assert e_rms(turned, own.decode(own.fit_codes(turned))) < 1.0


def test_components_times_weights_are_the_features():
    """With as many components as the examples need, on the edges that `edges` names."""
    method, shapes = learned(), sequence().vertices
    shell = Shell(sequence().mesh(0))
    w = method.weights(shapes)
    np.testing.assert_array_equal(method.encode(shapes)[:, :-3], w)
    features = np.array([shell.features(p) for p in shapes])
    rebuilt = np.tensordot(w - w[0], method.components, axes=1)
    np.testing.assert_allclose(rebuilt, features - features[0], atol=2e-2 * np.ptp(features))
    i, j = method.edges.T
    length = np.linalg.norm(shapes[:, i] - shapes[:, j], axis=2)
    np.testing.assert_allclose(length, [shell.measure(p)[0] for p in shapes])


def test_what_encoding_rebuilt_is_not_rebuilt_by_decoding(monkeypatch):
    shell, unseen = learned().learned().space.shell, twist(sequence().vertices[3], 0.2)[None]
    calls, closest = [], shell.closest
    monkeypatch.setattr(shell, "closest", lambda *given: calls.append(1) or closest(*given))
    codes = learned().encode(unseen)
    first = learned().decode(codes)
    first[:] = 0.0  # the caller's own
    assert len(calls) == 1
    assert e_rms(unseen, learned().decode(codes)) < 0.1 * e_rms(unseen, first)


def test_fit_codes_is_closer_than_encode():
    unseen = np.stack([twist(sequence().vertices[2], 0.3), twist(sequence().vertices[8], -0.4)])
    encoded = e_rms(unseen, learned().decode(learned().encode(unseen)))
    assert e_rms(unseen, learned().decode(learned().fit_codes(unseen))) < 0.9 * encoded


def test_handles_are_met_exactly_and_the_frame_is_free():
    shape = sequence().vertices[5]
    rng = np.random.default_rng(8)
    handles = list(range(1, 120, 10))
    p = learned().fit_handles(handles, shape[handles])
    np.testing.assert_array_equal(p[handles], shape[handles])
    # Handles do not tell all, and the prior pulls: one per cent of the length.
    assert np.abs(p - shape).max() < 0.02
    Q, t = random_rotation(rng), np.array([3.0, -1.0, 2.0])
    moved = learned().fit_handles(handles, shape[handles] @ Q.T + t)
    np.testing.assert_allclose(moved, p @ Q.T + t, atol=1e-4)


def test_targets_with_errors_are_met_as_springs_do():
    """The found positions are a minimum: the springs' pull balances the surface's."""
    shape, error = sequence().vertices[5], 0.03
    handles = np.arange(1, 120, 10)
    targets = shape[handles] + error * np.random.default_rng(2).normal(size=(12, 3))
    p = learned().fit_handles(handles, targets, error)
    away = np.abs(p[handles] - targets).max()
    assert 0.2 * error < away < 5 * error
    exact = learned().fit_handles(handles, targets)
    assert e_rms(shape[None], p[None], "none") < 0.9 * e_rms(shape[None], exact[None], "none")
    near = learned().fit_handles(handles, targets, 1e-5)
    np.testing.assert_allclose(near[handles], targets, atol=1e-3)


def test_one_handle_translates():
    p = learned().fit_handles([7], [[5.0, -2.0, 1.0]])
    np.testing.assert_array_equal(p[7], [5.0, -2.0, 1.0])
    assert np.abs(Shell(tube()).features(p)).max() < 5.0


def test_learning_twice_gives_the_same_and_chooses_the_same():
    few = LocalisedSettings(rounds=3)
    shapes = sequence(8)
    one, two = EdgeSplocs(few).fit(shapes, 4), EdgeSplocs(few).fit(shapes, 4)
    assert one.chosen_noise == two.chosen_noise > 0
    np.testing.assert_array_equal(one.encode(shapes.vertices), two.encode(shapes.vertices))
    targets = shapes.vertices[3][HANDLES]
    np.testing.assert_array_equal(
        one.fit_handles(HANDLES, targets), two.fit_handles(HANDLES, targets)
    )


def test_bad_input_is_said_in_one_line():
    with pytest.raises(InputError, match="call fit first"):
        EdgeSplocs().decode(np.zeros((1, 3)))
    three = Mesh(np.eye(5)[:, :3], [[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    with pytest.raises(InputError, match=r"edge \[0, 1\]: dihedral angles need"):
        Shell(three)
    same = Mesh([[0, 0, 0], [0, 0, 0], [1, 0, 0]], [[0, 1, 2]])
    with pytest.raises(InputError, match=r"edge \[0, 1\] of the reference has no length"):
        Shell(same)
    with pytest.raises(InputError, match=r"\(N, 11\), got \(1, 8\)"):
        learned().decode(np.zeros((1, 8)))
    with pytest.raises(InputError, match="at least 2 training shapes"):
        EdgeSplocs().fit(MeshSequence(tube().vertices[None], tube().faces), 2)
