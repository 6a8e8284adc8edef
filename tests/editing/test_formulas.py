"""T = exp(r) S, its derivative and b(T) of kernels and torch are those of double precision."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from angles import NEAR, features_near
from deformer.acap.gradients import features_to_gradients
from deformer.acap.jacobians import gradient_tangents
from deformer.acap.poisson import PoissonSystem
from deformer.editing import batch_torch, kernels
from deformer.editing.handle_kernels import BlockDecoder, BlockHandlePositions
from shapes import MESHES
from tolerances import tolerance

DTYPES = pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)


def derivatives(q):
    """∂T/∂q (n, 3, 3, 9) in double precision."""
    units = np.broadcast_to(np.eye(9)[:, None], (9, *q.shape))
    return np.moveaxis(gradient_tangents(q, units), 0, -1)


def in_blocks(q):
    """Features (n, 9) as blocks (·, 144); the last one is filled up with its last vertex."""
    padded = np.concatenate([q, np.repeat(q[-1:], -len(q) % kernels.BLOCK, axis=0)])
    blocks = padded.reshape(-1, kernels.BLOCK, 9).transpose(0, 2, 1)
    return np.ascontiguousarray(blocks.reshape(-1, kernels.MATRICES), dtype=np.float32)


@NEAR
def test_gradients_by_block(near):
    q = features_near(near).astype(np.float32)
    T = np.empty(kernels.MATRICES, dtype=np.float32)
    found = []
    for block in in_blocks(q):
        kernels.gradients(block, T)
        found.append(T.reshape(9, kernels.BLOCK).T.copy())
    found = np.concatenate(found)[: len(q)].reshape(-1, 3, 3)
    np.testing.assert_allclose(found, features_to_gradients(q), **tolerance(np.float32))


@NEAR
def test_derivative_by_block(near):
    """Of a decoder that gives q at the code 0, and its components' changes one entry each."""
    expected = derivatives(features_near(near).astype(np.float32))
    for q, derivative in zip(features_near(near).astype(np.float32), expected, strict=True):
        decoder = SimpleNamespace(
            matrix=np.eye(9, dtype=np.float32)[None],
            base=np.zeros(9),
            gain=np.ones(9),
            offset=q.astype(np.float64),
            components=9,
            vertex_count=1,
        )
        # Handle b is column b of T.
        found = BlockHandlePositions(BlockDecoder(decoder), np.eye(3)[:, None]).at(np.zeros(9))
        found = found.derivative().transpose(1, 0, 2)
        np.testing.assert_allclose(found, derivative, **tolerance(np.float32))


@NEAR
@DTYPES
def test_gradients_and_derivative_in_torch(near, dtype):
    q = torch.as_tensor(features_near(near), dtype=dtype)
    exact = q.double().numpy()
    # Series replace the closed forms below 0.01 rad: r⁴/120 is left out.
    bound = tolerance(dtype, factor=1e3 if dtype == torch.float64 else 1)
    np.testing.assert_allclose(batch_torch.gradients(q), features_to_gradients(exact), **bound)
    np.testing.assert_allclose(batch_torch.gradient_derivatives(q), derivatives(exact), **bound)


@pytest.mark.parametrize("name", MESHES)
def test_right_hand_sides(name):
    system = PoissonSystem(MESHES[name])
    v = system.reference.vertices
    T = np.random.default_rng(0).normal(size=(len(v), 3, 3))
    expected = system.rhs(T)
    size = np.abs(expected).max()
    single = np.empty(3 * len(v), dtype=np.float32)
    halves = (0.5 * system.c).astype(np.float32)
    flat = (array.astype(np.float32).ravel() for array in (v - system.centroid, T))
    rings = system.rings.astype(np.int32)
    kernels.rhs(0, len(v), system.indptr, rings, halves, *flat, single)
    np.testing.assert_allclose(
        single.reshape(-1, 3) / size, expected / size, **tolerance(np.float32)
    )
    rows = np.repeat(np.arange(len(v)), np.diff(system.indptr))
    edges = torch.as_tensor(0.5 * system.c[:, None] * (v[rows] - v[system.rings]))
    ends = torch.as_tensor(rows), torch.as_tensor(system.rings)
    for dtype in (torch.float32, torch.float64):
        given = torch.as_tensor(T, dtype=dtype)[None]
        found = batch_torch.rhs(given, *ends, edges.to(dtype))[0]
        np.testing.assert_allclose(found / size, expected / size, **tolerance(dtype))
