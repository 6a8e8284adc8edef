"""E_rms by hand and the order of its alignments."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deformer.errors import InputError
from deformer.metrics import e_rms, vertex_errors
from shapes import random_rotation, sequence


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


@settings(deadline=None)
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
