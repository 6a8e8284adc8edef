"""Truths of the weights as arrays: nothing is lost on the way to torch and back."""

import numpy as np
import pytest
import torch

from deformer.errors import InputError
from deformer.geometry.mesh import one_rings
from deformer.network.autoencoder import MeshAutoencoder
from deformer.network.weights import NetworkWeights, ring_mean
from shapes import awkward, tube


def random_weights(mesh, layers, components=3):
    torch.manual_seed(0)
    rings = one_rings(mesh.faces, len(mesh.vertices))
    return MeshAutoencoder(*rings, components, layers).weights, rings


@pytest.mark.parametrize("layers", [(9,), (7, 5), (6, 5, 4)], ids=str)
def test_weights_come_back_from_arrays_and_from_torch(layers):
    weights, rings = random_weights(tube(), layers)
    assert weights.layers == layers
    again = NetworkWeights.from_arrays(weights.arrays)
    network = MeshAutoencoder.from_weights(weights, *rings)
    assert not network.training
    assert sorted(network.state_dict()) == list(weights.arrays)
    for name, array in weights.arrays.items():
        assert array.dtype == np.float32
        np.testing.assert_array_equal(again.arrays[name], array)
        np.testing.assert_array_equal(network.state_dict()[name].numpy(), array)


def test_weights_do_not_follow_a_network_that_goes_on_learning():
    weights, rings = random_weights(tube(), (9,))
    network = MeshAutoencoder.from_weights(weights, *rings)
    before, taken = weights.C.copy(), network.weights
    with torch.no_grad():
        network.C += 1.0
    np.testing.assert_array_equal(taken.C, before)
    np.testing.assert_array_equal(weights.C, before)


def test_missing_weights_are_refused():
    arrays = dict(random_weights(tube(), (7, 5))[0].arrays)
    del arrays["convs.1.bias"]
    with pytest.raises(InputError, match=r"convs\.1\.bias: missing"):
        NetworkWeights.from_arrays(arrays)


def test_ring_mean_by_loop():
    mesh = awkward()
    indptr, rings = one_rings(mesh.faces, len(mesh.vertices))
    x = np.random.default_rng(0).normal(size=(len(mesh.vertices), 2))
    expected = np.zeros_like(x)
    for i in range(len(x)):
        ring = rings[indptr[i] : indptr[i + 1]]
        if len(ring):
            expected[i] = x[ring].mean(axis=0)
    np.testing.assert_allclose(ring_mean(indptr, rings) @ x, expected, atol=1e-12)


def test_pruning_ends_the_supports_and_keeps_the_rest():
    weights, _ = random_weights(tube(), (9, 5))
    C = weights.C.copy()
    C[:, :, 0] = 0.0
    weights = NetworkWeights(weights.convolutions, C)
    np.testing.assert_array_equal(weights.pruned(0.0).C, C)
    pruned = weights.pruned(0.5)
    np.testing.assert_array_equal(weights.C, C)
    strength = np.linalg.norm(C, axis=1)
    kept = strength >= 0.5 * strength.max(axis=0)
    assert 0 < kept[:, 1:].sum() < kept[:, 1:].size
    np.testing.assert_array_equal(pruned.C, np.where(kept[:, None], C, 0.0))
