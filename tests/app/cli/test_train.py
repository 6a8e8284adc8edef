"""`deformer train`: where it writes, and what it keeps when it is cut short."""

import os
import sys
from pathlib import Path

import pytest

import deformer
from bars import bending_bar


@pytest.fixture(scope="module")
def shapes_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("shapes") / "bar.npz"
    deformer.save_shapes(path, bending_bar())
    return path


def train(shapes, output, *options):
    return ["train", shapes, "-o", output, "--components", "3", "--epochs", "4", *options]


def no_work(*_, **__):
    raise AssertionError("work has started")


def put(path, content="keep me"):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)
    return path


@pytest.mark.parametrize("foreign", ["m.checkpoint/notes.txt", "m/pose.ply", "m.checkpoint"])
def test_foreign_files_are_refused_before_work_starts(
    refuse, shapes_path, tmp_path, monkeypatch, foreign
):
    path = put(tmp_path / foreign)
    put(tmp_path / "m" / "weights.safetensors", "")
    monkeypatch.setattr(deformer, "load_shapes", no_work)
    assert Path(foreign).parts[0] in refuse(*train(shapes_path, tmp_path / "m"))
    assert path.read_text() == "keep me"


@pytest.mark.skipif(sys.platform != "linux", reason="its special files")
@pytest.mark.parametrize("output", ["/dev/null", "/dev/full/m", "/proc/m", "/sys/m", "/", "/proc"])
def test_places_for_no_folder_are_refused_before_work_starts(
    refuse, shapes_path, monkeypatch, output
):
    monkeypatch.setattr(deformer, "load_shapes", no_work)
    assert output.removesuffix("/m") in refuse(*train(shapes_path, output))


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_parent_that_is_read_only_is_refused_before_work_starts(
    refuse, shapes_path, tmp_path, monkeypatch
):
    monkeypatch.setattr(deformer, "load_shapes", no_work)
    tmp_path.chmod(0o500)
    try:
        assert "not writable" in refuse(*train(shapes_path, tmp_path / "m"))
    finally:
        tmp_path.chmod(0o700)


def test_a_mistake_of_the_shapes_leaves_the_old_checkpoint(run, tmp_path):
    from deformer.training.checkpoints import save_checkpoint

    save_checkpoint(tmp_path / "m.checkpoint", {}, {"epoch": 1}, {})
    status, _, err = run(*train(tmp_path / "nowhere", tmp_path / "m"))
    assert status == 2 and "nowhere" in err
    assert deformer.has_checkpoint(tmp_path / "m.checkpoint")
