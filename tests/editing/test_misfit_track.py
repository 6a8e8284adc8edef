"""Truths of the field that codes of a sequence miss: against dense matrices, and in sequences."""

import numpy as np
import pytest

from deformer import HandleSolver, InputError, fit_sequence, local_rotations
from deformer.editing import misfit_track, sequence_windows
from deformer.editing.handle_errors import ModelErrors
from deformer.editing.misfit_track import MisfitTrack
from misfits import HANDLES, MISFIT, NOISE


@pytest.fixture(scope="module")
def truth(model):
    """Shapes that no code has, along a smooth path: (24, V, 3)."""
    t = np.linspace(0, 1, 24)[:, None]
    path = (1 - t) * model.codes[1] + t * model.codes[3]
    return np.add(model.decode(path) * [1.1, 1.0, 0.9], [0.0, 0.1, 0.0])


def field(seed=0, H=4):
    A = np.random.default_rng(seed).normal(size=(H, H + 2))
    K = A @ A.T
    scale = 1 / np.sqrt(np.diag(K))
    return ModelErrors(MISFIT, K * scale[:, None] * scale)


def in_time(smoothness, F):
    """Covariance (F, F) of a coefficient, and its precision, not yet scaled to a variance of 1."""
    D = np.diff(np.eye(F), 2, axis=0)
    precision = np.eye(F) + misfit_track._LENGTH**4 * smoothness * D.T @ D
    return np.linalg.inv(precision), precision


