"""Paths between shapes, against bends whose middle is known."""

import numpy as np
import pytest

from deformer import InputError, ShapePath, interpolate, interpolate_codes
from deformer.geometry.rotations import align, log_to_rotation
from shapes import bend, sequence, small_model


@pytest.fixture(scope="module")
def model():
    return small_model()


def tube(model, angle):
    return bend(model.reference.vertices, angle)


def test_features_pass_through_the_bend_between_two_bends(model):
    """Halfway between bends by −1.5 and 2.5 is the bend by 0.5; a straight line is far from it."""
    keys = np.stack([tube(model, -1.5), tube(model, 2.5)])
    middle = tube(model, 0.5)
    size = model.reference.bounding_diagonal

    def off(space):
        found = interpolate(model, keys, 3, space).vertices[1]
        return np.linalg.norm(align(found[None], middle)[0] - middle, axis=1).max() / size

    assert off("features") < 0.01
    assert off("linear") > 0.1


def test_keys_are_met(model):
    keys = sequence().vertices[[0, 3, 8]] + np.array([[[1.0, 0, 0]], [[0, 2.0, 0]], [[0, 0, 0]]])
    for space, tolerance in (("features", 1e-6), ("linear", 1e-12)):
        path = interpolate(model, keys, 4, space)
        assert len(path.vertices) == 7
        np.testing.assert_allclose(path.times, np.linspace(0, 2, 7))
        np.testing.assert_allclose(path.vertices[[0, 3, 6]], keys, atol=tolerance)
        np.testing.assert_allclose(path.keys, keys, atol=tolerance)
    path = interpolate(model, keys, 4, "latent")
    own = model.decode(model.encode(keys))
    own += (keys - own).mean(axis=1, keepdims=True)
    np.testing.assert_allclose(path.vertices[[0, 3, 6]], own, atol=1e-9)


def test_latent_interpolation_decodes_codes_on_a_line(model):
    keys = sequence().vertices[[1, 6]]
    a, b = model.encode(keys)
    expected = model.decode(0.75 * a + 0.25 * b)
    found = interpolate(model, keys, 5, "latent").vertices[1]
    shift = (found - expected).mean(axis=0)
    np.testing.assert_allclose(found - shift, expected, atol=1e-9)


def test_codes_between_keys_are_those_of_the_latent_path(model):
    keys = model.decode(model.codes[:3])
    codes = model.encode(keys)
    path = interpolate(model, keys, 5).vertices
    decoded = model.decode(interpolate_codes(codes, np.linspace(0, 2, 9)))
    centred = [shapes - shapes.mean(axis=1, keepdims=True) for shapes in (path, decoded)]
    np.testing.assert_allclose(*centred, atol=1e-9)
    np.testing.assert_allclose(interpolate_codes(codes, 1.25), codes[1] + (codes[2] - codes[1]) / 4)


@pytest.mark.parametrize("time", [-0.1, 1.1])
def test_times_beyond_the_keys_are_refused(model, time):
    with pytest.raises(InputError, match=r"times: expected 0…1, got .*; stay on the path"):
        interpolate_codes(model.codes[:2], time)


def test_turns_take_the_shorter_way_and_keep_lengths(model):
    """A rigid turn by 170° about an axis, from 100° on: features turn it, a line collapses it."""
    axis = np.array([0.6, 0.0, 0.8])
    base = tube(model, 0.7)
    keys = np.stack(
        [base @ log_to_rotation(np.radians(a) * axis).T + [a, 0, 0] for a in (100.0, 270.0)]
    )
    path = interpolate(model, keys, 3, "features")
    half = log_to_rotation(np.radians(185.0) * axis)
    expected = (base - base.mean(axis=0)) @ half.T
    found = path.vertices[1]
    centre = keys.mean(axis=1).mean(axis=0)
    np.testing.assert_allclose(found, expected + centre, atol=1e-6)
    np.testing.assert_allclose(path.edge_ratios(), 1.0, atol=1e-6)
    assert interpolate(model, keys, 3, "linear").length_ratios()[1] < 0.8


def test_only_the_straight_line_shrinks(model):
    """Between two opposite bends of examples."""
    keys = np.stack([tube(model, -1.2), tube(model, 1.2)])
    ratio = {space: interpolate(model, keys, 9, space).length_ratios().min()
             for space in ("latent", "features", "linear")}  # fmt: skip
    assert ratio["features"] > 0.995 and ratio["latent"] > 0.97
    assert ratio["linear"] < ratio["features"] - 0.02


def test_edge_ratios_by_hand():
    """One triangle: legs 1 and 1 become 2 and 1; halfway 1.5 and 1 are expected."""
    keys = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [2, 0, 0], [0, 1, 0.0]]])
    middle = np.array([[0, 0, 0], [0.75, 0, 0], [0, 1.0, 0]])
    path = ShapePath(
        np.stack([keys[0], middle, keys[1]]), keys, np.array([0, 0.5, 1]), np.array([[0, 1, 2]])
    )
    hypotenuse = np.hypot(0.75, 1) / ((np.sqrt(2) + np.sqrt(5)) / 2)
    np.testing.assert_allclose(path.edge_ratios(), [[1, 1, 1], [0.5, 1, hypotenuse], [1, 1, 1]])
    total = (0.75 + 1 + np.hypot(0.75, 1)) / (1.5 + 1 + (np.sqrt(2) + np.sqrt(5)) / 2)
    np.testing.assert_allclose(path.length_ratios(), [1, total, 1])


def test_mistakes_are_refused(model):
    keys = sequence().vertices[:2]
    with pytest.raises(InputError, match="space: expected one of latent, features, linear"):
        interpolate(model, keys, 3, "straight")
    with pytest.raises(InputError, match="steps"):
        interpolate(model, keys, 1)
    with pytest.raises(InputError, match="keys"):
        interpolate(model, keys[:1])
    with pytest.raises(InputError, match="keys"):
        interpolate(model, keys[:, :5])
