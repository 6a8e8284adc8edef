"""Targets whose axes are other ones than the model's are told, and others are not."""

from dataclasses import replace

import numpy as np
import pytest

from deformer import axis_warning
from deformer.geometry import PROPER_AXES, axis_turn, log_to_rotation
from shapes import small_model

HANDLES = list(range(0, 120, 7))


def motion():
    model = small_model()
    return np.array([model.decode(z) for z in np.linspace(model.codes[8], model.codes[3], 9)])


@pytest.mark.parametrize("P", PROPER_AXES, ids=lambda P: str(P.astype(int).tolist()))
def test_the_permutation_that_brings_points_back(P):
    model = small_model()
    rest = model.reference.vertices[None, HANDLES]
    shapes = motion()[:, HANDLES] @ P + [3.0, -1.0, 2.0]
    found = axis_turn(shapes, rest)
    if np.array_equal(P, np.eye(3)):
        assert found is None
    else:
        np.testing.assert_array_equal(found, P)


def test_targets_of_y_up_files_are_told_of_a_model_with_z_up():
    shapes = motion()[:, HANDLES]
    turned = np.stack([shapes[..., 0], shapes[..., 2], -shapes[..., 1]], axis=-1)
    seen = turned.copy()
    seen[3, :5] = np.nan
    rest = small_model().reference.vertices[HANDLES]
    one = np.stack([rest[..., 0], rest[..., 2], -rest[..., 1]], axis=-1)
    for targets in (turned, one, seen):
        warning = axis_warning(small_model(), HANDLES, targets)
        assert warning is not None and "x, -z, y in place of x, y, z" in warning
        assert "\n" not in warning


def test_poses_small_turns_and_few_points_are_no_reason():
    model, shapes = small_model(), motion()
    assert axis_warning(model, HANDLES, shapes[:, HANDLES]) is None
    R = log_to_rotation(np.array([0.9, 0.0, 0.0]))
    assert axis_warning(model, HANDLES, shapes[:, HANDLES] @ R.T) is None
    turned = shapes[:, :, [0, 2, 1]] * [1, 1, -1]
    assert axis_warning(model, HANDLES[:3], turned[:, HANDLES[:3]]) is None
    assert axis_warning(model, HANDLES, np.full((2, len(HANDLES), 3), np.nan)) is None


def test_turned_targets_are_no_reason_where_examples_are_turned():
    """Of a model whose reference lies beside its examples, which is told by the examples alone."""
    model = small_model()
    turned = motion()[:, HANDLES]
    P = PROPER_AXES[5]
    lying = replace(model.reference, vertices=model.reference.vertices @ P.T)
    rest = lying.vertices[None, HANDLES]
    assert axis_turn(turned, rest) is not None
    assert axis_turn(turned, np.concatenate([rest, turned])) is None
