"""The folder of a checkpoint: which of its files are the program's, and what is refused there."""

import json
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from deformer import InputError
from deformer.training.checkpoints import (
    Stages,
    check_arrays,
    check_checkpoint,
    load_checkpoint,
    remove_checkpoint,
    save_checkpoint,
)


@pytest.fixture
def folder(tmp_path):
    save_checkpoint(
        tmp_path / "run", {"what": "test"}, {"epoch": 3, "seconds": 1.0}, {"total": np.arange(3)}
    )
    return tmp_path / "run"


def test_a_checkpoint_is_removed_with_what_a_killed_process_left_of_it(folder):
    (folder / ".epoch-0000004-0123abcd.safetensors").write_bytes(b"half")
    check_checkpoint(folder)
    remove_checkpoint(folder)
    assert not folder.exists()
    remove_checkpoint(folder)  # nothing there


@pytest.mark.parametrize(
    "name",
    [
        *("letter.txt", "weights.safetensors", "epoch-1.safetensors"),
        *("features.safetensors", "trials.safetensors", "epoch-0000009.safetensors"),
        "checkpoint.json",
    ],
)
def test_files_of_the_user_are_refused_and_stay(folder, name):
    """Also those with the name of a checkpoint's file, by their contents."""
    if name.endswith(".safetensors"):
        save_file({"a": np.zeros(3)}, folder / name)
    else:
        (folder / name).write_text('{"format": 1, "mine": true}')
    with pytest.raises(InputError, match=f"run: already holds '{name}'"):
        check_checkpoint(folder)
    remove_checkpoint(folder)
    assert [path.name for path in folder.iterdir()] == [name]


def test_a_checkpoint_cut_short_is_still_known_for_one(folder):
    Stages(folder, {"what": "test"}).save("features", {"x": np.arange(1000.0)})
    for path in folder.glob("*.safetensors"):
        path.write_bytes(path.read_bytes()[:-10])
    check_checkpoint(folder)
    remove_checkpoint(folder)
    assert not folder.exists()


def test_a_file_in_its_place_is_refused(tmp_path):
    (tmp_path / "run").write_text("keep me")
    with pytest.raises(InputError, match="is a file"):
        check_checkpoint(tmp_path / "run")
    assert (tmp_path / "run").read_text() == "keep me"


def test_a_checkpoint_is_read_back(folder):
    status, arrays = load_checkpoint(folder, {"what": "test"})
    assert (status["epoch"], status["seconds"]) == (3, 1.0)
    assert arrays["total"].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("epoch", -1),
        ("epoch", 3.0),
        ("epoch", 10**8),
        ("epoch", "3"),
        ("seconds", None),
        ("seconds", -1),
        ("seconds", 10**400),
        ("arrays", "../../secret.safetensors"),
        ("arrays", 3),
        ("identity", []),
        ("identity", {}),
        ("format", 99),
    ],
)
def test_damaged_descriptions_are_refused(folder, key, value):
    path = folder / "checkpoint.json"
    data = json.loads(path.read_text())
    path.write_text(json.dumps({**data, key: value}))
    with pytest.raises(InputError, match=r"checkpoint\.json: ") as caught:
        load_checkpoint(folder, {"what": "test"})
    assert len(str(caught.value).removeprefix(str(path))) < 200


@pytest.mark.parametrize("content", [b"", bytes(50), b"[" * 10**5, b"{\xff}", b"3"])
def test_files_that_are_none_are_refused(folder, content):
    (folder / "checkpoint.json").write_bytes(content)
    with pytest.raises(InputError, match=r"checkpoint\.json"):
        load_checkpoint(folder, {})
    stages = Stages(folder, {})
    (folder / "features.safetensors").write_bytes(content)
    for read in (stages.load, stages.check):
        with pytest.raises(InputError, match=r"features\.safetensors"):
            read("features")


def test_arrays_of_another_training_are_refused():
    expected = {"a": np.zeros((2, 3)), "n": np.zeros(2, dtype=np.int64)}
    check_arrays(Path("run"), {name: array + 1 for name, array in expected.items()}, expected)
    for change in (
        {"a": np.zeros((3, 2))},
        {"a": np.zeros((2, 3), dtype=np.float32)},
        {"a": np.full((2, 3), np.nan)},
        {"a": np.full((2, 3), 1e30)},
        {"n": np.zeros(2)},
        {"b": np.zeros(1)},
    ):
        message = rf"run: {next(iter(change))}(\[0, 0\])?: expected .*; delete the checkpoint"
        with pytest.raises(InputError, match=message):
            check_arrays(Path("run"), {**expected, **change}, expected)
    with pytest.raises(InputError, match="n: expected int64"):
        check_arrays(Path("run"), {"a": expected["a"]}, expected)
