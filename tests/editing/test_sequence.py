"""Truths of sequences fitted as a whole: against single frames, an independent optimiser, time."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from deformer import HandleSolver, ModelConfig, fit_sequence, train
from deformer.editing import sequence_windows
from deformer.errors import InputError
from deformer.geometry.rotations import log_to_rotation
from distances import largest
from settings import QUICK_ADAM
from shapes import large_model, sequence, small_model

HANDLES = np.arange(4, 120, 12)
FRAMES = 40
NOISE = 0.007
pytestmark = pytest.mark.filterwarnings("error")


def decoded(model, count=FRAMES, chosen=(1, 3, 5, 8, 10)):
    """Shapes (count, V, 3) along a smooth path among the training codes.

    It keeps nearer to the mean than the codes that guide it: a spline swings beyond its points.
    """
    guides = 0.3 * model.latent_mean + 0.7 * model.codes[list(chosen)]
    path = CubicSpline(np.linspace(0, 1, len(chosen)), guides)
    return np.array([model.decode(z) for z in path(np.linspace(0, 1, count))])


@pytest.fixture(scope="module")
def truth(model):
    return decoded(model)


@cache
def deep_model():
    training = replace(QUICK_ADAM, layers=(7, 5), epochs=60, mixed_shapes=0)
    config = ModelConfig("deep", 4, training)
    return train(sequence(), config=config, device="cpu")


def rms(difference):
    return np.sqrt((difference**2).mean())


def jitter(vertices):
    """Mean squared acceleration."""
    return (np.diff(vertices, 2, axis=0) ** 2).mean()


def moving(vertices, diagonal):
    """The shapes, turned and carried along a smooth path."""
    t = np.linspace(0, 1, len(vertices))
    R = log_to_rotation(np.column_stack([0.6 * np.sin(3 * t), 0.4 * t, -0.3 * t**2]))
    place = diagonal * np.column_stack([0.5 * t, 0.2 * np.cos(4 * t), 0 * t])
    return vertices @ R.transpose(0, 2, 1) + place[:, None]


@pytest.mark.parametrize("case", ["still", "rigid", "moving"])
def test_a_decoded_sequence_is_recovered(model, diagonal, truth, case):
    goal = moving(truth, diagonal) if case == "moving" else truth
    fit = fit_sequence(model, HANDLES, goal[:, HANDLES], rigid=case != "still")
    assert fit.vertices.shape == goal.shape and fit.z.shape == (FRAMES, model.components)
    assert rms(fit.vertices - goal) < 0.002 * diagonal
    assert largest(fit.vertices - goal) < 0.01 * diagonal
    assert fit.residual.shape == (FRAMES, len(HANDLES))
    expected = np.linalg.norm(fit.vertices[:, HANDLES] - goal[:, HANDLES], axis=2)
    np.testing.assert_allclose(fit.residual, expected, atol=1e-12)
    assert fit.residual.max() < 0.005 * diagonal
    if case == "still":
        assert not fit.rotation.any() and not fit.translation.any()


def test_the_vertices_are_the_decoded_codes_moved_rigidly(model, diagonal, truth):
    goal = moving(truth, diagonal)[:12]
    fit = fit_sequence(model, HANDLES, goal[:, HANDLES])
    centre = model.reference.vertices.mean(axis=0)
    R = log_to_rotation(fit.rotation)
    shapes = np.array([model.decode(z) for z in fit.z]) - centre
    expected = shapes @ R.transpose(0, 2, 1) + centre + fit.translation[:, None]
    np.testing.assert_allclose(fit.vertices, expected, atol=1e-5 * diagonal)
    white = np.linalg.solve(
        np.linalg.cholesky(model.latent_covariance), (fit.z - model.latent_mean).T
    )
    np.testing.assert_allclose(fit.prior_distance, np.linalg.norm(white, axis=0), rtol=1e-6)


def unknowns(model, fit):
    """Whitened codes, rotations, translations in diagonals (F, K + 6), and their stiffness."""
    L = np.linalg.cholesky(model.latent_covariance)
    y = np.linalg.solve(L, (fit.z - model.latent_mean).T).T
    x = np.column_stack([y, fit.rotation, fit.translation / model.reference.bounding_diagonal])
    return x, np.concatenate([np.ones(y.shape[1]), np.full(3, 0.3**-2), np.ones(3)])


@pytest.mark.parametrize("name", ["small", "large"])
@pytest.mark.parametrize("rigid", [True, False], ids=["rigid", "still"])
def test_without_smoothness_every_frame_is_a_solve_of_its_own(name, rigid):
    model = small_model() if name == "small" else large_model()
    diagonal = model.reference.bounding_diagonal
    handles = HANDLES if name == "small" else np.arange(10, 1440, 130)
    goals = decoded(model, 16)[:, handles] + 0.003 * diagonal * np.random.default_rng(0).normal(
        size=(16, len(handles), 3)
    )
    weights = np.random.default_rng(1).uniform(0.3, 3.0, size=goals.shape[:2])
    fit = fit_sequence(model, handles, goals, weights=weights, smoothness=0, rigid=rigid)
    x, stiffness = unknowns(model, fit)
    misfit = (weights * fit.residual**2).sum(axis=1) / (NOISE * diagonal) ** 2
    energy = misfit + x**2 @ stiffness
    solver = HandleSolver(model, rigid=rigid, freedom=1.0)
    for f in range(len(goals)):
        solver.set_handles(handles, goals[f], weights[f])
        pose = solver.solve()
        assert largest(fit.vertices[f] - pose.vertices) < 2e-3 * diagonal
        assert energy[f] < 1.005 * pose.energy


@pytest.mark.parametrize(("smoothness", "angle"), [(1.0, 0.0), (100.0, 0.0), (10.0, 2.5)])
def test_the_energy_is_that_of_an_independent_optimiser(model, diagonal, smoothness, angle):
    """All unknowns at once, by the formula, in double precision and without any structure."""
    rng = np.random.default_rng(2)
    goals = decoded(model, 5)[:, HANDLES] @ log_to_rotation([0, 0.6 * angle, 0.8 * angle]).T
    goals += 0.01 * diagonal * rng.normal(size=(5, 10, 3))
    fit = fit_sequence(model, HANDLES, goals, smoothness=smoothness)
    x, stiffness = unknowns(model, fit)
    L, centre = np.linalg.cholesky(model.latent_covariance), model.reference.vertices.mean(axis=0)

    def residuals(flat):
        x = flat.reshape(5, -1)
        z = model.latent_mean + x[:, :-6] @ L.T
        p = np.array([model.decode(code) for code in z])[:, HANDLES] - centre
        R, t = log_to_rotation(x[:, -6:-3]), centre + diagonal * x[:, -3:]
        moved = p @ R.transpose(0, 2, 1) + t[:, None]
        scaled = np.sqrt(stiffness) * x
        bends = np.sqrt(smoothness) * np.diff(scaled, 2, axis=0)
        beyond = model.bend_limits.excess(z)
        parts = (moved - goals) / (NOISE * diagonal), scaled, bends, beyond
        return np.concatenate([part.ravel() for part in parts])

    best = 2 * least_squares(residuals, x.ravel(), method="lm", max_nfev=2000).cost
    assert best < (residuals(x.ravel()) ** 2).sum() < 1.001 * best


def test_hard_handles_are_met_wherever_they_are_seen(model, diagonal, truth):
    """And where they are not, neither is their target looked at."""
    rng = np.random.default_rng(3)
    goals = truth[:, HANDLES] + 0.01 * diagonal * rng.normal(size=(FRAMES, 10, 3))
    weights = rng.uniform(0.5, 2, size=(FRAMES, 10)) * (rng.random((FRAMES, 10)) < 0.7)
    weights[17] = 0
    unseen = weights == 0
    goals[unseen] = np.nan
    fit = fit_sequence(model, HANDLES, goals, weights=weights, hard=True)
    assert np.array_equal(fit.vertices[:, HANDLES][~unseen], goals[~unseen])
    assert np.array_equal(np.isnan(fit.residual), unseen)
    assert np.isfinite(fit.vertices).all()
    assert largest(fit.vertices - truth) < 0.1 * diagonal
    other = np.where(unseen[:, :, None], 1e6, goals)
    again = fit_sequence(model, HANDLES, other, weights=weights, hard=True)
    np.testing.assert_allclose(again.vertices, fit.vertices, atol=1e-6 * diagonal)


def test_hard_by_handle(model, diagonal, truth):
    goals = truth[:10, HANDLES] + 0.02 * diagonal * np.random.default_rng(4).normal(
        size=(10, 10, 3)
    )
    hard = np.arange(10) % 3 == 0
    fit = fit_sequence(model, HANDLES, goals, hard=hard)
    assert np.array_equal(fit.vertices[:, HANDLES[hard]], goals[:, hard])
    assert (fit.residual[:, ~hard] > 1e-4 * diagonal).all()


def test_a_frame_without_hard_handles_is_not_relaxed(model, diagonal, truth):
    """Whatever the frames are that it is computed together with."""
    weights = np.ones((8, 10))
    weights[[1, 6]] = 0
    fit = fit_sequence(model, HANDLES, truth[:8, HANDLES], weights=weights, hard=True)
    centre = model.reference.vertices.mean(axis=0)
    for f in (1, 6):
        shape = (model.decode(fit.z[f]) - centre) @ log_to_rotation(fit.rotation[f]).T
        expected = shape + centre + fit.translation[f]
        np.testing.assert_allclose(fit.vertices[f], expected, atol=1e-5 * diagonal)


def test_frames_that_see_nothing_are_bridged(model, diagonal, truth):
    """A gap, every twelfth frame, the first and the last, far from where the mean is."""
    goal = moving(truth, diagonal) @ log_to_rotation([0, 0, 2.5]).T + 2 * diagonal
    weights = np.ones((FRAMES, 10))
    weights[::12] = 0
    weights[20:26] = 0
    weights[-1] = 0
    goals = np.where(weights[:, :, None] > 0, goal[:, HANDLES], np.nan)
    fit = fit_sequence(model, HANDLES, goals, weights=weights)
    assert largest(fit.vertices - goal) < 0.03 * diagonal
    # They have not led the search astray.
    assert fit.iterations <= 4
    # No jump into a gap or out of it; beyond the last frame seen the motion goes straight on.
    step = largest(np.diff(goal, axis=0))
    assert largest(np.diff(fit.vertices - goal, axis=0)[:-1]) < 0.5 * step


def test_handles_that_are_lost_for_a_while_are_bridged(model, diagonal, truth):
    """Half of them: the smoother, the nearer to what their neighbours in time say."""
    weights = np.ones((FRAMES, 10))
    weights[20:26, ::2] = 0
    goals = np.where(weights[:, :, None] > 0, truth[:, HANDLES], np.nan)
    errors, jumps = [], []
    for smoothness in (0, 1, 10, 100):
        fit = fit_sequence(model, HANDLES, goals, weights=weights, smoothness=smoothness)
        errors.append(largest(fit.vertices - truth))
        jumps.append(largest(np.diff(fit.vertices - truth, axis=0)))
    assert all(b < 0.95 * a for a, b in pairwise(errors)), errors
    assert all(b < 0.8 * a for a, b in pairwise(jumps)), jumps


def test_without_smoothness_a_frame_that_sees_nothing_is_the_mean(model, diagonal, truth):
    """Even amid frames that are all alike."""
    goals = np.repeat(truth[7:8, HANDLES], 9, axis=0)
    weights = np.ones((9, 10))
    weights[3:5] = 0
    fit = fit_sequence(model, HANDLES, goals, weights=weights, smoothness=0)
    assert largest(fit.vertices[3:5] - model.decode(model.latent_mean)) < 1e-3 * diagonal


def test_nothing_to_see_is_the_mean(model, diagonal, truth):
    mean = model.decode(model.latent_mean)
    none = fit_sequence(model, [], np.zeros((3, 0, 3)))
    lost = fit_sequence(model, HANDLES, truth[:3, HANDLES], weights=np.zeros(10))
    for fit in (none, lost):
        assert largest(fit.vertices - mean) < 1e-5 * diagonal


def test_smoothness_takes_jitter_and_error_away(model, diagonal, truth):
    noise = 0.01 * diagonal * np.random.default_rng(5).normal(size=(FRAMES, 10, 3))
    fits = [
        fit_sequence(model, HANDLES, truth[:, HANDLES] + noise, smoothness=s).vertices
        for s in (0, 1, 10, 100)
    ]
    moves = [jitter(fit - truth) for fit in fits]
    errors = [rms(fit - truth) for fit in fits]
    assert all(b < 0.9 * a for a, b in pairwise(moves)), moves
    assert all(b < 0.97 * a for a, b in pairwise(errors)), errors
    assert jitter(fits[-1]) < 0.5 * jitter(fits[0])


@pytest.mark.parametrize("smoothness", [1.0, 1000.0])
def test_there_is_no_lag(model, diagonal, smoothness):
    """A sine motion, with noise, goes best with the true one at no shift."""
    t = np.arange(60)
    z = model.latent_mean + np.sin(2 * np.pi * t / 20)[:, None] * (
        model.codes[3] - model.latent_mean
    )
    truth = np.array([model.decode(code) for code in z])
    noise = 0.005 * diagonal * np.random.default_rng(6).normal(size=(60, 10, 3))
    fit = fit_sequence(model, HANDLES, truth[:, HANDLES] + noise, smoothness=smoothness).vertices
    still = truth.mean(axis=0)
    inside = slice(5, -5)
    shifts = range(-5, 6)
    agreement = [
        ((np.roll(fit, -shift, axis=0)[inside] - still) * (truth[inside] - still)).sum()
        for shift in shifts
    ]
    assert shifts[int(np.argmax(agreement))] == 0
    # Nor between frames: earlier and later shifts agree alike.
    early, late = agreement[4], agreement[6]
    assert abs(early - late) < 0.1 * (agreement[5] - max(early, late))


def test_identical_frames_give_identical_poses(model, diagonal, truth):
    goals = np.repeat(truth[7:8, HANDLES], 30, axis=0)
    fit = fit_sequence(model, HANDLES, goals)
    assert largest(fit.vertices - fit.vertices[0]) < 1e-5 * diagonal
    hard = fit_sequence(model, HANDLES, goals, hard=True)
    assert largest(hard.vertices - hard.vertices[0]) < 1e-5 * diagonal


def test_a_sequence_backwards_is_fitted_backwards(model, diagonal, truth):
    noise = 0.005 * diagonal * np.random.default_rng(7).normal(size=(FRAMES, 10, 3))
    goals = moving(truth, diagonal)[:, HANDLES] + noise
    there = fit_sequence(model, HANDLES, goals, smoothness=10)
    back = fit_sequence(model, HANDLES, goals[::-1], smoothness=10)
    assert largest(there.vertices - back.vertices[::-1]) < 2e-3 * diagonal


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("hard", [False, True])
def test_few_frames(model, diagonal, truth, count, hard):
    fit = fit_sequence(model, HANDLES, truth[:count, HANDLES], hard=hard)
    assert largest(fit.vertices - truth[:count]) < 0.02 * diagonal
    if count == 1:
        solver = HandleSolver(model, relaxation=2, freedom=1.0)
        solver.set_handles(HANDLES, truth[0, HANDLES], hard=hard)
        assert largest(fit.vertices[0] - solver.solve().vertices) < 2e-3 * diagonal


@pytest.mark.parametrize("lost", [False, True], ids=["all seen", "a window lost"])
def test_windows_join_as_if_there_were_one(model, diagonal, truth, monkeypatch, lost):
    goal = moving(truth, diagonal)
    noise = 0.005 * diagonal * np.random.default_rng(8).normal(size=(FRAMES, 10, 3))
    weights = np.ones((FRAMES, 10))
    if lost:
        weights[15:25] = 0
    events: list[tuple[int, int]] = []

    def fit():
        events.clear()
        return fit_sequence(
            model,
            HANDLES,
            goal[:, HANDLES] + noise,
            weights=weights,
            smoothness=30,
            on_progress=lambda done, total: events.append((done, total)),
        ).vertices

    whole = fit()
    assert list(dict.fromkeys(events)) == [(0, FRAMES), (FRAMES, FRAMES)]
    monkeypatch.setattr(sequence_windows, "WINDOW", 15)
    monkeypatch.setattr(sequence_windows, "_AHEAD", 8)
    parts = fit()
    assert list(dict.fromkeys(events)) == [(n, FRAMES) for n in (0, 15, 30, FRAMES)]
    assert largest(parts - whole) < (0.02 if lost else 3e-3) * diagonal


def test_a_motion_of_a_whole_turn_is_followed(model, diagonal, truth):
    """Rotation vectors go on beyond a half turn; nothing jumps there."""
    angle = np.linspace(0, 2 * np.pi, FRAMES)
    R = log_to_rotation(angle[:, None] * np.array([0.0, 0.6, 0.8]))
    goal = truth @ R.transpose(0, 2, 1)
    fit = fit_sequence(model, HANDLES, goal[:, HANDLES])
    assert largest(fit.vertices - goal) < 0.05 * diagonal
    assert np.linalg.norm(fit.rotation[-1]) > 5.5


@pytest.mark.slow
def test_a_model_of_two_layers(truth, diagonal):
    model = deep_model()
    goal = decoded(model, 10)
    for device in ("cpu", "auto"):
        fit = fit_sequence(model, HANDLES, goal[:, HANDLES], device=device)
        assert rms(fit.vertices - goal) < 0.005 * diagonal
    with pytest.raises(InputError, match=r"several layers .* use the backend 'numba'"):
        fit_sequence(model, HANDLES, goal[:, HANDLES], backend="torch")


def test_backends_agree(model, diagonal, truth):
    """Soft, hard, weighted, missing: torch's kernels do what those of all cores do."""
    rng = np.random.default_rng(9)
    goals = truth[:, HANDLES] + 0.003 * diagonal * rng.normal(size=(FRAMES, 10, 3))
    weights = rng.uniform(0.5, 2, size=(FRAMES, 10)) * (rng.random((FRAMES, 10)) < 0.8)
    weights[20:22] = 0
    cases = [
        {},
        {"hard": True},
        {"weights": weights},
        {"weights": weights, "hard": np.arange(10) % 2 == 0, "smoothness": 10.0, "rigid": False},
    ]
    for case in cases:
        cpu = fit_sequence(model, HANDLES, goals, **case)
        torch = fit_sequence(model, HANDLES, goals, backend="torch", **case)
        assert largest(torch.vertices - cpu.vertices) < 1e-4 * diagonal, case
        np.testing.assert_allclose(torch.residual, cpu.residual, atol=1e-4 * diagonal)
        assert torch.iterations == cpu.iterations


