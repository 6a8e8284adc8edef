"""The kernel of ADMM against the formulas on whole arrays."""

import numpy as np
import pytest

from deformer.training.admm import admm, sums_of


def plain(gram, against, penalty, Z, U, strength, iterations):
    """C = (G + ρ)⁻¹ (B + ρ (Z − U)), Z = prox(C + U), U = U + C − Z."""
    K, m = penalty.shape
    inverse = np.linalg.inv(gram + strength * np.eye(K))
    for _ in range(iterations):
        C = inverse @ (against + strength * (Z - U)) + U
        sites = C.reshape(K, m, -1)
        length = np.linalg.norm(sites, axis=2)
        kept = np.maximum(0.0, 1.0 - penalty / (strength * np.maximum(length, 1e-300)))
        Z = (sites * kept[..., None]).reshape(K, -1)
        U = C - Z
    return Z, U


def atol(precision, numbers):
    return (1e-5 if precision == np.float32 else 1e-13) * np.abs(numbers).max()


@pytest.mark.parametrize("precision", [np.float32, np.float64])
@pytest.mark.parametrize(
    ("components", "sites", "dimensions"), [(1, 1, 1), (6, 16, 9), (7, 37, 3), (8, 300, 9)]
)
def test_the_kernel_is_the_formula(components, sites, dimensions, precision):
    rng = np.random.default_rng(components)
    K, m, D = components, sites, dimensions
    W = rng.normal(size=(10, K)).astype(precision)
    X = rng.normal(size=(10, m * D)).astype(precision)
    penalty = rng.uniform(0, 20, (K, m)).astype(precision)
    penalty[:, ::5] = 0.0
    Z, U = (rng.normal(size=(2, K, m * D))).astype(precision)
    before = Z.copy(), U.copy()
    options = {"strength": 10.0, "iterations": 7}
    found = admm(X, W, penalty, Z, U, **options)
    np.testing.assert_array_equal(Z, before[0])
    np.testing.assert_array_equal(U, before[1])
    wide = [a.astype(np.float64) for a in (W.T @ W, W.T @ X, penalty, Z, U)]
    expected = plain(*wide, **options)
    for a, b in zip(found[:2], expected, strict=True):
        assert a.dtype == precision
        np.testing.assert_allclose(a, b, atol=2e-5 if precision == np.float32 else 1e-12)
    sums, C = found[2], found[0].astype(np.float64)
    np.testing.assert_allclose(sums.against, X @ C.T, atol=atol(precision, sums.against))
    np.testing.assert_allclose(sums.gram, C @ C.T, atol=atol(precision, sums.gram))
    np.testing.assert_allclose(
        sums.lengths, np.linalg.norm(C.reshape(K, m, D), axis=2), atol=atol(precision, C)
    )
    for a, b in zip(sums, sums_of(X, found[0], m), strict=True):
        np.testing.assert_array_equal(a, b)
    if m == 300:
        lengths = np.linalg.norm(found[0].reshape(K, m, D), axis=2)
        assert 0.05 < (lengths == 0).mean() < 0.95  # exactly 0 where it is shrunk away
        assert lengths[:, ::5].all()


def test_a_component_of_nothing_stays_nothing():
    nothing = np.zeros((2, 6), dtype=np.float32)
    penalty = np.array([[0.0, 1.0], [0.0, 1.0]], dtype=np.float32)
    W = np.eye(2, dtype=np.float32)
    Z, U, _ = admm(nothing, W, penalty, nothing, nothing, strength=10.0, iterations=3)
    assert not Z.any() and not U.any()


def test_parts_of_columns_may_be_given():
    """A tile's columns of larger arrays."""
    rng = np.random.default_rng(0)
    W, X = rng.normal(size=(5, 3)), rng.normal(size=(5, 40))
    penalty, Z, U = rng.uniform(0, 2, (3, 20)), rng.normal(size=(3, 40)), rng.normal(size=(3, 40))
    whole = admm(X, W, penalty, Z, U, strength=2.0, iterations=4)[:2]
    part, sites = slice(10, 30), slice(5, 15)
    some = admm(
        X[:, part],
        W,
        penalty[:, sites],
        Z[:, part],
        U[:, part],
        strength=2.0,
        iterations=4,
    )[:2]
    for a, b in zip(some, whole, strict=True):
        np.testing.assert_allclose(a, b[:, part], atol=1e-14)
