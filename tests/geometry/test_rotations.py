"""Truths of rotations: exponential and logarithm, polar decomposition, Procrustes."""

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.spatial.transform import Rotation

from deformer import InputError
from deformer.geometry.rotations import (
    checked_rotations,
    interpolate_rotations,
    log_to_rotation,
    polar,
    procrustes,
    right_jacobian,
    rotation_to_log,
)
from tolerances import tolerance

finite = st.floats(-1, 1, allow_nan=False)
vectors = st.tuples(finite, finite, finite).map(np.array)
axes = vectors.filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: v / np.linalg.norm(v))
# Angles where formulas break: nothing, series and closed form, π from both sides.
angles = st.one_of(
    st.floats(0, np.pi),
    st.floats(-14, -1).map(lambda e: 10.0**e),
    st.floats(-14, -1).map(lambda e: np.pi - 10.0**e),
    st.sampled_from([0.0, 0.5 * np.pi, 0.99e-4, 1e-4, 1.01e-4]),
)
# Thousandths: zeros and equal entries are common, squares do not underflow.
matrices = st.lists(st.integers(-1000, 1000), min_size=9, max_size=9).map(
    lambda entries: np.array(entries).reshape(3, 3) / 1000
)


def cross(w):
    """[w]×, by its definition on the unit vectors."""
    return np.cross(w, np.eye(3)).T


def is_rotation(R):
    np.testing.assert_allclose(
        R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-12)


@given(axes, angles)
def test_exp_is_a_turn_about_its_axis(axis, angle):
    R = log_to_rotation(angle * axis)
    is_rotation(R)
    np.testing.assert_allclose(R @ axis, axis, **tolerance(np.float64))
    # Right-handed: a vector across the axis goes towards axis × vector.
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    expected = np.cos(angle) * across + np.sin(angle) * np.cross(axis, across)
    np.testing.assert_allclose(R @ across, expected, **tolerance(np.float64))


def test_quarter_turn_about_z_takes_x_to_y():
    R = log_to_rotation([0, 0, np.pi / 2])
    np.testing.assert_allclose(R @ [1, 0, 0], [0, 1, 0], atol=1e-15)


@given(axes, angles)
def test_log_undoes_exp_up_to_pi(axis, angle):
    r = rotation_to_log(log_to_rotation(angle * axis))
    # At π itself both directions of the axis are right.
    if np.pi - angle < 1e-9 and r @ axis < 0:
        r = -r
    np.testing.assert_allclose(r, angle * axis, rtol=1e-12, atol=3e-15 + 1e-12 * angle)


@given(axes, st.floats(-100, 100))
def test_exp_undoes_log_after_many_turns(axis, angle):
    R = log_to_rotation(angle * axis)
    r = rotation_to_log(R)
    assert np.linalg.norm(r) <= np.pi + 1e-12
    np.testing.assert_allclose(log_to_rotation(r), R, atol=1e-12)
    np.testing.assert_allclose(log_to_rotation((angle + 2 * np.pi) * axis), R, atol=1e-12)


@given(st.permutations([0, 1, 2]), st.tuples(*[st.sampled_from([-1.0, 1.0])] * 3))
def test_log_of_the_rotations_of_a_cube(order, signs):
    """Half and third turns are on the borders between the cases of the formula."""
    R = np.eye(3)[list(order)] * np.array(signs)[:, None]
    assume(np.linalg.det(R) > 0)
    r = rotation_to_log(R)
    np.testing.assert_allclose(log_to_rotation(r), R, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(r), np.arccos((np.trace(R) - 1) / 2), atol=1e-7)


@given(axes, angles, angles)
def test_turns_about_one_axis_add_up(axis, a, b):
    product = log_to_rotation(a * axis) @ log_to_rotation(b * axis)
    np.testing.assert_allclose(product, log_to_rotation((a + b) * axis), atol=1e-12)


@given(axes, angles, axes, angles)
def test_group_axioms(u, a, w, b):
    P, Q = log_to_rotation(a * u), log_to_rotation(b * w)
    is_rotation(P @ Q)
    np.testing.assert_allclose(P @ log_to_rotation(-a * u), np.eye(3), atol=1e-12)
    # Conjugation turns the axis: Q exp(r) Qᵀ = exp(Q r).
    np.testing.assert_allclose(Q @ P @ Q.T, log_to_rotation(Q @ (a * u)), atol=1e-12)