def changed(array, place, value):
    copy = np.array(array, dtype=float)
    copy[place] = value
    return copy


T = np.zeros((4, 3, 3))
W = np.ones((4, 3))
REFUSED = {
    "one frame": ({"targets": T[0]}, r"targets: expected \(F, 3, 3\).*got \(3, 3\)"),
    "flat": ({"targets": T[..., :2]}, r"targets: expected \(F, 3, 3\)"),
    "no frame": ({"targets": T[:0]}, r"targets: expected \(F, 3, 3\)"),
    "fewer targets": ({"targets": T[:, :2]}, r"targets: expected \(F, 3, 3\).*got \(4, 2, 3\)"),
    "nan": (
        {"targets": changed(T, (2, 1, 0), np.nan)},
        "frame 2, handle 1: target .* is not finite; .* weight 0",
    ),
    "nan with a weight": (
        {"targets": changed(T, (3, 2), np.inf), "weights": changed(W, (3, 1), 0)},
        "frame 3, handle 2: target .* is not finite",
    ),
    "negative": ({"weights": changed(W, (1, 2), -1)}, "frame 1, handle 2: weight -1.0"),
    "nan weight": ({"weights": changed(W, (1, 0), np.nan)}, "frame 1, handle 0: weight nan"),
    "weights": ({"weights": W[:2]}, r"weights: expected \(4, 3\) or \(3,\), got \(2, 3\)"),
    "twice": ({"vertices": [5, 6, 5]}, "vertex 5 is given twice"),
    "range": ({"vertices": [5, 120, 6]}, r"vertices\[1\]: vertex 120 does not exist"),
    "negative index": ({"vertices": [-1, 1, 6]}, r"vertices\[0\]: vertex -1 does not exist"),
    "floats": ({"vertices": [0.5, 1, 6]}, "vertices: expected .* integers"),
    "hard": ({"hard": [True, False]}, r"hard: expected \(3,\)"),
    "smoothness": ({"smoothness": -1.0}, "smoothness: expected .* at least 0"),
    "nan smoothness": ({"smoothness": np.nan}, "smoothness: .* got nan"),
    "noise": ({"noise": 0.0}, "noise: expected .* above 0"),
    "device": ({"device": "abacus"}, "device: expected .* got 'abacus'"),
    "backend": ({"backend": "abacus"}, "backend: expected one of numba, torch, got 'abacus'"),
    "backend as a device": ({"device": "torch"}, "device: expected .* got 'torch'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_mistakes_are_refused_in_one_line(model, case):
    given, message = REFUSED[case]
    arguments = {"vertices": [5, 50, 100], "targets": T, **given}
    with pytest.raises(InputError, match=message) as caught:
        fit_sequence(model, arguments.pop("vertices"), arguments.pop("targets"), **arguments)
    assert "\n" not in str(caught.value)


def paths(model, count=20):
    """Codes (count, K) from one training code to another, and targets a little off their shapes."""
    share = np.linspace(0.0, 1.0, count)[:, None]
    means = (1.0 - share) * model.codes[8] + share * model.codes[3]
    targets = np.array([model.decode(z)[[10, 60, 110]] for z in means])
    targets[:, 1, 2] += 0.1
    return means, targets


@pytest.mark.parametrize("smoothness", [0.0, 10.0])
def test_without_handles_each_frame_is_the_shape_of_its_mean(model, smoothness):
    means, _ = paths(model)
    found = fit_sequence(model, [], np.zeros((20, 0, 3)), mean=means, smoothness=smoothness)
    np.testing.assert_allclose(found.z, means, atol=1e-9)
    np.testing.assert_allclose(found.prior_distance, 0.0, atol=1e-9)
    assert largest(found.vertices - [model.decode(z) for z in means]) < 1e-5


@pytest.mark.parametrize("freedom", [0.01, 1.0, "auto", "stays"])
def test_without_smoothness_frames_are_single_poses_with_their_means_and_freedom(model, freedom):
    """Against `HandleSolver`, for the parameters that a viewer's pose has."""
    means, targets = paths(model)
    found = fit_sequence(
        model, [10, 60, 110], targets, mean=means, freedom=freedom, noise=NOISE, smoothness=0.0
    )
    solver = HandleSolver(model, noise=NOISE, freedom=freedom)
    for frame in (0, 7, 19):
        solver.set_prior(mean=means[frame])
        solver.set_handles([10, 60, 110], targets[frame])
        pose = solver.solve()
        assert found.prior_distance[frame] == pytest.approx(pose.prior_distance, rel=1e-2)
        assert largest(found.vertices[frame] - pose.vertices) < 5e-3


def test_the_model_s_mean_is_that_of_no_mean(model):
    _, targets = paths(model)
    plain, same = (
        fit_sequence(model, [10, 60, 110], targets, noise=NOISE, **given)
        for given in ({}, {"mean": model.latent_mean})
    )
    np.testing.assert_allclose(same.vertices, plain.vertices, atol=1e-6)


def test_an_exception_of_the_report_ends_a_fit_before_its_first_frame_is_done(model):
    """A window asks there whether the fit is still wanted."""

    class Cancelled(Exception):
        pass

    seen = []

    def report(done, total):
        seen.append((done, total))
        raise Cancelled

    _, targets = paths(model)
    with pytest.raises(Cancelled):
        fit_sequence(model, [10, 60, 110], targets, on_progress=report)
    assert seen == [(0, 20)]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"mean": np.zeros(3)}, "mean: expected"),
        ({"mean": np.zeros((19, 2))}, "mean: expected"),
        ({"freedom": 0.0}, "freedom"),
    ],
)
def test_means_and_freedom_are_checked(model, given, words):
    _, targets = paths(model)
    with pytest.raises(InputError, match=words):
        fit_sequence(model, [10, 60, 110], targets, **given)
