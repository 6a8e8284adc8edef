"""Truths of the small constrained least squares, and of weights fitted to known rigs."""

import itertools

import numpy as np
import pytest

from deformer.rigging.transforms import PULL, moments, skinned
from deformer.rigging.weights import (
    SMALLEST_WEIGHT,
    fitted_weights,
    point_errors,
    simplex_least_squares,
)
from shapes import random_rotation, tube


def by_enumeration(G, g):
    """The minimum over the simplex: the best feasible stationary point of any set of entries."""
    m, best, found = len(g), np.inf, np.zeros(len(g))
    for n in range(1, m + 1):
        for chosen in itertools.combinations(range(m), n):
            rows = list(chosen)
            K = np.zeros((n + 1, n + 1))
            K[:n, :n], K[n, :n], K[:n, n] = G[np.ix_(rows, rows)], 1.0, 1.0
            w = np.zeros(m)
            w[rows] = np.linalg.solve(K, [*g[rows], 1.0])[:n]
            value = 0.5 * w @ G @ w - g @ w
            if w.min() >= 0 and value < best:
                best, found = value, w
    return found


@pytest.mark.parametrize("seed", range(40))
def test_the_active_set_finds_the_minimum_over_the_simplex(seed):
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 7))
    A = rng.normal(size=(m + 2, m))
    G, g = A.T @ A + 1e-6 * np.eye(m), 3.0 * rng.normal(size=m)
    w = np.empty(m)
    simplex_least_squares(G, g, m, w)
    np.testing.assert_allclose(w, by_enumeration(G, g), atol=1e-8)


def test_equal_bones_share_and_a_single_one_has_all():
    w = np.empty(3)
    simplex_least_squares(np.eye(3), np.zeros(3), 3, w)
    np.testing.assert_allclose(w, 1 / 3)
    simplex_least_squares(np.ones((1, 1)), np.array([-7.0]), 1, w)
    assert w[0] == 1.0


def known(seed=0, shapes=9):
    """A tube, transforms of three bones, weights of two bones a vertex, and the skinned shapes."""
    rng = np.random.default_rng(seed)
    rest = tube().vertices
    T = np.empty((shapes, 3, 3, 4))
    for n, b in np.ndindex(shapes, 3):
        T[n, b] = np.column_stack([random_rotation(rng, 0.7), 0.3 * rng.normal(size=3)])
    x = rest[:, 0] / rest[:, 0].max()
    w = np.column_stack([np.clip(1 - 2 * x, 0, 1), 1 - abs(2 * x - 1), np.clip(2 * x - 1, 0, 1)])
    return rest, T, w, skinned(w, rest, T).transpose(1, 0, 2).copy()


def fitted(rest, shapes, T, near=None, influences=4, smooth=None, smoothness=1e-12):
    near = np.ones((len(rest), T.shape[1]), dtype=bool) if near is None else near
    smooth = np.zeros(near.shape) if smooth is None else smooth
    return fitted_weights(rest, shapes, T, near, influences, smooth, smoothness)


def test_weights_of_a_known_rig_come_back(monkeypatch):
    rest, T, w, shapes = known()
    monkeypatch.setattr("deformer.rigging.weights.PULL", 0.0)
    found = fitted(rest, shapes, T)
    np.testing.assert_allclose(found, np.where(w < SMALLEST_WEIGHT, 0, w), atol=1e-6)


def test_rows_are_shares_of_few_bones_that_may_move_the_vertex():
    rest, T, _, shapes = known()
    rng = np.random.default_rng(1)
    near = rng.random((len(rest), 3)) < 0.7
    near[~near.any(axis=1), 0] = True
    for influences in (1, 2, 3):
        # So smooth that all three bones would move a vertex.
        w = fitted(rest, shapes, T, near, influences, np.full(near.shape, 1 / 3), 100.0)
        np.testing.assert_allclose(w.sum(axis=1), 1.0, atol=1e-12)
        assert (w >= 0).all() and not w[~near].any()
        assert (w > 0).sum(axis=1).max() == influences
        assert w[w > 0].min() >= SMALLEST_WEIGHT


def test_one_bone_a_vertex_is_the_one_with_the_least_error():
    rest, T, _, shapes = known()
    errors = point_errors(rest, shapes, T)
    by_hand = [
        [((T[:, b, :, :3] @ v + T[:, b, :, 3] - p) ** 2).sum() for b in range(3)]
        for v, p in zip(rest, shapes, strict=True)
    ]
    np.testing.assert_allclose(errors, by_hand, atol=1e-9)
    whole = np.eye(3)[errors.argmin(axis=1)]
    exact = skinned(whole, rest, T).transpose(1, 0, 2).copy()
    np.testing.assert_allclose(fitted(rest, exact, T, influences=1), whole)


def test_smoothness_draws_weights_to_those_around():
    rest, T, w, shapes = known()
    goal = np.full(w.shape, 1 / 3)
    loose, firm = (fitted(rest, shapes, T, smooth=goal, smoothness=s) for s in (1e-6, 1e9))
    np.testing.assert_allclose(firm, goal, atol=1e-6)
    assert abs(loose - goal).max() > 0.5


def test_the_minimum_holds_against_every_exchange_between_two_bones():
    """The energy with its pull, written out by hand, rises wherever a little weight is moved."""
    rest, T, _, shapes = known(shapes=4)
    shapes = shapes + 0.05 * np.random.default_rng(2).normal(size=shapes.shape)
    goal = np.full((len(rest), 3), 1 / 3)
    w = fitted(rest, shapes, T, smooth=goal, smoothness=0.01)
    alone = point_errors(rest, shapes, T)

    def energy(w):
        off = ((skinned(w, rest, T).transpose(1, 0, 2) - shapes) ** 2).sum(axis=(1, 2))
        return off + PULL * (w * alone).sum(axis=1) + 0.01 * ((w - goal) ** 2).sum(axis=1)

    base = energy(w)
    for a, b in itertools.permutations(range(3), 2):
        moved = w.copy()
        step = np.minimum(1e-3, w[:, a])
        moved[:, a] -= step
        moved[:, b] += step
        dropped = (w > 0).sum(axis=1) < 3  # a weight below the smallest has been left out
        assert (energy(moved) >= base - 1e-9)[~dropped].all()
    assert (~dropped).sum() > 20


def test_moments_are_sums_over_vertices():
    rest, _, w, shapes = known()
    h = np.column_stack([rest, np.ones(len(rest))])
    found = moments(w, rest, shapes)
    np.testing.assert_allclose(found.first, np.einsum("ib,ix,iy->bxy", w, h, h), atol=1e-9)
    second = np.einsum("ib,ic,ix,iy->bcxy", w, w, h, h)
    np.testing.assert_allclose(found.second, second, atol=1e-9)
    np.testing.assert_allclose(found.cross, np.einsum("ib,inx,iy->nbxy", w, shapes, h), atol=1e-9)