def test_leading_dimensions_are_kept():
    r = np.random.default_rng(0).uniform(-1, 1, (4, 5, 3))
    R = log_to_rotation(r)
    assert R.shape == (4, 5, 3, 3) and right_jacobian(r).shape == (4, 5, 3, 3)
    np.testing.assert_allclose(rotation_to_log(R), r, atol=1e-12)
    np.testing.assert_array_equal(R[2, 3], log_to_rotation(r[2, 3]))
    T = R + 0.1
    for whole, one in zip(polar(T), polar(T[1, 4]), strict=True):
        np.testing.assert_array_equal(whole[1, 4], one)


@given(axes, st.one_of(angles, st.floats(0, 40)), vectors)
def test_right_jacobian_is_the_derivative_of_exp(axis, angle, direction):
    r = angle * axis
    h = 1e-5
    change = (log_to_rotation(r + h * direction) - log_to_rotation(r - h * direction)) / (2 * h)
    expected = log_to_rotation(r) @ cross(right_jacobian(r) @ direction)
    np.testing.assert_allclose(change, expected, atol=1e-8)


@given(axes, st.one_of(angles, st.floats(0, 40)))
def test_left_and_right_jacobian_differ_by_the_rotation(axis, angle):
    """exp(r) J_right(r) = J_left(r) = J_right(−r) = J_right(r)ᵀ."""
    J = right_jacobian(angle * axis)
    np.testing.assert_allclose(right_jacobian(-angle * axis), J.T, atol=1e-14)
    np.testing.assert_allclose(log_to_rotation(angle * axis) @ J, J.T, atol=1e-11)
    np.testing.assert_allclose(J @ axis, axis, atol=1e-12)


@given(axes, st.one_of(angles.filter(lambda angle: angle <= 1), st.floats(5e-5, 2e-4)))
def test_exp_and_its_jacobian_by_their_power_series(axis, angle):
    """exp(r) = Σ [r]×ᵏ / k!, J = Σ (−[r]×)ᵏ / (k+1)!: both sides of where formulas change."""
    W, term = cross(angle * axis), np.eye(3)
    R, J = np.eye(3), np.eye(3)
    for k in range(1, 20):
        term = term @ W / k
        R += term
        J += (-1) ** k * term / (k + 1)
    np.testing.assert_allclose(log_to_rotation(angle * axis), R, atol=1e-14)
    np.testing.assert_allclose(right_jacobian(angle * axis), J, atol=2e-12)


def check_polar(T):
    """T = R S, R the rotation with the largest tr(Rᵀ T), as singular values give it."""
    size = np.abs(T).max() or 1.0
    R, S = polar(T)
    is_rotation(R)
    np.testing.assert_array_equal(S, S.T)
    np.testing.assert_allclose(R @ S / size, T / size, atol=1e-11)
    U, sigma, Vt = np.linalg.svd(T / size)
    sign = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    np.testing.assert_allclose(np.trace(S) / size, sigma @ [1, 1, sign], atol=1e-11)
    # The two smallest signed singular values make the maximiser unique where they do not cancel.
    if sigma[1] + sign * sigma[2] > 1e-2:
        np.testing.assert_allclose(R, U @ np.diag([1, 1, sign]) @ Vt, atol=1e-10)
    smallest = np.linalg.eigvalsh(S / size)[0]
    np.testing.assert_allclose(smallest, sign * sigma[2], atol=1e-11)


@given(matrices)
def test_polar_of_any_matrix(T):
    check_polar(T)


@pytest.mark.parametrize(
    "T",
    [
        [[0, -1, 0], [1, 0, 0], [0, 0, 0]],  # a flat ring after a quarter turn
        [[0, 0, 0], [1, 0, 0], [0, 0, 0]],  # a line after a quarter turn
        [[0, 1, 0], [0, 0, 1], [-1, 0, 0]],  # mirrored
        [[0, 3, 1], [2, 0, -1], [0, 0, 0]],
    ],
    ids=["flat", "line", "mirrored", "any"],
)
def test_polar_of_matrices_without_a_diagonal(T):
    check_polar(np.array(T, dtype=float))


@given(matrices, axes)
def test_polar_of_singular_matrices(T, axis):
    for singular in (T @ (np.eye(3) - np.outer(axis, axis)), np.outer(T[0], axis)):
        check_polar(singular)


@given(axes, angles, st.lists(st.floats(0.05, 3), min_size=3, max_size=3), axes, angles)
def test_polar_finds_the_factors(u, a, stretches, w, b):
    R, Q = log_to_rotation(a * u), log_to_rotation(b * w)
    S = Q @ np.diag(stretches) @ Q.T
    found_R, found_S = polar(R @ S)
    np.testing.assert_allclose(found_R, R, atol=1e-10)
    np.testing.assert_allclose(found_S, S, atol=1e-10)


