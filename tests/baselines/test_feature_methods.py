"""Methods on deformation gradients and ACAP features, and their handle fits."""

from functools import cache

import numpy as np
import pytest

from deformer.acap.features import FeatureExtractor, extract_all
from deformer.acap.gradients import features_to_gradients
from deformer.acap.poisson import PoissonSystem
from deformer.baselines import _data_driven
from deformer.baselines._checks import checked_handles, checked_shapes
from deformer.baselines._data_driven import DataDrivenDeformation, FitIterate, HandleConstraints
from deformer.baselines._gradient_space import GradientSpace
from deformer.baselines.acap import AcapSplocs
from deformer.baselines.autoencoder import Autoencoder
from deformer.baselines.gradients import GradientSplocs
from deformer.baselines.linear_components import LinearComponents
from deformer.editing import HandleSolver, target_noise
from deformer.editing.exact_rows import schur_inverse
from deformer.errors import InputError
from deformer.geometry.geodesics import Geodesics
from deformer.geometry.mesh import MeshSequence
from deformer.geometry.metrics import e_rms
from deformer.geometry.rotations import log_to_rotation, polar
from deformer.linalg import Descent
from deformer.model.latent_prior import LatentPrior, fit_prior
from deformer.training.cross_validation import choose_noise, fit_each_noise
from deformer.training.sparse_components import LocalisedSettings
from shapes import random_rotation, sequence, small_model, tube, twist

FEW = LocalisedSettings(rounds=5)
HANDLES = [3, 40, 77, 110]


@cache
def space():
    """Four directions of the features of a bending, twisting tube, by its singular vectors."""
    shapes = sequence()
    q = extract_all(FeatureExtractor(shapes.mesh(0)), shapes.vertices)
    base = q.mean(axis=0)
    _, scale, right = np.linalg.svd((q - base).reshape(len(q), -1), full_matrices=False)
    components = (scale[:4, None] * right[:4]).reshape(4, *base.shape) / np.sqrt(len(q))
    return GradientSpace(PoissonSystem(shapes.mesh(0)), base, components, np.ones(9))


@cache
def deformation():
    shapes = sequence()
    codes = space().project(extract_all(FeatureExtractor(shapes.mesh(0)), shapes.vertices))
    return DataDrivenDeformation(space(), fit_prior(codes), codes)


@cache
def learned(method, noise=0.01):
    return method(FEW, noise).fit(sequence(), 8)


METHODS = [AcapSplocs, GradientSplocs]


def test_weights_of_features_in_the_space_are_recovered():
    rng = np.random.default_rng(0)
    w = rng.normal(size=(3, 4))
    q = np.stack([space().features(row) for row in w])
    # What no component says is left out by least squares, if it is orthogonal to all of them.
    noise = rng.normal(size=q.shape)
    flat = space().components.reshape(4, -1)
    inverse = np.linalg.inv(flat @ flat.T)
    noise -= (noise.reshape(3, -1) @ flat.T @ inverse @ flat).reshape(q.shape)
    np.testing.assert_allclose(space().project(q + noise), w, atol=1e-9)


def test_dependent_components_share_a_weight():
    one = space().components[:1]
    twice = GradientSpace(space().poisson, space().base, np.repeat(one, 2, axis=0), np.ones(9))
    q = space().base + 3.0 * one
    np.testing.assert_allclose(twice.project(q), [[1.5, 1.5]], atol=1e-9)


def test_solved_tangents_are_the_derivative_of_the_vertices():
    w, h = np.array([0.3, -0.5, 0.2, 0.4]), 1e-6
    dp = space().solve(space().tangents(w)[2])
    for k, e in enumerate(h * np.eye(4)):
        difference = space().decode(np.stack([w + e, w - e]))
        np.testing.assert_allclose(dp[k], (difference[0] - difference[1]) / (2 * h), atol=1e-7)


def test_fitted_weights_come_back_from_vertices():
    w = np.array([1.2, -0.6, 0.4, 0.7])
    target = space().decode(w[None])[0] + [1.0, 2.0, 3.0]
    prior = LatentPrior(np.zeros(4), 1e4 * np.eye(4))
    np.testing.assert_allclose(space().closest(target, np.zeros(4), prior), w, atol=1e-4)


