"""Sequences as few morph targets: how many, how exact, with which weights."""

import numpy as np
import pytest

import tubes
from deformer.animation import morphing
from deformer.animation.morphing import morph_targets
from deformer.errors import InputError


def swinging(count=30):
    """Shapes (F, V, 3) that are the first one plus two displacements, which go both ways."""
    rest = tubes.positions()
    one, two = np.random.default_rng(1).normal(size=(2, *rest.shape))
    t = np.linspace(0, 2 * np.pi, count)[:, None, None]
    return rest + np.sin(t) * one + 0.1 * (1 - np.cos(2 * t)) * two


def bending(count=30):
    return np.stack([tubes.positions(b) for b in np.linspace(0.0, 1.5, count)])


def errors(found, vertices):
    """Distances (F, V) of the shapes that the targets give."""
    offsets = np.tensordot(found.weights, found.targets.astype(float), 1)
    return np.linalg.norm(found.base + offsets - vertices, axis=2)


def test_a_sequence_of_two_displacements_has_two_targets_and_an_offset():
    vertices = swinging()
    found = morph_targets(vertices, 1e-4)
    assert found.names == ("principal 1", "principal 2", "offset") and found.principal
    assert found.weights.min() >= 0 and found.weights.max() <= 1
    np.testing.assert_array_equal(found.weights[:, 2], 1.0)
    np.testing.assert_array_equal(found.base, vertices[0])
    assert errors(found, vertices).max() < 1e-5


def test_displacements_of_one_side_need_no_offset():
    t = np.linspace(0, 1, 20)[:, None, None]
    away = np.random.default_rng(1).normal(size=tubes.positions().shape)
    found = morph_targets(tubes.positions() - t * away, 1e-4)
    assert found.names == ("principal 1",)
    np.testing.assert_allclose(found.weights[:, 0], np.linspace(0, 1, 20), atol=1e-9)


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-3])
def test_the_targets_are_the_fewest_that_keep_the_tolerance(tolerance):
    vertices = bending()
    found = morph_targets(vertices, tolerance)
    assert found.error <= tolerance
    assert abs(found.error - errors(found, vertices).max()) < 1e-6
    # The best shapes there are, one less of them: principal components of all displacements.
    count = sum(name != "offset" for name in found.names) - 1
    x = (vertices - vertices[0]).reshape(len(vertices), -1)
    u, s, v = np.linalg.svd(x, full_matrices=False)
    left = (x - (u[:, :count] * s[:count]) @ v[:count]).reshape(vertices.shape)
    assert np.linalg.norm(left, axis=2).max() > tolerance


def test_a_sequence_that_stands_still_has_no_targets():
    found = morph_targets(np.repeat(tubes.positions()[None], 4, axis=0), 0.0)
    assert found.targets.shape == (0, 40, 3) and found.weights.shape == (4, 0)
    assert found.error == 0


def test_a_sequence_that_moves_less_than_the_tolerance_has_a_target():
    assert len(morph_targets(bending(), 1e6).names) == 1


def test_shapes_that_have_nothing_in_common_are_targets_themselves():
    vertices = np.random.default_rng(2).normal(size=(6, 40, 3))
    found = morph_targets(vertices, 1e-3, tuple("abcdef"))
    assert not found.principal and found.names == tuple("bcdef")
    np.testing.assert_array_equal(found.weights, np.eye(6)[:, 1:])
    assert errors(found, vertices).max() < 1e-5
    assert morph_targets(vertices, 1e-3).names[0] == "frame 1"


def test_of_long_sequences_some_frames_give_the_principal_shapes(monkeypatch):
    monkeypatch.setattr(morphing, "_MOST_FRAMES", 12)
    vertices = bending(100)
    found = morph_targets(vertices, 1e-3)
    assert found.principal and len(found.names) < 10
    assert errors(found, vertices).max() <= 1e-3 + 1e-6


def test_chunks_of_vertices_give_the_same(monkeypatch):
    whole = morph_targets(bending(), 1e-3)
    monkeypatch.setattr(morphing, "_CHUNK", 300)
    parts = morph_targets(bending(), 1e-3)
    assert parts.names == whole.names
    np.testing.assert_allclose(parts.weights, whole.weights, atol=1e-6)
    np.testing.assert_allclose(parts.targets, whole.targets, atol=1e-6)


def test_more_targets_than_a_file_holds_are_refused(monkeypatch):
    monkeypatch.setattr(morphing, "_MOST_NUMBERS", 100)
    with pytest.raises(InputError, match=r"larger tolerance, or write a point cache"):
        morph_targets(bending(), 1e-3)