@given(matrices)
def test_mirrored_matrix_keeps_a_proper_rotation(T):
    mirrored = T if np.linalg.det(T) < 0 else -T
    assume(np.linalg.det(mirrored) < -1e-6)
    check_polar(mirrored)
    assert np.linalg.eigvalsh(polar(mirrored)[1])[0] < 0


@pytest.mark.parametrize("exponent", [-100, -50, -6, 6, 50, 100])
@pytest.mark.parametrize("kind", ["regular", "mirrored", "flat", "line"])
def test_polar_does_not_depend_on_the_unit(exponent, kind):
    T = np.random.default_rng(3).normal(size=(3, 3))
    T *= np.sign(np.linalg.det(T))
    if kind == "mirrored":
        T = -T
    elif kind == "flat":
        T[:, 2] = T[:, 0] - T[:, 1]
    elif kind == "line":
        T = np.outer(T[0], T[1])
    scaled = T * 10.0**exponent
    check_polar(scaled)
    if kind != "line":  # a line leaves the turn about itself open
        np.testing.assert_allclose(polar(scaled)[0], polar(T)[0], atol=1e-9)


def test_polar_of_nothing_is_a_rotation():
    R, S = polar(np.zeros((3, 3)))
    is_rotation(R)
    np.testing.assert_array_equal(S, 0)


@given(axes, angles, vectors, st.integers(0, 1000), st.sampled_from([1e-6, 1.0, 1e6]))
def test_procrustes_recovers_a_rigid_motion(axis, angle, move, seed, unit):
    rng = np.random.default_rng(seed)
    source = unit * rng.normal(size=(7, 3))
    R = log_to_rotation(angle * axis)
    target = source @ R.T + unit * move
    for weights in (None, rng.uniform(0.1, 10, 7)):
        found, t = procrustes(source, target, weights)
        np.testing.assert_allclose(found, R, atol=1e-8)
        np.testing.assert_allclose(source @ found.T + t, target, atol=1e-9 * unit)


def test_procrustes_listens_to_the_weights():
    """Two copies of a shape, moved differently: the heavier copy decides."""
    rng = np.random.default_rng(5)
    source = rng.normal(size=(5, 3))
    R = log_to_rotation([0.3, -0.5, 1.0])
    target = np.concatenate([source @ R.T + [1, 2, 3], -source])
    doubled = np.concatenate([source, source])
    heavy = np.repeat([1.0, 1e-12], 5)
    found, t = procrustes(doubled, target, heavy)
    np.testing.assert_allclose(found, R, atol=1e-9)
    np.testing.assert_allclose(t, [1, 2, 3], atol=1e-9)
    # An integer weight is a repeated point.
    twice = np.array([2, 1, 1, 1, 1, 1, 1, 1, 1, 1.0])
    again = np.concatenate([doubled, doubled[:1]]), np.concatenate([target, target[:1]])
    for one, other in zip(procrustes(doubled, target, twice), procrustes(*again), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


@given(st.integers(0, 1000))
def test_procrustes_is_not_beaten_by_its_neighbours(seed):
    """No rotation near the answer is better, mirrored and noisy targets included."""
    rng = np.random.default_rng(seed)
    source, target = rng.normal(size=(2, 6, 3))
    if seed % 2:
        target = source * [1, 1, -1] + 0.1 * target
    R, _ = procrustes(source, target)
    is_rotation(R)

    def misfit(R):
        moved = source @ R.T
        return ((moved - moved.mean(0) - target + target.mean(0)) ** 2).sum()

    for _ in range(10):
        other = R @ log_to_rotation(rng.normal(size=3) * rng.choice([1e-3, 0.1, 1]))
        assert misfit(R) <= misfit(other) + 1e-12


@pytest.mark.parametrize(
    "source",
    [
        [[1.0, 2, 3]],
        [[1.0, 2, 3], [1, 2, 3]],
        [[0.0, 0, 0], [1, 0, 0], [3, 0, 0]],
        [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]],
        [[0.0, 0, 0], [1e-200, 0, 0], [0, 1e-200, 0]],
    ],
    ids=["point", "same point", "line", "plane", "vanishing"],
)
@pytest.mark.filterwarnings("error")
def test_procrustes_of_degenerate_points_is_a_rigid_motion(source):
    source = np.array(source)
    R0 = log_to_rotation([2.0, -1.0, 0.5])
    target = source @ R0.T + [5, 6, 7]
    R, t = procrustes(source, target)
    is_rotation(R)
    np.testing.assert_allclose(source @ R.T + t, target, atol=1e-12)