def _fit_at(x):
    own = deformation()
    index = np.array(HANDLES)
    green = own.green(index)
    stiffness = schur_inverse(green[:, index])[:-1, :-1]
    rng = np.random.default_rng(5)
    goals = own.space.poisson.reference.vertices[index] - own.space.poisson.centroid
    control = HandleConstraints(
        own, index, green, stiffness, goals + 0.1 * rng.normal(size=(4, 3)), 40.0
    )
    return FitIterate(control, np.asarray(x))


def test_gradient_of_the_handle_energy_is_its_derivative():
    x = np.array([0.4, -0.2, 0.5, 0.1, 0.3, -0.2, 0.6])
    gradient = 2.0 * _fit_at(x).normal()[1]
    h = 1e-5
    found = [(_fit_at(x + e).energy - _fit_at(x - e).energy) / (2 * h) for e in h * np.eye(7)]
    np.testing.assert_allclose(gradient, found, rtol=1e-6, atol=1e-6)


def test_normal_matrix_is_the_second_derivative_where_nothing_is_left_over():
    """At the reference itself there is no strain: Gauss–Newton is Newton."""
    poisson = space().poisson
    shape = poisson.reference.vertices
    q = np.tile([0.0, 0, 0, 1, 0, 0, 1, 0, 1], (len(shape), 1))
    exact = GradientSpace(poisson, q, space().components, np.ones(9))
    own = DataDrivenDeformation(exact, LatentPrior(np.zeros(4), np.eye(4)), np.zeros((1, 4)))
    index = np.array(HANDLES)
    green = own.green(index)
    stiffness = schur_inverse(green[:, index])[:-1, :-1]
    goals = shape[index] - shape.mean(axis=0)
    control = HandleConstraints(own, index, green, stiffness, goals, 40.0)
    h = 1e-5
    sides = [
        [FitIterate(control, sign * e).normal()[1] for sign in (1.0, -1.0)] for e in h * np.eye(7)
    ]
    second = np.array([(plus - minus) / (2 * h) for plus, minus in sides])
    matrix = FitIterate(control, np.zeros(7)).normal()[0]
    np.testing.assert_allclose(second, matrix, rtol=1e-5, atol=1e-5 * np.abs(matrix).max())


def test_the_start_is_the_example_that_meets_the_handles(monkeypatch):
    monkeypatch.setattr(_data_driven, "descend", lambda point, **settings: Descent(point, 0))
    own = deformation()
    for n in (3, 5, 9):
        example = space().decode(own.examples[n : n + 1])[0]
        p = own.fit(np.array(HANDLES), example[HANDLES] + 1e-3, 1e-3)
        np.testing.assert_allclose(p, example + 1e-3, atol=1e-9)


def _strain(p, T):
    """Σ_i Σ_j c_ij ‖(p_i − p_j) − T_i (v_i − v_j)‖², edge by edge."""
    poisson = space().poisson
    v, total = poisson.reference.vertices, 0.0
    for i in range(len(v)):
        for k in range(poisson.indptr[i], poisson.indptr[i + 1]):
            j = poisson.rings[k]
            total += poisson.c[k] * ((p[i] - p[j] - T[i] @ (v[i] - v[j])) ** 2).sum()
    return total


def test_eliminated_positions_have_the_least_strain_of_all_that_meet_the_handles():
    """The energy is the strain written out, and no other positions have less."""
    fit = _fit_at(np.array([0.4, -0.2, 0.5, 0.1, 0.0, 0.0, 0.0]))
    control = fit.control
    inverse = schur_inverse(control.green[:, control.vertices])
    force = control.stiffness @ fit.distances
    p = fit.p + control.green.T @ force + inverse[-1, :-1] @ fit.distances
    np.testing.assert_allclose(p[control.vertices], control.goals, atol=1e-9)
    T = features_to_gradients(space().features(fit.w))
    strain = _strain(p, T)
    expected = (fit.energy - (fit.x**2 * fit.ridge).sum()) / control.weight
    np.testing.assert_allclose(strain, expected, rtol=1e-9)
    rng = np.random.default_rng(1)
    for _ in range(5):
        change = 1e-3 * rng.normal(size=p.shape)
        change[control.vertices] = 0.0
        assert _strain(p + change, T) > strain


