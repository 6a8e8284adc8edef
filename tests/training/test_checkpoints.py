"""The folder of a checkpoint: which files of it are the program's to replace and to remove."""

import numpy as np
import pytest

from deformer import InputError
from deformer.training.checkpoints import (
    check_checkpoint,
    has_checkpoint,
    remove_checkpoint,
    save_checkpoint,
)


@pytest.fixture
def folder(tmp_path):
    save_checkpoint(tmp_path / "run", {"what": "test"}, {"epoch": 3}, {"total": np.arange(3)})
    return tmp_path / "run"


def test_a_checkpoint_is_removed_with_what_a_killed_process_left_of_it(folder):
    (folder / ".epoch-0000004-0123abcd.safetensors").write_bytes(b"half")
    check_checkpoint(folder)
    remove_checkpoint(folder)
    assert not folder.exists()
    remove_checkpoint(folder)  # nothing there


@pytest.mark.parametrize("name", ["letter.txt", "weights.safetensors", "epoch-1.safetensors"])
def test_files_of_the_user_are_refused_and_stay(folder, name):
    (folder / name).write_text("keep me")
    with pytest.raises(InputError, match=f"run: already holds '{name}'"):
        check_checkpoint(folder)
    remove_checkpoint(folder)
    assert not has_checkpoint(folder)
    assert [path.name for path in folder.iterdir()] == [name]


def test_a_file_in_its_place_is_refused(tmp_path):
    (tmp_path / "run").write_text("keep me")
    with pytest.raises(InputError, match="is a file"):
        check_checkpoint(tmp_path / "run")
    assert (tmp_path / "run").read_text() == "keep me"
