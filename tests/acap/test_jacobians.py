"""Truths of T = exp(r) S and its derivatives: against reconstruction and finite differences."""

import numpy as np
import pytest
from scipy.linalg import expm, expm_frechet

from angles import NEAR, features_near
from deformer.acap.features import FeatureExtractor
from deformer.acap.gradients import features_to_gradients
from deformer.acap.jacobians import (
    gradient_tangents,
    position_sensitivities,
    positions_from_features,
)
from deformer.acap.poisson import PoissonSystem
from shapes import awkward, bend, tube, twist, two_components

MESHES = {"tube": tube(), "components": two_components(), "awkward": awkward()}


def random_features(V, seed=0):
    """Rotations from exactly none over almost none to several turns; any stretch."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(V, 9))
    q[:, :3] *= 10.0 ** rng.uniform(-6, 1, (V, 1))
    q[:5, :3] = 0
    return q


def central_difference(f, x, direction, h=1e-5):
    return (f(x + h * direction) - f(x - h * direction)) / (2 * h)


@pytest.mark.parametrize("name", MESHES)
def test_positions_from_features_are_reconstructed_positions(name):
    mesh = MESHES[name]
    system = PoissonSystem(mesh)
    q = FeatureExtractor(mesh).extract_sites(twist(bend(mesh.vertices, 1.0), 1.0))
    q[:, 3:] += 0.1 * np.random.default_rng(1).normal(size=q[:, 3:].shape)
    handles = [2, len(mesh.vertices) // 2, len(mesh.vertices) - 1]
    coefficients = system.position_coefficients(system.green_rows(handles))
    expected = system.reconstruct(q)[handles] - system.centroid
    np.testing.assert_allclose(positions_from_features(q, coefficients), expected, atol=1e-9)


def test_positions_are_sums_of_transformed_coefficients():
    q, coefficients = random_features(11), np.random.default_rng(2).normal(size=(4, 11, 3))
    expected = np.einsum("iab,hib->ha", features_to_gradients(q), coefficients)
    np.testing.assert_allclose(positions_from_features(q, coefficients), expected, atol=1e-11)
    assert positions_from_features(q, coefficients[:0]).shape == (0, 3)


@pytest.mark.parametrize("seed", range(5))
def test_sensitivities_are_central_differences(seed):
    q = random_features(11, seed)
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(size=(3, 11, 3))
    p, g = positions_from_features(q, coefficients), position_sensitivities(q, coefficients)
    np.testing.assert_allclose(p, positions_from_features(q, coefficients), atol=1e-12)
    for _ in range(5):
        dq = rng.normal(size=q.shape)
        expected = central_difference(lambda x: positions_from_features(x, coefficients), q, dq)
        found = np.einsum("hdif,if->hd", g, dq)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_every_entry_of_the_sensitivities():
    """One vertex, one feature at a time: an error cannot hide in a sum."""
    q = random_features(6, 3)
    coefficients = np.random.default_rng(4).normal(size=(2, 6, 3))
    g = position_sensitivities(q, coefficients)
    for i in range(6):
        for f in range(9):
            one = np.zeros_like(q)
            one[i, f] = 1.0
            expected = central_difference(
                lambda x: positions_from_features(x, coefficients), q, one
            )
            np.testing.assert_allclose(g[:, :, i, f], expected, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_tangents_are_central_differences(seed):
    q = random_features(13, seed)
    dq = np.random.default_rng(seed).normal(size=(4, 13, 9))
    found = gradient_tangents(q, dq)
    for change, tangent in zip(dq, found, strict=True):
        expected = central_difference(features_to_gradients, q, change)
        np.testing.assert_allclose(tangent, expected, rtol=1e-6, atol=1e-6)


def test_tangents_and_sensitivities_are_two_ways_to_one_number():
    q = random_features(13, 7)
    rng = np.random.default_rng(7)
    dq, coefficients = rng.normal(size=(2, 13, 9)), rng.normal(size=(3, 13, 3))
    one = np.einsum("hdif,mif->mhd", position_sensitivities(q, coefficients), dq)
    other = np.einsum("miab,hib->mha", gradient_tangents(q, dq), coefficients)
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def matrix_exponentials(q):
    """exp(r), [·]× of r and S of features, by a formula for any matrix."""
    crosses = np.cross(np.eye(3)[None, :, :], q[:, None, :3]).transpose(0, 2, 1) * -1.0
    S = q[:, 3:][:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    return crosses, S


@NEAR
def test_gradients_and_their_derivative_by_matrix_exponentials(near):
    """The formulas that all other versions of T = exp(r) S are held against."""
    q = features_near(near)
    crosses, S = matrix_exponentials(q)
    T = np.stack([expm(c) @ s for c, s in zip(crosses, S, strict=True)])
    np.testing.assert_allclose(features_to_gradients(q), T, atol=1e-12)
    units, unit_S = matrix_exponentials(np.eye(9))
    for m in range(9):
        dq = np.zeros((1, *q.shape))
        dq[0, :, m] = 1.0
        expected = np.stack(
            [
                expm_frechet(c, units[m], compute_expm=False) @ s + expm(c) @ unit_S[m]
                for c, s in zip(crosses, S, strict=True)
            ]
        )
        np.testing.assert_allclose(gradient_tangents(q, dq)[0], expected, atol=1e-9)