@pytest.mark.parametrize("smoothness", [0.0, 0.01, 1.0, 100.0])
def test_it_is_the_conditional_mean_of_a_field_in_space_and_time(smoothness):
    F, errors, rng = 9, field(), np.random.default_rng(1)
    weights = rng.uniform(0.5, 2.0, (F, 4))
    weights[2:5, 1] = weights[6] = 0.0
    found = rng.normal(size=(F, 4, 3))
    track = MisfitTrack(errors, NOISE, smoothness)
    T = in_time(smoothness, F)[0] / track._stiffness
    C = MISFIT**2 * np.kron(T, errors.correlation)
    seen = weights.ravel() > 0
    R = C[np.ix_(seen, seen)] + np.diag(NOISE**2 / weights.ravel()[seen])
    expected = C[:, seen] @ np.linalg.solve(R, found.reshape(-1, 3)[seen])
    # What is given where nothing is seen does not matter.
    found[weights == 0] = np.nan
    result = track.expected(F, weights, found)
    np.testing.assert_allclose(result.reshape(-1, 3), expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("smoothness", [0.0, 0.01, 1.0, 30.0])
def test_far_from_both_ends_the_variance_is_one(smoothness):
    track = MisfitTrack(field(), NOISE, smoothness)
    variance = np.diag(in_time(smoothness, 301)[0])[150] / track._stiffness
    assert variance == pytest.approx(1.0, abs=1e-3)


def test_windows_continue_each_other():
    """Frames after a window count in it; it goes on from what was found in those before."""
    F, errors, rng = 60, field(), np.random.default_rng(2)
    weights = np.ones((F, 4))
    weights[15:25] = 0.0
    found = np.cumsum(rng.normal(size=(F, 4, 3)), axis=0)
    whole = MisfitTrack(errors, NOISE, 1.0).expected(F, weights, found)
    track = MisfitTrack(errors, NOISE, 1.0)
    first = track.expected(20, weights[:50], found[:50])
    rest = track.expected(F - 20, weights[20:], found[20:])
    parts = np.concatenate([first, rest])
    np.testing.assert_allclose(parts, whole, atol=0.01 * np.abs(whole).max())


def test_without_smoothness_frames_are_poses(doubtful, truth):
    solver = HandleSolver(doubtful, noise=NOISE, freedom=1.0, relaxation=2)
    weights = np.ones((2, len(HANDLES)))
    weights[1, 3] = 0.0
    moved = truth[[2, 20]][:, HANDLES]
    found = fit_sequence(doubtful, HANDLES, moved, weights=weights, smoothness=0.0, noise=NOISE)
    diagonal = doubtful.reference.bounding_diagonal
    for frame in range(2):
        seen = weights[frame] > 0
        solver.set_handles(HANDLES[seen], moved[frame, seen])
        pose = solver.solve()
        np.testing.assert_allclose(found.residual[frame, seen], pose.residual, atol=1e-3 * diagonal)
        off = np.linalg.norm(found.vertices[frame] - pose.vertices, axis=1)
        # The handle that is not seen is where its neighbours let expect it.
        assert off.max() < 5e-3 * diagonal


@pytest.mark.parametrize("kind", ["soft", "exact"])
@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_nothing_jumps_where_a_handle_is_lost(doubtful, truth, kind, backend):
    if backend == "torch":
        pytest.importorskip("torch")
    diagonal = doubtful.reference.bounding_diagonal
    weights = np.ones((len(truth), len(HANDLES)))
    weights[8:16, 3] = weights[12:18, 8] = 0.0
    options = {"weights": weights, "noise": NOISE, "kinds": kind, "backend": backend}
    found, trusted = (
        fit_sequence(doubtful, HANDLES, truth[:, HANDLES], misfit=misfit, **options)
        for misfit in (None, 0.0)
    )
    steps, before = (
        np.linalg.norm(np.diff(fit.vertices - truth, axis=0), axis=2).max(axis=1)
        for fit in (found, trusted)
    )
    assert steps.max() < (1.0 if kind == "soft" else 0.6) * before.max()
    assert steps.max() < 0.01 * diagonal
    errors = [np.sqrt(((f.vertices - truth) ** 2).sum(axis=2).mean()) for f in (found, trusted)]
    assert errors[0] < (0.7 if kind == "soft" else 1.02) * errors[1]
    if kind == "exact":
        assert np.nanmax(found.residual) < 1e-6 * diagonal


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_exact_handles_that_turn_in_some_frames_are_met(doubtful, truth, backend):
    if backend == "torch":
        pytest.importorskip("torch")
    turns = local_rotations(doubtful, HANDLES, truth).copy()
    turns[5:9, 0] = turns[:, 2] = np.nan
    weights = np.ones(turns.shape[:2])
    weights[10:14, 0] = weights[15] = 0.0
    found = fit_sequence(
        doubtful,
        HANDLES,
        truth[:, HANDLES],
        orientations=turns,
        weights=weights,
        kinds="exact",
        backend=backend,
    )
    diagonal = doubtful.reference.bounding_diagonal
    assert np.nanmax(found.residual) < 1e-6 * diagonal
    assert np.nanmax(found.orientation_residual) < 1e-3
    steps = np.linalg.norm(np.diff(found.vertices - truth, axis=0), axis=2)
    assert steps.max() < 0.02 * diagonal


def test_a_misfit_of_zero_trusts_the_codes(model, doubtful, truth):
    options = {"noise": NOISE, "kinds": "soft"}
    expected = fit_sequence(model, HANDLES, truth[:, HANDLES], **options)
    found = fit_sequence(doubtful, HANDLES, truth[:, HANDLES], misfit=0.0, **options)
    np.testing.assert_allclose(found.vertices, expected.vertices, atol=1e-9)
    given = fit_sequence(model, HANDLES, truth[:, HANDLES], misfit=MISFIT, **options)
    own = fit_sequence(doubtful, HANDLES, truth[:, HANDLES], **options)
    np.testing.assert_allclose(given.vertices, own.vertices, atol=1e-9)
    assert np.abs(own.vertices - expected.vertices).max() > 1e-3
    with pytest.raises(InputError, match="misfit"):
        fit_sequence(model, HANDLES, truth[:, HANDLES], misfit=-1.0)


def test_long_sequences_are_smooth_where_windows_end(doubtful, truth, monkeypatch):
    whole = fit_sequence(doubtful, HANDLES, truth[:, HANDLES], noise=NOISE)
    monkeypatch.setattr(sequence_windows, "WINDOW", 12)
    monkeypatch.setattr(sequence_windows, "_AHEAD", 6)
    parts = fit_sequence(doubtful, HANDLES, truth[:, HANDLES], noise=NOISE)
    diagonal = doubtful.reference.bounding_diagonal
    assert np.abs(parts.vertices - whole.vertices).max() < 3e-3 * diagonal
    step, usual = (np.abs(np.diff(f.vertices, axis=0)).max(axis=(1, 2)) for f in (parts, whole))
    assert step[11] < 1.5 * usual.max()
