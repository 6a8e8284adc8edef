"""Sequences of any length: some frames at a time, from files, and gone on with after a kill."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

import deformer
from deformer import Floor, InputError, Workspace, fit_sequence, fit_sequence_parts, remove_windows
from deformer.editing import sequence_windows
from deformer.editing.sequence_energy import SequenceEnergy
from deformer.geometry import log_to_rotation
from deformer.workspace import LEAST_MEMORY, StoredArray
from shapes import small_model

HANDLES = [4, 40, 76, 112]
FRAMES = 36


@pytest.fixture
def windows(monkeypatch):
    """Windows so short that the frames have several."""
    monkeypatch.setattr(sequence_windows, "WINDOW", 15)
    monkeypatch.setattr(sequence_windows, "_AHEAD", 6)
    monkeypatch.setattr(sequence_windows, "_SHAPES", 4)


@pytest.fixture(scope="module")
def targets():
    model = small_model()
    t = np.linspace(0, 1, FRAMES)[:, None]
    codes = (1 - t) * model.codes[2] + t * model.codes[7]
    shapes = np.array([model.decode(z) for z in codes])[:, HANDLES]
    size = 0.01 * model.reference.bounding_diagonal
    return shapes + size * np.random.default_rng(0).normal(size=shapes.shape)


def options(case) -> dict[str, Any]:
    """Arguments that a sequence may have."""
    model, rng = small_model(), np.random.default_rng(1)
    match case:
        case "weights":
            seen = rng.random((FRAMES, 4)) < 0.6
            return {"weights": seen * rng.uniform(0.5, 2, (FRAMES, 4)), "hard": seen & (seen[::-1])}
        case "turned":
            turns = np.full((FRAMES, 4, 3, 3), np.nan)
            turns[20:, 1] = log_to_rotation([0.0, 0.2, 0.1])
            turns[:, 2] = np.eye(3)
            gaps = 0.01 * rng.normal(size=(FRAMES, 4, 3))
            return {"orientations": turns, "gaps": gaps, "orientation_weights": [1, 2, 3, 1]}
        case "floor":
            height = float(np.percentile(model.decode(model.codes[4])[:, 1], 20))
            return {"floor": Floor(height), "misfit": 0.01}
    return {"mean": np.linspace(model.codes[2], model.codes[7], FRAMES), "smoothness": 0.0}


def stored(values, folder):
    """An array of frames in a file."""
    rows = Workspace(LEAST_MEMORY, folder).empty(values.shape, values.dtype)
    assert isinstance(rows, StoredArray)
    rows[: len(values)] = values
    return rows


def joined(parts):
    parts = list(parts)
    assert len(parts) > 3
    names = [field.name for field in fields(parts[0]) if field.name != "iterations"]
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return arrays | {"iterations": sum(part.iterations for part in parts)}


def check_same(parts, whole):
    for name, values in joined(parts).items():
        np.testing.assert_array_equal(values, getattr(whole, name), err_msg=name)


@pytest.mark.parametrize("case", ["weights", "turned", "floor", "means"])
def test_parts_from_files_are_the_whole(windows, tmp_path, targets, case):
    model, given = small_model(), options(case)
    whole = fit_sequence(model, HANDLES, targets, **given)
    assert len(whole.vertices) == FRAMES and whole.iterations > 3
    names = {"weights", "hard", "orientations", "gaps"} & set(given)
    filed: dict[str, Any] = {name: stored(given[name], tmp_path) for name in names}
    workspace = Workspace(LEAST_MEMORY + 20e6, tmp_path)
    parts = fit_sequence_parts(
        model, HANDLES, stored(targets, tmp_path), **(given | filed), workspace=workspace
    )
    check_same(parts, whole)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("case", ["weights", "floor"])
def test_a_fit_that_is_broken_off_goes_on_from_its_windows(
    windows, tmp_path, targets, case, monkeypatch
):
    model, folder, solved = small_model(), tmp_path / "windows", []
    solve = SequenceEnergy.solve

    def counted(self, *arguments):
        solved.append(1)
        return solve(self, *arguments)

    monkeypatch.setattr(SequenceEnergy, "solve", counted)
    given = options(case)
    whole = fit_sequence(model, HANDLES, targets, **given)
    total = len(solved)
    solved.clear()

    def stop(done, frames):
        if len(solved) == 3:
            raise KeyboardInterrupt

    again = {**given, "checkpoint": folder}
    with pytest.raises(KeyboardInterrupt):
        list(fit_sequence_parts(model, HANDLES, targets, **again, on_progress=stop))
    kept = len(list(folder.iterdir()))
    assert kept in (2, 3)
    solved.clear()
    check_same(fit_sequence_parts(model, HANDLES, targets, **again), whole)
    assert len(solved) == total - kept
    remove_windows(folder)
    assert not folder.exists()


def test_windows_of_another_fit_are_not_used(windows, tmp_path, targets):
    model, folder, other = small_model(), tmp_path / "windows", targets + 1e-3
    list(fit_sequence_parts(model, HANDLES, targets, checkpoint=folder))
    expected = fit_sequence(model, HANDLES, other)
    check_same(fit_sequence_parts(model, HANDLES, other, checkpoint=folder), expected)
    expected = fit_sequence(model, HANDLES, other, smoothness=3.0)
    found = fit_sequence_parts(model, HANDLES, other, checkpoint=folder, smoothness=3.0)
    check_same(found, expected)


def test_a_checkpoint_is_no_folder_of_other_files(tmp_path, targets):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"already holds 'notes\.txt'"):
        fit_sequence_parts(small_model(), HANDLES, targets, checkpoint=tmp_path)
    remove_windows(tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_damaged_window_is_told(windows, tmp_path, targets):
    folder = tmp_path / "windows"
    list(fit_sequence_parts(small_model(), HANDLES, targets, checkpoint=folder))
    damaged = folder / "fit-0-window-000001.safetensors"
    damaged.write_bytes(damaged.read_bytes()[:-9])
    with pytest.raises(InputError, match=r"window-000001.*damaged"):
        list(fit_sequence_parts(small_model(), HANDLES, targets, checkpoint=folder))


@pytest.mark.parametrize(
    ("name", "shape"), [("targets", (36, 3, 3)), ("weights", (35, 4)), ("hard", (4,)),
                        ("orientations", (36, 4, 4)), ("gaps", (4, 3))],
)  # fmt: skip
def test_arrays_in_files_have_a_row_for_every_frame(tmp_path, targets, name, shape):
    given: dict[str, Any] = {"targets": targets, name: stored(np.zeros(shape), tmp_path)}
    with pytest.raises(InputError, match=rf"{name}: expected .*36"):
        fit_sequence_parts(small_model(), HANDLES, given.pop("targets"), **given)


def test_too_little_memory_is_told_before_anything_is_done(targets):
    with pytest.raises(InputError, match=r"fit: 4 handles, .* expected at most the 0\.5 GB"):
        fit_sequence_parts(small_model(), HANDLES, targets, workspace=Workspace(LEAST_MEMORY))
    expected = deformer.sequence_memory(2000, 50, 20)
    assert expected.least > LEAST_MEMORY and expected.frame == 48_000
