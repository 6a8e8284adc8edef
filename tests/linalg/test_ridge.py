"""Ridge regression: the closed form, and residuals of rows that are really left out."""

import numpy as np
import pytest

from deformer.linalg.ridge import ridge_regressions

RIDGES = (1e-6, 1e-2, 1.0, np.inf)


def solved(x, y, weight):
    return np.linalg.solve(x.T @ x + weight * np.eye(x.shape[1]), x.T @ y)


@pytest.mark.parametrize(("n", "K"), [(12, 4), (5, 9)])
def test_regressions_and_what_rows_left_out_are_off(n, K):
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(n, K)), rng.normal(size=(n, 3))
    found = list(ridge_regressions(x, y, RIDGES, centred=False, least=1e-12))
    for ridge, (B, left_out) in zip(RIDGES[:-1], found, strict=False):
        weight = ridge * np.linalg.norm(x, 2) ** 2
        np.testing.assert_allclose(B, solved(x, y, weight), rtol=1e-6, atol=1e-8)
        for row in range(n):
            kept = np.arange(n) != row
            expected = y[row] - x[row] @ solved(x[kept], y[kept], weight)
            np.testing.assert_allclose(left_out[row], expected, rtol=1e-5, atol=1e-7)
    B, left_out = found[-1]
    np.testing.assert_array_equal(B, 0.0)
    np.testing.assert_allclose(left_out, y)


def test_of_centred_rows_the_mean_is_left_out_too():
    """With an infinite ridge a row is predicted by the mean of the others."""
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(7, 2)), rng.normal(size=(7, 3))
    centred = x - x.mean(axis=0), y - y.mean(axis=0)
    ((_, left_out),) = ridge_regressions(*centred, (np.inf,), centred=True, least=1e-12)
    others = [np.delete(y, row, axis=0).mean(axis=0) for row in range(7)]
    np.testing.assert_allclose(left_out, y - others)
