"""The damped descent: least squares are solved, the energy never rises, it ends as it says."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.testing import assert_allclose

from deformer.linalg.levenberg_marquardt import Damping, damped_step, descend


@dataclass
class Squares:
    """‖residual(x)‖², with every energy and every damping noted."""

    residual: object
    jacobian: object
    x: np.ndarray
    energies: list[float] = field(default_factory=list)
    asked: list[float] = field(default_factory=list)

    def __post_init__(self):
        self.energy = float((self.residual(self.x) ** 2).sum())

    def step(self, damping):
        self.energies.append(self.energy)
        self.asked.append(damping)
        J = self.jacobian(self.x)
        return damped_step(J.T @ J, J.T @ self.residual(self.x), damping)

    def moved(self, step):
        return Squares(self.residual, self.jacobian, self.x + step, self.energies, self.asked)


def rosenbrock(x, least=0.0):
    """10 (x₁ − x₀²), 1 − x₀: a curved valley with its bottom, of energy least², at (1, 1)."""

    def residual(x):
        return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0], least])

    def jacobian(x):
        return np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0], [0.0, 0.0]])

    return Squares(residual, jacobian, np.array(x))


def linear(seed=0):
    """Ax − b with 8 rows and 3 unknowns, and its least squares solution."""
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(8, 3)), rng.normal(size=8)
    squares = Squares(lambda x: A @ x - b, lambda x: A, np.zeros(3))
    return squares, np.linalg.lstsq(A, b, rcond=None)[0]


@dataclass
class Valley:
    """x² with steps `stride` times as long as they should be; damping shortens them."""

    x: float
    stride: float
    asked: list[float] = field(default_factory=list)

    @property
    def energy(self) -> float:
        return self.x**2 if abs(self.x) < 10 else float("nan")

    def step(self, damping):
        self.asked.append(damping)
        return np.array(-self.x * self.stride / (1.0 + damping))

    def moved(self, step):
        return Valley(self.x + float(step), self.stride, self.asked)


def test_a_quadratic_is_solved_in_one_step_without_damping():
    start, solution = linear()
    found = descend(start, steps=1, relative_gain=0.0, damping=Damping(initial=0.0))
    assert found.steps == 1
    assert_allclose(found.point.x, solution, atol=1e-12)


def test_a_damped_step_is_that_of_the_formula():
    H, gradient = np.array([[4.0, 1.0], [1.0, 3.0]]), np.array([1.0, 2.0])
    step = damped_step(H, gradient, 0.5)
    assert_allclose(np.array([[6.0, 1.0], [1.0, 4.5]]) @ step, -gradient)


@pytest.mark.parametrize("start", [(-1.2, 1.0), (3.0, -5.0), (0.0, 0.0)])
def test_the_valley_of_rosenbrock_is_followed_to_its_end(start):
    begun = rosenbrock(start)
    found = descend(begun, steps=200, relative_gain=0.0, absolute_gain=1e-24)
    assert_allclose(found.point.x, 1.0, atol=1e-8)
    assert found.steps < 200
    assert (np.diff(begun.energies) <= 0).all()


def test_steps_are_counted_and_limited():
    for limit in (0, 1, 4):
        begun = rosenbrock((-1.2, 1.0))
        found = descend(begun, steps=limit, relative_gain=0.0)
        assert found.steps == limit
        assert len(set(begun.energies)) == limit
    energies = [
        descend(rosenbrock((-1.2, 1.0)), steps=limit, relative_gain=0.0).point.energy
        for limit in range(6)
    ]
    assert (np.diff(energies) < 0).all()


@pytest.mark.parametrize("gain", [0.5, 1e-3])
def test_a_step_of_little_gain_ends_it(gain):
    begun = rosenbrock((-1.2, 1.0), least=0.5)
    found = descend(begun, steps=100, relative_gain=gain)
    energies = [*dict.fromkeys(begun.energies), found.point.energy]
    gains = -np.diff(energies) / np.array(energies[1:])
    assert found.steps == len(gains) < 100
    assert gains[-1] <= gain and (gains[:-1] > gain).all()


def test_an_absolute_gain_ends_it_near_zero():
    near = descend(rosenbrock((1.0, 1.0 + 1e-5)), steps=50, relative_gain=0.0, absolute_gain=1e-6)
    assert near.steps == 1


def test_the_damping_follows_its_schedule():
    damping = Damping(initial=1.0, up=5.0, down=4.0, floor=0.1, ceiling=1e6)
    good = Valley(2.0, 1.0)
    descend(good, steps=4, relative_gain=0.0, damping=damping)
    assert good.asked == [1.0, 0.25, 0.1, 0.1]
    long = Valley(2.0, 20.0)  # 1 + damping must exceed 10
    descend(long, steps=1, relative_gain=0.0, damping=damping)
    assert long.asked == [1.0, 5.0, 25.0]


@pytest.mark.parametrize(
    ("share", "asked"), [(0.1, [1.0, 2.0]), (0.4, [1.0, 1.0]), (0.9, [1.0, 0.25])]
)
def test_the_damping_follows_what_a_step_gains_of_what_was_predicted(share, asked):
    begun = Valley(2.0, 1.0)

    def predicted(point, step):
        return (point.energy - point.moved(step).energy) / share

    damping = Damping(initial=1.0, up=5.0, down=4.0)
    descend(begun, steps=2, relative_gain=0.0, damping=damping, predicted_gain=predicted)
    assert begun.asked == asked


def test_steps_that_are_too_long_are_damped_until_they_are_not():
    """Residuals that are large and curved: each step beyond the bottom was followed by a retry."""

    def residual(x):
        return np.array([10.0 + 0.3 * x[0] ** 2, x[0]])

    def jacobian(x):
        return np.array([[0.6 * x[0]], [1.0]])

    def predicted(point, step):
        return float(-(jacobian(point.x).T @ residual(point.x)) @ step)

    tried = []
    for given in (None, predicted):
        begun = Squares(residual, jacobian, np.array([9.0]))
        found = descend(begun, steps=60, relative_gain=1e-8, predicted_gain=given)
        tried.append((len(begun.asked), found.point.energy))
    assert tried[1][0] < tried[0][0]
    assert tried[1][1] == pytest.approx(tried[0][1], rel=1e-6)


def test_it_stops_at_the_ceiling():
    begun = Valley(2.0, -1.0)  # every step leads up
    damping = Damping(initial=1.0, up=10.0, ceiling=1e3)
    found = descend(begun, steps=5, relative_gain=1e-6, damping=damping)
    assert found.point is begun and found.steps == 0
    assert begun.asked == [1.0, 10.0, 100.0, 1000.0]


@pytest.mark.parametrize("shortenings", [0, 3])
@pytest.mark.parametrize("stride", [0.5, 1.0, 2.5, 20.0])
def test_it_ends_at_the_bottom(stride, shortenings):
    """Whether steps are good, too long, or so long that the energy there is not a number."""
    found = descend(
        Valley(2.0, stride),
        steps=60,
        relative_gain=1e-12,
        negligible=1e-12,
        shortenings=shortenings,
    )
    assert abs(found.point.x) < 1e-3


def test_a_step_too_long_is_shortened_without_asking_for_another():
    damping = Damping(initial=1e-9)
    begun = Valley(2.0, 2.5)  # 0.4 of it lead to the bottom
    found = descend(begun, steps=1, relative_gain=1e-12, damping=damping, shortenings=1)
    assert found.point.energy < 1e-12
    assert begun.asked == [1e-9]
    begun = Valley(2.0, 2.5)
    descend(begun, steps=1, relative_gain=1e-12, damping=damping)
    assert len(begun.asked) > 5


def test_a_shortened_step_is_followed_by_a_damped_one():
    begun = Valley(2.0, 2.2)
    descend(begun, steps=2, relative_gain=0.0, damping=Damping(initial=1e-3), shortenings=1)
    assert begun.asked == [1e-3, 8e-3]


def test_a_negligible_energy_needs_no_step():
    begun = Valley(1e-3, 1.0)
    assert descend(begun, steps=5, relative_gain=0.0, negligible=1e-5).point is begun
    assert begun.asked == []


def test_a_last_step_is_taken_when_it_leads_down_and_only_then():
    down, up = Valley(2.0, 0.5), Valley(2.0, 3.0)
    settings = {"steps": 9, "relative_gain": 0.0, "is_last": lambda point, step: True}
    found = descend(down, **settings)
    assert found.steps == 1 and found.point.energy < down.energy and len(down.asked) == 1
    found = descend(up, **settings)
    assert found.steps == 0 and found.point is up and len(up.asked) == 1
