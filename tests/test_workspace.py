"""Arrays in files: what is read is what was written, and the limit of memory is kept."""

import gc
from pathlib import Path

import numpy as np
import pytest

from deformer.errors import InputError
from deformer.workspace import LEAST_MEMORY, StoredArray, Workspace, blocks


@pytest.fixture
def filed(tmp_path):
    """An array and its copy in a file."""
    values = np.random.default_rng(1).normal(size=(9, 4, 3))
    stored = Workspace(LEAST_MEMORY, tmp_path).empty(values.shape, values.dtype)
    assert isinstance(stored, StoredArray)
    stored[:5] = values[:5]
    stored[5:9] = values[5:]
    return values, stored


def test_every_index_reads_what_numpy_does(filed):
    values, stored = filed
    assert (len(stored), stored.ndim, stored.nbytes) == (9, 3, values.nbytes)
    for key in (0, -1, np.int64(3), slice(2, 6), slice(None), slice(4, 4), [8, 0, 0, 3], []):
        np.testing.assert_array_equal(stored[key], values[key], err_msg=str(key))
    np.testing.assert_array_equal(stored[3, 1:3], values[3, 1:3])
    np.testing.assert_array_equal(list(stored), list(values))
    with pytest.raises(IndexError):
        stored[9]


def test_parts_are_written_where_they_belong(filed):
    values, stored = filed
    stored[2, 1:3] = values[2, 1:3] = np.full((2, 3), 7.0)
    stored[3:5] = values[3:5] = values[:2].copy()
    np.testing.assert_array_equal(stored[:], values)


def test_blocks_cover_all_rows_once():
    rows = np.zeros((10, 3))
    found = list(blocks(rows, size=96))
    assert [part.stop - part.start for part in found] == [4, 4, 2]
    assert [part.stop - part.start for part in blocks(rows, size=1)] == [1] * 10
    assert list(blocks(np.zeros((0, 3)))) == []


def test_the_whole_of_a_stored_array_is_not_taken_into_memory_by_chance(filed):
    with pytest.raises(InputError, match=r"shape \(9, 4, 3\) is in a file"):
        np.asarray(filed[1])


def test_small_arrays_are_in_memory_until_the_limit(tmp_path):
    workspace = Workspace(LEAST_MEMORY + 1000, tmp_path)
    first = workspace.empty((400,), np.uint8)
    assert isinstance(first, np.ndarray)
    assert isinstance(workspace.empty((400,), np.uint8), StoredArray)
    del first
    gc.collect()  # its memory counts as free again
    assert isinstance(workspace.empty((400,), np.uint8), np.ndarray)


def test_what_is_reserved_counts(tmp_path):
    workspace = Workspace(LEAST_MEMORY + 1000, tmp_path)
    workspace.reserve(900, "training")
    assert isinstance(workspace.empty((80,), np.uint8), StoredArray)
    with pytest.raises(InputError, match=r"training: would take 0\.501 GB of memory"):
        workspace.reserve(1100, "training")
    workspace.reserve(100, "training")  # in place of what was reserved before
    assert isinstance(workspace.empty((400,), np.uint8), np.ndarray)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1e6,), "memory: expected a finite number of at least 5e"),
        ((1e9, "no-such-folder"), "cache: no-such-folder is no directory"),
    ],
)
def test_bad_limits_are_one_line(arguments, message):
    with pytest.raises(InputError, match=message):
        Workspace(*arguments)


def test_the_memory_that_a_message_asks_for_is_enough():
    with pytest.raises(InputError, match="would take") as told:
        Workspace(809e6).reserve(309_300_000, "training")
    assert "would take 0.81 GB of memory, expected at most the 0.809 GB" in str(told.value)
    Workspace(0.81e9).reserve(309_300_000, "training")


def test_too_small_a_limit_is_told_in_the_units_of_the_command_line():
    with pytest.raises(InputError, match=r"give at least 500MB"):
        Workspace(10e6)


def test_a_folder_that_is_not_writable_is_told_before_any_work(tmp_path, monkeypatch):
    # Told only when it was written to, the failure had the name of the file that was being read.
    monkeypatch.setattr("os.access", lambda path, mode: Path(path) != tmp_path)
    with pytest.raises(InputError, match=r"cache: .* is not writable; name another"):
        Workspace(1e9, tmp_path)


def test_a_folder_without_room_is_told(tmp_path):
    with pytest.raises(InputError, match=r"GB free, expected .* make room"):
        Workspace(LEAST_MEMORY, tmp_path).empty((10**15,), np.uint8)
