"""Truths of the Laplacian and of b(T) = Σ_j ½ c_ij (T_i + T_j)(v_i − v_j)."""

import numpy as np
import pytest

from deformer.geometry.laplacian import (
    cotan_weights,
    graph_laplacian,
    rhs_,
    rhs_adjoint_,
    rhs_matrix,
)
from shapes import MESHES, random_rotation

NAMES = pytest.mark.parametrize("name", MESHES)


def operators(name):
    mesh = MESHES[name]
    weights = cotan_weights(mesh)
    arrays = weights.indptr.astype(np.int64), weights.indices.astype(np.int64), weights.data
    return mesh.vertices, weights, (*arrays, mesh.vertices)


def b_of(T, mesh):
    b = np.empty((len(T), 3))
    rhs_(0, len(T), *mesh, T, b)
    return b


@NAMES
def test_laplacian_is_the_gradient_of_the_edge_energy(name):
    """xᵀ L x = ½ Σ_ij c_ij (x_i − x_j)²; constants cost nothing."""
    v, weights, _ = operators(name)
    L = graph_laplacian(weights)
    rows = np.repeat(np.arange(len(v)), np.diff(weights.indptr))
    x = np.random.default_rng(0).normal(size=len(v))
    energy = 0.5 * (weights.data * (x[rows] - x[weights.indices]) ** 2).sum()
    np.testing.assert_allclose(x @ (L @ x), energy, rtol=1e-12)
    np.testing.assert_allclose(L @ np.ones(len(v)), 0, atol=1e-12 * abs(L).max())


@NAMES
def test_right_hand_side_is_the_sum_over_edges(name):
    v, weights, mesh = operators(name)
    T = np.random.default_rng(1).normal(size=(len(v), 3, 3))
    rows = np.repeat(np.arange(len(v)), np.diff(weights.indptr))
    mean = 0.5 * (T[rows] + T[weights.indices])
    edges = np.einsum("eab,eb->ea", mean, v[rows] - v[weights.indices])
    expected = np.zeros_like(v)
    np.add.at(expected, rows, weights.data[:, None] * edges)
    np.testing.assert_allclose(b_of(T, mesh), expected, atol=1e-12 * np.abs(expected).max())


@NAMES
def test_one_rotation_everywhere_turns_the_reference(name):
    v, weights, mesh = operators(name)
    R = random_rotation(np.random.default_rng(2), 2.0)
    expected = graph_laplacian(weights) @ (v @ R.T)
    found = b_of(np.tile(R, (len(v), 1, 1)), mesh)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


@NAMES
def test_matrix_and_adjoint_are_those_of_the_loop(name):
    v, weights, mesh = operators(name)
    rng = np.random.default_rng(3)
    T, green = rng.normal(size=(len(v), 3, 3)), rng.normal(size=len(v))
    b = b_of(T, mesh)
    columns = T.transpose(0, 2, 1).reshape(-1, 3)
    np.testing.assert_allclose(rhs_matrix(weights, v) @ columns, b, atol=1e-12 * np.abs(b).max())
    a = np.empty_like(v)
    rhs_adjoint_(0, len(v), *mesh, green, a)
    np.testing.assert_allclose(np.einsum("iab,ib->a", T, a), green @ b, rtol=1e-10, atol=1e-10)
