"""Truths of the bones' rigid transforms."""

import numpy as np
import pytest

from deformer.rigging.transforms import PULL, fitted_transforms, moments, skinned
from shapes import random_rotation, tube


def known(seed=0, shapes=5):
    rng = np.random.default_rng(seed)
    rest = tube().vertices
    T = np.empty((shapes, 2, 3, 4))
    for n, b in np.ndindex(shapes, 2):
        T[n, b] = np.column_stack([random_rotation(rng, 1.0), 0.3 * rng.normal(size=3)])
    x = np.clip(2 * rest[:, 0] / rest[:, 0].max() - 0.5, 0, 1)
    return rest, T, np.column_stack([1 - x, x])


def is_rigid(T):
    R = T[..., :3]
    np.testing.assert_allclose(
        R @ R.swapaxes(-1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-9
    )
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-9)


def test_bones_of_a_known_rig_come_back(monkeypatch):
    rest, T, w = known()
    monkeypatch.setattr("deformer.rigging.transforms.PULL", 0.0)
    shapes = skinned(w, rest, T).transpose(1, 0, 2)
    found = fitted_transforms(moments(w, rest, shapes), sweeps=3000)
    is_rigid(found)
    np.testing.assert_allclose(skinned(w, rest, found), skinned(w, rest, T), atol=1e-4)


def test_a_rigid_motion_is_exact():
    rest, T, w = known()
    shapes = rest @ T[:, 0, :, :3].swapaxes(1, 2) + T[:, 0, None, :, 3]
    found = fitted_transforms(moments(w, rest, shapes.transpose(1, 0, 2)))
    np.testing.assert_allclose(found, np.repeat(T[:, :1], 2, axis=1), atol=1e-6)


def test_no_single_bone_can_do_better():
    """Each bone's transform is the minimum, written out by hand, while the others stay."""
    rest, T, w = known()
    rng = np.random.default_rng(4)
    shapes = skinned(w, rest, T) + 0.05 * rng.normal(size=(5, len(rest), 3))
    found = fitted_transforms(moments(w, rest, shapes.transpose(1, 0, 2)))

    def energy(T):
        total = ((skinned(w, rest, T) - shapes) ** 2).sum()
        for b in range(2):
            own = rest @ T[:, b, :, :3].swapaxes(1, 2) + T[:, b, None, :, 3]
            total += PULL * (w[:, b] * ((own - shapes) ** 2).sum(axis=2)).sum()
        return total

    base = energy(found)
    for _ in range(60):
        turned = found.copy()
        n, b = rng.integers(5), rng.integers(2)
        turned[n, b, :, :3] = random_rotation(rng, 1e-2) @ turned[n, b, :, :3]
        turned[n, b, :, 3] += 1e-2 * rng.normal(size=3)
        assert energy(turned) > base


def test_mirror_images_get_rotations_all_the_same():
    rest, _, w = known()
    shapes = (rest * [1, 1, -1])[:, None]
    is_rigid(fitted_transforms(moments(w, rest, shapes)))


def test_points_on_a_line_and_a_single_point_move_rigidly():
    rest = np.column_stack([np.arange(6.0), np.zeros(6), np.zeros(6)])
    w = np.zeros((6, 2))
    w[:5, 0], w[5, 1] = 1.0, 1.0
    R = random_rotation(np.random.default_rng(0), 0.9)
    shapes = (rest @ R.T + [1.0, 2.0, 3.0])[:, None]
    found = fitted_transforms(moments(w, rest, shapes))
    is_rigid(found)
    np.testing.assert_allclose(skinned(w, rest, found)[0], shapes[:, 0], atol=1e-6)


@pytest.mark.parametrize("count", [1, 3])
def test_skinning_is_the_sum_over_bones(count):
    rest, T, w = known(shapes=count)
    by_hand = sum(
        w[:, b, None] * (rest @ T[:, b, :, :3].swapaxes(1, 2) + T[:, b, None, :, 3]) for b in (0, 1)
    )
    np.testing.assert_allclose(skinned(w, rest, T), by_hand, atol=1e-12)
