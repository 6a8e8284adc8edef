"""Descents of the rivals: the energy never rises, and a dear step is used well."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from deformer.baselines._descent import descend


@dataclass
class Valley:
    """x² with steps `stride` times as long as they should be; damping shortens them."""

    x: float
    stride: float
    asked: list[float] = field(default_factory=list)

    @property
    def value(self) -> float:
        return self.x**2 if abs(self.x) < 10 else float("nan")

    def step(self, damping):
        self.asked.append(damping)
        return np.array(-self.x * self.stride / (1.0 + damping))

    def moved(self, step):
        return Valley(self.x + float(step), self.stride, self.asked)


@pytest.mark.parametrize("shorter", [0, 3])
@pytest.mark.parametrize("stride", [0.5, 1.0, 2.5, 20.0])
def test_it_ends_at_the_bottom(stride, shorter):
    """Whether steps are good, too long, or so long that the energy there is not a number."""
    found = descend(Valley(2.0, stride), 60, 1e-12, shorter=shorter, floor=1e-12)
    assert abs(found.x) < 1e-3


def test_a_step_too_long_is_shortened_without_asking_for_another():
    begun = Valley(2.0, 2.5)  # 0.4 of it lead to the bottom
    assert descend(begun, 1, 1e-12, damping=1e-9, shorter=1).value < 1e-12
    assert begun.asked == [1e-9]
    begun = Valley(2.0, 2.5)
    descend(begun, 1, 1e-12, damping=1e-9)
    assert len(begun.asked) > 5


def test_a_shortened_step_is_followed_by_a_damped_one():
    begun = Valley(2.0, 2.2)
    descend(begun, 2, 0.0, damping=1e-3, shorter=1)
    assert begun.asked == [1e-3, 8e-3]


def test_without_a_way_down_it_stays():
    begun = Valley(2.0, -1.0)
    assert descend(begun, 5, 1e-6, shorter=2) is begun
