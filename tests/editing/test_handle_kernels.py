"""Truths of handle positions by blocks: those of features, at any rotation and sparsity."""

from types import SimpleNamespace

import numpy as np
import pytest

from deformer.acap.jacobians import position_sensitivities, positions_from_features
from deformer.editing.handle_kernels import BlockDecoder, BlockHandlePositions

K = 7


def decoder(n, largest, density=0.4, seed=0):
    """q = gain tanh(M z + base) + offset, rotation vectors up to `largest`."""
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(n, 9, K)) * (rng.random((n, 1, K)) < density)
    gain = np.concatenate([np.full(3, largest / np.sqrt(3)), rng.uniform(0.5, 2, 6)])
    return SimpleNamespace(
        matrix=matrix.astype(np.float32),
        base=rng.normal(size=9),
        gain=gain,
        offset=np.concatenate([np.zeros(3), rng.normal(size=6)]),
        components=K,
        vertex_count=n,
    )


def features(d, z):
    x = np.tanh(d.matrix.astype(np.float64) @ z + d.base)
    return d.gain * x + d.offset, (1 - x**2) * d.gain


@pytest.mark.parametrize("handles", [1, 3, 17])
@pytest.mark.parametrize("n", [1, 16, 53])
@pytest.mark.parametrize("largest", [1e-4, 0.5, 1.0, np.pi, 25.0])
def test_positions_and_derivative_are_those_of_the_features(n, largest, handles):
    d = decoder(n, largest)
    rng = np.random.default_rng(1)
    coefficients, z = rng.normal(size=(handles, n, 3)), rng.normal(size=K)
    here = BlockHandlePositions(BlockDecoder(d), coefficients).at(z)
    q, slope = features(d, z)
    scale = n * max(1.0, largest)
    np.testing.assert_allclose(
        here.positions, positions_from_features(q, coefficients), atol=3e-6 * scale
    )
    chain = d.matrix * slope[:, :, None]
    expected = np.einsum("haif,ifk->hak", position_sensitivities(q, coefficients), chain)
    np.testing.assert_allclose(here.derivative(), expected, atol=1e-5 * scale)


def test_components_that_reach_nothing_and_no_handles():
    d = decoder(20, 1.0, density=0.0)
    coefficients = np.random.default_rng(2).normal(size=(2, 20, 3))
    packed = BlockDecoder(d)
    assert not BlockHandlePositions(packed, coefficients).at(np.ones(K)).derivative().any()
    nothing = BlockHandlePositions(packed, coefficients[:0]).at(np.ones(K))
    assert nothing.positions.shape == (0, 3) and nothing.derivative().shape == (0, 3, K)