def test_given_rotations_are_quaternions_or_matrices():
    """Both, and their negatives and rounded ones, are the same rotation; exact ones stay."""
    R = log_to_rotation(np.random.default_rng(0).normal(size=(2, 3, 3)))
    q = np.roll(Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat(), 1, axis=1).reshape(2, 3, 4)
    assert np.array_equal(checked_rotations(R, "R", (2, 3)), R)
    for same in (q, -q, q.tolist(), 1.005 * q, R.tolist()):
        np.testing.assert_allclose(checked_rotations(same, "R", (2, 3)), R, atol=1e-14)
    is_rotation(checked_rotations(R.round(2), "R", (2, 3)))
    np.testing.assert_allclose(checked_rotations(q[0, 0], "R", ()), R[0, 0], atol=1e-14)


def test_no_rotation_is_nan():
    found = checked_rotations([None, [1, 0, 0, 0], np.eye(3)], "R", (3,))
    assert np.isnan(found[0]).all() and np.array_equal(found[1:], [np.eye(3)] * 2)
    assert np.isnan(checked_rotations(np.full((2, 4), np.nan), "R", (2,))).all()
    assert np.isnan(checked_rotations(None, "R", ())).all()
    assert checked_rotations([], "R", (0,)).shape == (0, 3, 3)


@pytest.mark.parametrize(
    ("value", "part"),
    [
        ([1, 0, 0], "(4,) or (3, 3)"),
        ([0, 0, 0, 0], "length 0"),
        ([1.1, 0, 0, 0], "length 1.1"),
        ([np.nan, 0, 0, 1], "nan"),
        ([np.inf, 0, 0, 1], "inf"),
        (np.diag([1, 1, -1.0]), "reflection"),
        (np.full((3, 3), 1e308), "1e+308"),
        (1.1 * np.eye(3), "unit frame"),
        (np.full((3, 3), 3**-0.5), "unit frame"),
        ("abc", "numbers"),
        ([True, False, False, False], "numbers"),
        ({}, "numbers"),
    ],
)
def test_what_is_no_rotation(value, part):
    for values, shape in ((value, ()), ([None, value], (2,)), ([[value], [None]], (2, 1))):
        with pytest.raises(InputError) as caught:
            checked_rotations(values, "turns", shape)
        text = str(caught.value)
        assert part in text and text.startswith("turns") and "\n" not in text


def test_procrustes_of_many_sets_is_that_of_each():
    rng = np.random.default_rng(4)
    a, b = rng.normal(size=(5, 1, 7, 3)), rng.normal(size=(3, 7, 3))
    b[1] = 0.0  # one point: any rotation is best, and the identity is taken
    R, t = procrustes(a, b)
    assert R.shape == (5, 3, 3, 3) and t.shape == (5, 3, 3)
    for n in range(5):
        for m in range(3):
            each = procrustes(a[n, 0], b[m])
            np.testing.assert_allclose(R[n, m], each[0], atol=1e-12)
            np.testing.assert_allclose(t[n, m], each[1], atol=1e-12)
    np.testing.assert_allclose(R[:, 1], np.tile(np.eye(3), (5, 1, 1)), atol=1e-12)


@given(axes, axes, st.floats(0, 3.0), st.lists(st.floats(-0.5, 1.5), max_size=4))
def test_interpolated_rotations_turn_at_constant_speed_about_one_axis(a, b, angle, shares):
    """Against the definition: the start, turned by a share of the angle about the axis."""
    start = log_to_rotation(1.3 * b)
    end = start @ log_to_rotation(angle * a)
    found = interpolate_rotations(start, end, shares)
    assert found.shape == (len(shares), 3, 3)
    expected = start @ log_to_rotation(np.array(shares)[:, None] * angle * a)
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_interpolated_rotations_are_checked():
    turn = np.eye(3)
    with pytest.raises(InputError, match="start: expected a rotation, got none"):
        interpolate_rotations(np.full((3, 3), np.nan), turn, 0.5)
    with pytest.raises(InputError, match="end"):
        interpolate_rotations(turn, 2 * turn, 0.5)
    with pytest.raises(InputError, match="share"):
        interpolate_rotations(turn, turn, np.nan)
