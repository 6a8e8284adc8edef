"""E_rms and STED by hand, and what they must not feel."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from deformer.errors import InputError
from deformer.geometry.metrics import STED_TIME_STEP, e_rms, sted, sted_spatial, vertex_errors
from shapes import icosphere, random_rotation, sequence, strip


def test_e_rms_by_hand():
    truth = np.zeros((2, 2, 3))
    estimate = truth.copy()
    estimate[0, 0] = [3, 0, 4]
    estimate[1, 1] = [0, 2, 0]
    # Σ ‖·‖² = 25 + 4 over 3 · 2 vertices · 2 shapes.
    assert e_rms(truth, estimate, "none") == pytest.approx(1000 * np.sqrt(29 / 12))
    # Centroids move by half the displacement in each shape: what is left is half of each square.
    assert e_rms(truth, estimate) == pytest.approx(1000 * np.sqrt(29 / 24))
    np.testing.assert_allclose(vertex_errors(truth, estimate), [[5, 0], [0, 2]])
    np.testing.assert_allclose(vertex_errors(truth[0], estimate[0]), [5, 0])
    assert e_rms(truth[0], estimate[0], "none") == pytest.approx(1000 * np.sqrt(25 / 6))


@pytest.mark.parametrize("mode", ["none", "centroid", "rigid"])
def test_no_difference_is_no_error(mode):
    p = sequence(4).vertices
    assert e_rms(p, p, mode) == pytest.approx(0, abs=1e-10)
    np.testing.assert_allclose(vertex_errors(p, p, mode), 0, atol=1e-12)


def test_alignment_removes_its_motion_from_every_shape():
    p = sequence(4).vertices
    rng = np.random.default_rng(0)
    shifted = p + rng.normal(size=(4, 1, 3))
    assert e_rms(p, shifted, "centroid") < 1e-9 < 100 < e_rms(p, shifted, "none")
    turned = np.array([shape @ random_rotation(rng).T for shape in shifted])
    assert e_rms(p, turned, "rigid") < 1e-9 < 100 < e_rms(p, turned, "centroid")


def test_a_mirrored_shape_is_not_a_moved_one():
    p = np.random.default_rng(1).normal(size=(20, 3))
    assert e_rms(p, p * [-1, 1, 1], "rigid") > 100


@given(st.integers(0, 10_000), st.floats(1e-6, 1e6))
def test_more_alignment_never_makes_it_worse(seed, unit):
    rng = np.random.default_rng(seed)
    p, e = unit * rng.normal(size=(2, 3, 9, 3))
    none, centroid, rigid = (e_rms(p, e, mode) for mode in ("none", "centroid", "rigid"))
    assert rigid <= centroid * (1 + 1e-12) and centroid <= none * (1 + 1e-12)
    assert none == pytest.approx(unit * e_rms(p / unit, e / unit, "none"))
    errors = vertex_errors(p, e, "rigid")
    assert errors.shape == (3, 9)
    assert 1000 * np.sqrt((errors**2).mean() / 3) == pytest.approx(rigid)


def test_wrong_arguments_are_refused():
    p = np.zeros((2, 4, 3))
    with pytest.raises(InputError, match=r"\(2, 4, 3\).*\(4, 3\)"):
        e_rms(p, p[0])
    with pytest.raises(InputError, match=r"\(2, 4, 2\)"):
        e_rms(p[..., :2], p[..., :2])
    with pytest.raises(InputError, match="'affine'"):
        e_rms(p, p, "affine")


TRIANGLE = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])  # edges of 3, 4 and 5


def test_spatial_sted_by_hand():
    stretched = TRIANGLE * [2, 1, 1]  # edges of 6, 4 and √52
    long = np.sqrt(52) / 5 - 1
    # At each vertex two edges, ℓ-weighted: deviation = |δ₁ − δ₂| √(ℓ₁ ℓ₂) / (ℓ₁ + ℓ₂).
    by_hand = [1 * np.sqrt(12) / 7, (1 - long) * np.sqrt(15) / 8, long * np.sqrt(20) / 9]
    assert sted_spatial(TRIANGLE, stretched, [[0, 1, 2]]) == pytest.approx(np.mean(by_hand))
    # A stretch that the whole neighbourhood shares is none.
    assert sted_spatial(TRIANGLE, 1.7 * TRIANGLE, [[0, 1, 2]]) == pytest.approx(0, abs=1e-12)
    # Shapes count alike, and so do vertices: one without an edge does not.
    both = np.stack([TRIANGLE, TRIANGLE])
    halved = sted_spatial(both, np.stack([TRIANGLE, stretched]), [[0, 1, 2]])
    assert halved == pytest.approx(np.mean(by_hand) / 2)
    loose = [np.vstack([p, [[9.0, 9, 9]]]) for p in (TRIANGLE, stretched)]
    assert sted_spatial(*loose, [[0, 1, 2]]) == pytest.approx(np.mean(by_hand))


def test_temporal_sted_by_hand():
    # Twice the way from the centroid (1, 4/3, 0) to the farthest corner (0, 4, 0).
    dt = STED_TIME_STEP * 2 * np.sqrt(1 + 64 / 9)
    steps = dt * np.array([np.sqrt(3), np.sqrt(8)])  # τ = 2 dt and 3 dt
    x = np.cumsum([0, *steps])
    truth = TRIANGLE + x[:, None, None] * [0, 0, 1]
    # The estimate takes the second step first: τ̂ = 3 dt and 2 dt, δ = 1/2 and −1/3.
    estimate = TRIANGLE + np.cumsum([0, *steps[::-1]])[:, None, None] * [0, 0, 1]
    found = sted(truth, estimate, [[0, 1, 2]])
    assert found.spatial == pytest.approx(0, abs=1e-12)
    assert found.temporal == pytest.approx((1 / 2 + 1 / 3) * np.sqrt(2 * 3) / (2 + 3))
    assert found.value == pytest.approx(found.temporal)
    # Faster by the same factor in every step is no deviation.
    steady = TRIANGLE + np.arange(4)[:, None, None] * [0, 0, 1.0]
    assert sted(steady, 1.0 * steady * [1, 1, 2], [[0, 1, 2]]).temporal == pytest.approx(
        0, abs=1e-9
    )


def test_temporal_sted_looks_at_windows():
    """One wrong step among ten is felt only by the windows that hold it."""
    at_rest = np.tile(TRIANGLE, (11, 1, 1))
    jump = at_rest + (np.arange(11) > 4)[:, None, None] * [0, 0, 0.02 * np.sqrt((1 + 64 / 9) * 3)]
    # τ̂ = 2 dt once, δ = 1 in five of six windows: deviation √(1/5 − 1/25).
    assert sted(at_rest, jump, [[0, 1, 2]]).temporal == pytest.approx(5 / 6 * np.sqrt(4 / 25))


def test_sted_feels_neither_rigid_motion_nor_unit():
    p, rng = sequence(8), np.random.default_rng(0)
    e = p.vertices + 0.02 * rng.normal(size=p.vertices.shape)
    assert sted(p.vertices, p.vertices, p.faces).value == 0
    here = sted(p.vertices, e, p.faces)
    R, t = random_rotation(rng), rng.normal(size=3)
    for moved in [
        sted(p.vertices @ R.T + t, e, p.faces),
        sted(p.vertices, e @ R.T + t, p.faces),
        sted(1e4 * p.vertices, 1e4 * e, p.faces),
    ]:
        assert moved.spatial == pytest.approx(here.spatial, rel=1e-9)
        assert moved.temporal == pytest.approx(here.temporal, rel=1e-9)
    assert sted(p.vertices, p.vertices @ R.T + t, p.faces).value < 1e-9


def test_sted_hears_noise_louder_than_a_smooth_error():
    p, rng = sequence(12), np.random.default_rng(1)
    noise = rng.normal(size=p.vertices.shape)
    smooth = np.sin(p.vertices[:, :, [1, 0, 0]] + np.arange(12)[:, None, None] / 12)
    noise, smooth = (0.02 * d / np.sqrt((d**2).mean()) for d in (noise, smooth))
    rough, even = p.vertices + noise, p.vertices + smooth
    assert e_rms(p.vertices, rough, "none") == pytest.approx(e_rms(p.vertices, even, "none"))
    a, b = sted(p.vertices, rough, p.faces), sted(p.vertices, even, p.faces)
    assert a.spatial > 5 * b.spatial and a.temporal > 5 * b.temporal


def test_sted_stands_coincident_vertices():
    mesh = strip()
    pinched = mesh.vertices.copy()
    pinched[7] = pinched[6]
    assert 0 < sted_spatial(pinched, mesh.vertices, mesh.faces) < np.inf
    assert sted_spatial(0 * pinched, 0 * pinched, mesh.faces) == 0
    ball = icosphere(1)
    with pytest.raises(InputError, match="2 frames"):
        sted(ball.vertices, ball.vertices, ball.faces)