@pytest.mark.parametrize("method", METHODS)
def test_handles_are_met_exactly(method):
    targets = sequence().vertices[4][HANDLES] + [[0.3, 0, 0], [0, 0.2, 0], [0, 0, 0], [0, 0, -0.1]]
    p = learned(method).fit_handles(HANDLES, targets)
    np.testing.assert_array_equal(p[HANDLES], targets)


@pytest.mark.parametrize("method", METHODS)
def test_targets_with_errors_draw_the_handles_as_springs_do(method, monkeypatch):
    """The positions that are eliminated minimise strain and springs together."""
    targets, error = sequence().vertices[4][HANDLES] + 0.2 * np.eye(4)[:, :3], 0.05
    own = learned(method)
    soft, near, exact = (own.fit_handles(HANDLES, targets, s) for s in (error, 1e-6, 0.0))
    assert 0.01 < np.abs(soft[HANDLES] - targets).max() < 0.4
    np.testing.assert_allclose(near, exact, atol=1e-3)

    starts = []

    def stay(start, **_):
        starts.append(start)
        return Descent(start, 0)

    monkeypatch.setattr(_data_driven, "descend", stay)
    p = own.fit_handles(HANDLES, targets, error)
    deformation, found = own.learned(), starts[-1]
    T = features_to_gradients(deformation.space.features(found.w))
    weight = 1.0 / (own.chosen_noise**2 * deformation.size)

    def energy(p):
        springs = ((p[HANDLES] - targets) ** 2).sum() / error**2
        return weight * _strain(p, T) + springs

    prior = float((found.x**2 * found.ridge).sum())
    np.testing.assert_allclose(energy(p), found.energy - prior, rtol=1e-9)
    rng = np.random.default_rng(1)
    for _ in range(5):
        d = 1e-3 * rng.normal(size=p.shape)
        np.testing.assert_allclose(energy(p + d), energy(p - d), rtol=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_a_moved_example_is_found_from_its_handles(method):
    shape = sequence().vertices[5]
    moved = shape @ random_rotation(np.random.default_rng(3), 0.25).T + [0.5, -1.0, 2.0]
    own = method(LocalisedSettings(sparsity=0.0, rounds=20), 0.001).fit(sequence(), 11)
    handles = list(range(1, 120, 10))
    p = own.fit_handles(handles, moved[handles])
    # Handles do not tell all, and the prior pulls: half a per cent of the length.
    assert np.abs(p - moved).max() < 0.01


@pytest.mark.parametrize("method", METHODS)
def test_one_handle_translates(method):
    own = learned(method)
    start = own.fit_handles([7], [[0.0, 0.0, 0.0]])
    there = own.fit_handles([7], [[5.0, -2.0, 1.0]])
    np.testing.assert_allclose(there, start + np.array([5.0, -2.0, 1.0]), atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_more_components_fit_better(method):
    shapes = sequence()
    error = []
    for K in (1, 2, 8):
        own = method(LocalisedSettings(sparsity=0.0, rounds=20), 0.01).fit(shapes, K)
        error.append(e_rms(shapes.vertices, own.decode(own.encode(shapes.vertices))))
    assert error[0] > 1.5 * error[1] > 15 * error[2]
    # In thousandths; the tube is 2 long.
    assert error[2] < 1.0


def test_fit_codes_is_closer_than_encode():
    own = learned(AcapSplocs)
    unseen = np.stack([twist(sequence().vertices[2], 0.3), twist(sequence().vertices[8], -0.4)])
    encoded = e_rms(unseen, own.decode(own.encode(unseen)))
    fitted = e_rms(unseen, own.decode(own.fit_codes(unseen)))
    assert fitted < 0.9 * encoded


def test_turns_beyond_pi_need_consistent_logarithms():
    """Between two poses twisted to 1.6 turns: principal logarithms jump, consistent ones do not."""
    base = tube(8, 31)
    angles = np.linspace(0.0, 3.2 * np.pi, 9)
    poses = np.stack([twist(base.vertices, angle) for angle in angles])
    shapes = MeshSequence(poses[::2], base.faces)
    settings = LocalisedSettings(sparsity=0.0, rounds=5)
    error = {}
    for method in METHODS:
        own = method(settings, 0.01).fit(shapes, 4)
        error[method] = e_rms(poses[1::2], own.decode(own.encode(poses[1::2])))
    # In thousandths; the tube is 2 long.
    assert error[AcapSplocs] < 25.0
    assert error[GradientSplocs] > 4 * error[AcapSplocs]


def test_gradients_are_principal_logarithms():
    base = tube(8, 31)
    pose = twist(base.vertices, 3.0 * np.pi)
    shapes = MeshSequence(np.stack([base.vertices, pose]), base.faces)
    q = GradientSplocs(FEW, 0.01).fit(shapes, 1).extract(pose[None])[0]
    assert 3.0 < np.linalg.norm(q[:, :3], axis=1).max() <= np.pi + 1e-9
    T = FeatureExtractor(base).gradients(pose)
    np.testing.assert_allclose(features_to_gradients(q), T, atol=1e-9)
    np.testing.assert_allclose(log_to_rotation(q[:, :3]), polar(T)[0], atol=1e-9)
    # What the features hold is the shape itself, jumps or not.
    p = PoissonSystem(base).reconstruct(q)
    assert e_rms(pose, p) < 1e-3


@pytest.mark.parametrize("method", METHODS)
def test_the_unit_of_length_does_not_matter(method):
    small, shapes = learned(method, None), sequence()
    # A power of two scales without rounding: a tube has ties that rounding would break.
    large = method(FEW).fit(MeshSequence(2.0**20 * shapes.vertices, shapes.faces), 8)
    assert large.chosen_noise == small.chosen_noise
    codes = small.encode(shapes.vertices)
    np.testing.assert_allclose(large.encode(2.0**20 * shapes.vertices), codes, atol=1e-6)
    targets = shapes.vertices[4][HANDLES] + 0.1
    np.testing.assert_allclose(
        2.0**-20 * large.fit_handles(HANDLES, 2.0**20 * targets),
        small.fit_handles(HANDLES, targets),
        atol=1e-6,
    )


def test_learning_twice_gives_the_same():
    again = AcapSplocs(FEW, 0.01).fit(sequence(), 8)
    unseen = twist(sequence().vertices[2], 0.3)[None]
    np.testing.assert_array_equal(again.encode(unseen), learned(AcapSplocs).encode(unseen))
    targets = unseen[0][HANDLES]
    np.testing.assert_array_equal(
        again.fit_handles(HANDLES, targets), learned(AcapSplocs).fit_handles(HANDLES, targets)
    )


def test_noise_is_the_one_that_recovers_shapes_left_out():
    shapes = sequence()
    asked = []

    def learn(kept):
        assert 0 in kept and len(kept) == 9
        asked.append(kept)
        # Right at 0.2, and worse on either side.
        truth = {tuple(s[:2].ravel()): s for s in shapes.vertices}
        return fit_each_noise(
            lambda h, targets, noise: _with_handles(shapes, h, targets, truth, noise)
        )

    def _with_handles(shapes, h, targets, truth, noise):
        shape = min(truth.values(), key=lambda s: ((s[h] - targets) ** 2).sum())
        return shape + np.log(noise / 0.2)

    chosen = choose_noise(learn, shapes, Geodesics(shapes.mesh(0)), (0.1, 0.19, 0.4), 0)
    assert chosen == 0.19
    assert len(asked) == 1
    few = shapes.subset([0, 1, 2])
    assert choose_noise(learn, few, Geodesics(few.mesh(0)), (0.1, 0.19, 0.4), 0) == 0.19
    assert len(asked) == 1


def test_linear_components_are_the_decoders_representative_shapes():
    model, shapes = small_model(), sequence()
    own = LinearComponents(model, noise=0.01).fit(shapes, 6)
    learned_space = own.learned().space
    z = model.encode(shapes.vertices[:1])[0]
    for k in range(6):
        ends = []
        for end in (model.codes[:, k].min(), model.codes[:, k].max()):
            moved = z.copy()
            moved[k] = end
            ends.append(model.decoder.features(moved))
        q = learned_space.features(np.eye(6)[k])
        distance = [np.abs((end - learned_space.base) / model.scaler.gain) for end in ends]
        farther = ends[int((distance[1] ** 2).sum() > (distance[0] ** 2).sum())]
        np.testing.assert_allclose(q, farther, atol=1e-9)
    targets = shapes.vertices[4][HANDLES]
    np.testing.assert_array_equal(own.fit_handles(HANDLES, targets)[HANDLES], targets)
    chosen = LinearComponents(model).fit(shapes, 6)
    assert chosen.chosen_noise > 0
    with pytest.raises(InputError, match="has 6, got 5"):
        LinearComponents(model).fit(shapes, 5)


def test_the_autoencoder_is_the_model():
    model, shapes = small_model(), sequence()
    own = Autoencoder(model)
    z = own.encode(shapes.vertices[:2])
    np.testing.assert_array_equal(z, model.encode(shapes.vertices[:2]))
    np.testing.assert_array_equal(own.decode(z), model.decode(z))
    np.testing.assert_array_equal(
        own.fit_codes(shapes.vertices[:1]), model.fit(shapes.vertices[:1])
    )
    targets = shapes.vertices[4][HANDLES]
    np.testing.assert_array_equal(own.fit_handles(HANDLES, targets)[HANDLES], targets)
    soft = Autoencoder(model, hard=False).fit_handles(HANDLES, targets + 0.2 * np.eye(4)[:, :3])
    assert not np.array_equal(soft[HANDLES], targets)


def test_the_autoencoder_weighs_targets_by_their_noise():
    """As a solver with soft handles and `target_noise`; without noise they are exact again."""
    model, shapes = small_model(), sequence()
    own, noise = Autoencoder(model), 0.2
    targets = shapes.vertices[4][HANDLES]
    exact = own.fit_handles(HANDLES, targets)
    solver = HandleSolver(model, noise=target_noise(model, noise))
    solver.set_handles(HANDLES, targets)
    np.testing.assert_array_equal(own.fit_handles(HANDLES, targets, noise), solver.solve().vertices)
    np.testing.assert_array_equal(own.fit_handles(HANDLES, targets), exact)


@pytest.mark.slow
def test_the_autoencoder_trains():
    own = Autoencoder(epochs=2, device="cpu").fit(sequence(), 3)
    assert own.model.components == 3
    assert own.model.summary["epochs"] == 2
    assert own.encode(sequence().vertices).shape == (12, 3)


def test_bad_input_is_said_in_one_line():
    for own in (AcapSplocs(), GradientSplocs(), LinearComponents(), Autoencoder()):
        with pytest.raises(InputError, match="call fit first"):
            own.encode(sequence().vertices)
    with pytest.raises(InputError, match="at least 2 training shapes, got 1"):
        AcapSplocs().fit(sequence().subset([0]), 3)
    with pytest.raises(InputError, match="components: expected at least 1, got 0"):
        AcapSplocs().fit(sequence(), 0)
    with pytest.raises(InputError, match="noise: expected a positive number, got -1"):
        AcapSplocs(noise=-1).fit(sequence(), 3)
    own = learned(AcapSplocs)
    with pytest.raises(InputError, match=r"expected \(N, 120, 3\)"):
        own.encode(np.zeros((1, 5, 3)))
    with pytest.raises(InputError, match=r"\(N, 8\), got \(1, 7\)"):
        own.decode(np.zeros((1, 7)))
    with pytest.raises(InputError, match=r"vertices\[0, 1\]"):
        checked_shapes([[[0, 0, 0], [0, np.nan, 0]]], 2)
    for handles, targets, message in (
        ([], np.zeros((0, 3)), "at least one vertex"),
        ([0.5], np.zeros((1, 3)), "float64"),
        ([1, 2], np.zeros((1, 3)), r"expected \(2, 3\)"),
        ([1, 9], np.zeros((2, 3)), "vertex 9 does not exist"),
        ([1, 2], np.array([[0, 0, 0], [0, np.inf, 0]]), "handle 1: target"),
        ([2, 2], np.zeros((2, 3)), "2 is given twice"),
    ):
        with pytest.raises(InputError, match=message):
            checked_handles(handles, targets, 5)
