"""Truths of the warning about handle targets in other units than the model."""

import copy
import json
import logging
from pathlib import Path

import numpy as np
import pytest

from deformer import HandleSolver, Mesh, fit_sequence, load_model, unit_warning
from shapes import random_rotation, small_model

HANDLES = np.arange(4, 120, 12)
FACTORS = {
    1000.0: ("millimetres", "metres"),
    100.0: ("centimetres", "metres"),
    10.0: ("millimetres", "centimetres"),
    25.4: ("millimetres", "inches"),
    2.54: ("centimetres", "inches"),
    12.0: ("inches", "feet"),
    1 / 0.3048: ("feet", "metres"),
    1 / 0.0254: ("inches", "metres"),
}


@pytest.fixture(scope="module")
def shapes(model):
    return model.decode(model.codes)


def moved(rng, points, distance):
    """Points rigidly moved by a random rotation and a random shift of a length."""
    shift = rng.normal(size=3)
    return points @ random_rotation(rng).T + distance * shift / np.linalg.norm(shift)


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("inverse", [False, True])
def test_targets_in_other_units_are_named_with_the_factor(model, shapes, factor, inverse):
    fine, coarse = FACTORS[factor]
    scale = 1 / factor if inverse else factor
    for shape in (model.reference.vertices, shapes[2]):
        warning = unit_warning(model, HANDLES, scale * shape[HANDLES])
        expected = (coarse, fine) if inverse else (fine, coarse)
        assert f"in {expected[0]} and the model in {expected[1]}" in warning
        assert f"scale them by {1 / scale:.4g}" in warning


def test_poses_and_motion_are_no_reason(model, shapes):
    rng, D = np.random.default_rng(0), model.reference.bounding_diagonal
    for shape in shapes:
        for count in (1, 2, 3, 5, 10):
            chosen = rng.choice(HANDLES, count, replace=False)
            away = moved(rng, shape[chosen], 20 * D)
            assert unit_warning(model, chosen, away) is None


@pytest.mark.parametrize("distance", [1.0, 5.0, 9.0, 20.0])
def test_one_handle_dragged_far_is_no_reason(model, distance):
    rng, D = np.random.default_rng(1), model.reference.bounding_diagonal
    rest = model.reference.vertices
    for _ in range(100):
        chosen = rng.choice(len(rest), rng.integers(1, 8), replace=False)
        targets = rest[chosen].copy()
        direction = rng.normal(size=3)
        targets[0] += distance * D * direction / np.linalg.norm(direction)
        assert unit_warning(model, chosen, targets) is None


def test_handles_brought_together_are_no_reason(model):
    rng, D = np.random.default_rng(2), model.reference.bounding_diagonal
    rest = model.reference.vertices
    for _ in range(200):
        chosen = rng.choice(len(rest), rng.integers(2, 8), replace=False)
        where = rng.normal(size=3)
        targets = where + 0.01 * D * rng.normal(size=(len(chosen), 3))
        assert unit_warning(model, chosen, targets) is None
        assert unit_warning(model, chosen, np.zeros((len(chosen), 3))) is None


def test_a_pose_that_brings_handles_together_is_no_reason():
    """Fingertips of a fist, as near to each other as those of an open hand in inches."""
    model = load_model("hand")
    tips = [755, 867, 1353, 1553]
    rest = model.reference.vertices[tips]
    ways = [[3, -58, -104], [17, -65, -120], [36, -53, -106], [38, -35, -90]]  # millimetres
    fist = np.add(rest, np.divide(ways, 1000))
    assert unit_warning(model, tips, fist) is None
    assert "inches" in unit_warning(model, tips, rest / 2.54)
    poses = model.decode(model.codes[1::4])[:, tips]  # not those that the warning looks at
    warned = [unit_warning(model, tips, pose) is not None for pose in poses]
    assert sum(warned) <= 1


def test_one_or_two_handles_a_thousand_times_too_far(model, shapes):
    for chosen in ([4], [4, 88]):
        assert "millimetres" in unit_warning(model, chosen, 1000 * (5 + shapes[1][chosen]) - 4800)


def test_markers_of_a_sheet_in_millimetres():
    x, y = np.meshgrid(np.linspace(0, 1, 6), np.linspace(0, 1, 6))
    sheet = Mesh(np.stack([x, y, 0 * x], axis=2).reshape(-1, 3), [[0, 1, 6]])
    file = json.loads((Path(__file__).parent / "millimetres.json").read_text())["handles"]
    vertices, targets = ([handle[key] for handle in file] for key in ("vertex", "position"))
    model = copy.copy(small_model())
    object.__setattr__(model, "reference", sheet)  # all that the warning looks at
    warning = unit_warning(model, vertices, targets)
    assert "span about 1000 times" in warning and "scale them by 0.001" in warning


def test_frames_agree_and_markers_may_be_missing(model, shapes, caplog):
    targets = 1000 * shapes[:, HANDLES]
    targets[0] = np.nan
    targets[1:, 3] = np.nan
    assert "millimetres" in unit_warning(model, HANDLES, targets)
    targets[3:] /= 1000
    assert unit_warning(model, HANDLES, targets) is None
    assert unit_warning(model, HANDLES, np.full_like(targets, np.nan)) is None
    assert unit_warning(model, [], np.empty((0, 3))) is None


def test_solvers_log_it_once(model, shapes, caplog):
    caplog.set_level(logging.WARNING, logger="deformer")
    solver = HandleSolver(model)
    for _ in range(3):
        solver.set_handles(HANDLES, 1000 * shapes[1][HANDLES])
    assert len(caplog.messages) == 1 and "millimetres" in caplog.messages[0]
    solver.set_handles(HANDLES, shapes[1][HANDLES])
    assert len(caplog.messages) == 1
    fit_sequence(model, HANDLES, 0.01 * shapes[:4, HANDLES])
    assert len(caplog.messages) == 2 and "centimetres" in caplog.messages[1]


def test_units_are_noticed_however_slowly_targets_come_to_them(model, shapes, caplog):
    caplog.set_level(logging.WARNING, logger="deformer")
    solver, targets = HandleSolver(model), shapes[1][HANDLES]
    farthest = np.abs(targets).max() / model.reference.bounding_diagonal
    for factor in np.arange(1.0, 12.0, 0.05 / farthest):
        solver.set_handles(HANDLES, factor * targets)
    assert caplog.messages


def test_targets_farther_apart_than_any_pose_have_a_warning_without_a_factor(model):
    """Of another body, so that no scale brings them near their points."""
    rng, D = np.random.default_rng(3), model.reference.bounding_diagonal
    targets = 1000 * D * rng.normal(size=(5, 3))
    warning = unit_warning(model, [0, 1, 2, 3, 4], targets)
    assert "times as far from each other" in warning
    assert unit_warning(model, [0, 1, 2, 3, 4], targets / 100) is None
    with_missing = np.concatenate([targets, np.full((1, 3), np.nan)])
    assert unit_warning(model, [0, 1, 2, 3, 4, 5], with_missing) is not None
