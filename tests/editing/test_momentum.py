"""Momentum of fixed-point iterations."""

import numpy as np
import pytest

from deformer.editing.momentum import Momentum


def rounds_needed(eigenvalues: np.ndarray, momentum: bool, tolerance: float = 1e-6) -> int:
    """Rounds of the linear iteration x ← λ x, from ones, until all numbers are that small."""
    x, moves = np.ones_like(eigenvalues), Momentum()
    for n in range(1, 10_000):
        x = eigenvalues * (moves.moved_on(x) if momentum else x)
        if np.abs(x).max() < tolerance:
            return n
    raise AssertionError("no convergence")


@pytest.mark.parametrize("slowest", [0.9, 0.97, 0.99])
def test_slow_iterations_take_a_third_of_the_rounds_or_less(slowest: float):
    eigenvalues = np.array([0.0, 0.3, slowest])
    without, with_it = (rounds_needed(eigenvalues, m) for m in (False, True))
    assert with_it < without / 2
    if slowest > 0.95:
        assert with_it < without / 3


@pytest.mark.parametrize("least", [-0.1, -0.3])
def test_iterations_that_alternate_converge(least: float):
    """Down to −1/3, as `Momentum` says."""
    assert rounds_needed(np.array([least, 0.9]), momentum=True) < 200


def test_turning_back_starts_the_momentum_anew():
    """Without restarts a slow direction swings around its limit for long."""
    moves, x, plain, last, t = Momentum(), 1.0, 1.0, 1.0, 1.0
    for n in range(60):
        x = 0.9 * float(moves.moved_on(np.array([x]))[0])
        start = plain
        if n:
            following = (1 + np.sqrt(1 + 4 * t * t)) / 2
            start += (t - 1) / following * (plain - last)
            t = following
        last, plain = plain, 0.9 * start
    assert abs(x) < 0.1 * abs(plain)


def test_the_first_round_starts_where_the_iteration_is():
    x = np.array([1.0, -2.0])
    np.testing.assert_array_equal(Momentum().moved_on(x), x)


def test_results_are_copied_and_keep_their_type():
    moves, x = Momentum(), np.ones((3, 3), dtype=np.float32)
    assert moves.moved_on(x) is not x
    x *= 2
    assert moves.moved_on(x).dtype == np.float32
