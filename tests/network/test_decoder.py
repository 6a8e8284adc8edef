"""Truths of the decoder in numpy: it is the network, and its derivatives are derivatives."""

import numpy as np
import pytest
import torch

from deformer.acap.scaler import FeatureScaler
from deformer.network.decoder import Decoder
from networks import random_network
from shapes import awkward, tube

SCALER = FeatureScaler(-1.5, 2.0, -0.3, 1.8)
CASES = pytest.mark.parametrize(
    ("mesh", "layers"),
    [(tube(), (9,)), (awkward(), (6,)), (tube(), (7, 5)), (awkward(), (6, 5, 4))],
    ids=["one layer", "one narrow layer", "two layers", "three layers"],
)


def build(mesh, layers, components=4):
    """A random network and its decoder."""
    network, rings = random_network(mesh, layers, components, size=0.3)
    return network, Decoder(network.weights, SCALER, *rings)


@CASES
def test_features_are_those_of_the_network(mesh, layers):
    network, decoder = build(mesh, layers)
    for z in np.random.default_rng(0).normal(size=(3, 4)):
        with torch.no_grad():
            x = network.decode(torch.tensor(z[None], dtype=torch.float32))[:, 0]
        expected = SCALER.unscale(x.double().numpy())
        np.testing.assert_allclose(decoder.features(z), expected, atol=2e-5)


@CASES
def test_differential_is_a_central_difference(mesh, layers):
    _, decoder = build(mesh, layers)
    rng = np.random.default_rng(1)
    z = rng.normal(size=4)
    q, dq = decoder.differential(z)
    np.testing.assert_allclose(q, decoder.features(z), atol=1e-12)
    h = 1e-5
    for k in range(4):
        e = h * np.eye(4)[k]
        expected = (decoder.features(z + e) - decoder.features(z - e)) / (2 * h)
        np.testing.assert_allclose(dq[k], expected, rtol=1e-6, atol=1e-8)


@CASES
def test_pull_back_is_the_transposed_differential(mesh, layers):
    _, decoder = build(mesh, layers)
    rng = np.random.default_rng(2)
    z = rng.normal(size=4)
    g = rng.normal(size=(5, decoder.vertex_count, 9))
    expected = np.einsum("mvf,kvf->mk", g, decoder.differential(z)[1])
    np.testing.assert_allclose(decoder.pull_back(z, g), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("mesh", [tube(), awkward()], ids=["tube", "awkward"])
def test_projection_inverts_the_features(mesh):
    """Where no tanh is saturated; where one is, the code stays finite."""
    _, decoder = build(mesh, (9,))
    for z in 0.1 * np.random.default_rng(1).normal(size=(3, 4)):
        np.testing.assert_allclose(decoder.project(decoder.features(z)), z, atol=1e-4)
    assert np.isfinite(decoder.project(decoder.features(np.full(4, 100.0)) * 3.0)).all()
