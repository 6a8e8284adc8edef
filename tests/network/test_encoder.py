"""Truths of the encoder in numpy: it is the network's, or the projection that it was given."""

import numpy as np
import pytest
import torch

from deformer.acap.scaler import FeatureScaler
from deformer.network.decoder import Decoder
from deformer.network.encoder import Encoder
from networks import random_network
from shapes import awkward, tube

SCALER = FeatureScaler(-1.5, 2.0, -0.3, 1.8)


def build(mesh, layers, components=4):
    """A random network, its rings, and scaled features (V+B, 19, 9): more than a batch."""
    network, rings = random_network(mesh, layers, components)
    x = np.random.default_rng(0).uniform(-0.95, 0.95, size=(len(rings[0]) - 1, 19, 9))
    return network, rings, x


@pytest.mark.parametrize(
    ("mesh", "layers"),
    [(tube(), (9,)), (awkward(), (6,)), (tube(), (7, 5)), (awkward(), (6, 5, 4))],
    ids=["one layer", "one narrow layer", "two layers", "three layers"],
)
def test_codes_are_those_of_the_network(mesh, layers):
    network, rings, x = build(mesh, layers)
    q = SCALER.unscale(np.swapaxes(x, 0, 1))
    codes = Encoder(network.weights, SCALER, *rings).encode(q)
    assert codes.shape == (19, 4) and codes.dtype == np.float64
    with torch.no_grad():
        expected = network.double().encode(torch.tensor(x)).numpy()
    np.testing.assert_allclose(codes, expected, atol=2e-6 * np.abs(expected).max())


def test_a_projection_takes_the_place_of_the_network():
    network, rings, x = build(tube(), (9,))
    q = SCALER.unscale(np.swapaxes(x, 0, 1))[:3]
    decoder = Decoder(network.weights, SCALER, *rings)
    codes = Encoder(network.weights, SCALER, *rings, decoder).encode(q)
    np.testing.assert_array_equal(codes, [decoder.project(features) for features in q])
