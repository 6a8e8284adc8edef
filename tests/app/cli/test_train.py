"""`deformer train`: where it writes, and what it keeps when it is cut short."""

import errno
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import deformer
from bars import bending_bar
from command import DEFORMER
from deformer.model import storage
from deformer_app import console
from deformer_app.cli.main import app
from waiting import HANG


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
    monkeypatch.setattr(deformer, "load_shapes", no_work)
    assert Path(foreign).parts[0] in refuse(*train(shapes_path, tmp_path / "m"))
    assert path.read_text() == "keep me"


@pytest.mark.parametrize("count", [6, 20])
def test_the_end_says_in_one_line_where_shapes_are_few(count, tmp_path, monkeypatch, capsys):
    deformer.save_shapes(tmp_path / "bar.npz", bending_bar(count))
    model = deformer.load_model("flag")
    monkeypatch.setattr(deformer, "train", lambda *_, **__: model)
    arguments = train(tmp_path / "bar.npz", tmp_path / "m")
    assert console.run(app, [str(argument) for argument in arguments]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len([line for line in lines if f"{count} shapes: " in line]) == (count < 20)


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


@pytest.mark.slow
def test_a_disk_that_gets_full_is_one_line_and_loses_nothing(
    run, shapes_path, tmp_path, monkeypatch
):
    write = storage.write_tensors

    def full(path, arrays):
        write(path, arrays)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    command = train(shapes_path, tmp_path / "m")
    with monkeypatch.context() as patch:
        patch.setattr(storage, "write_tensors", full)
        status, out, err = run(*command)
    told = err.splitlines()[-1]
    assert (status, out) == (2, "") and told.startswith(f"deformer: {tmp_path / 'm'}: No space")
    going_on = shlex.split(told.split("to go on: deformer ")[1])
    assert going_on == [*map(str, command), "--resume"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.checkpoint"]

    status, _, err = run(*going_on)
    assert status == 0 and "cross-validation" not in err
    assert deformer.load_model(tmp_path / "m").summary["epochs"] == 4
    assert not (tmp_path / "m.checkpoint").exists()


@pytest.mark.slow
def test_resuming_looks_at_the_checkpoint_first(refuse, run, shapes_path, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(deformer.DeformationModel, "save", interrupted)
        status, _, err = run(*train(shapes_path, tmp_path / "m"))
    assert status == 130 and err.splitlines()[-1].startswith("Interrupted: what is finished")
    monkeypatch.setattr(deformer, "load_shapes", no_work)
    command = train(shapes_path, tmp_path / "m", "--resume")
    assert "other config" in refuse(*command, "--components", "5")
    (tmp_path / "m.checkpoint" / "checkpoint.json").write_text("{")
    assert "checkpoint.json, line 1: not JSON" in refuse(*command)


def test_a_training_that_has_ended_is_told_where_it_is_resumed(refuse, model_path, tmp_path):
    shutil.copytree(model_path, tmp_path / "m")
    before = sorted(tmp_path.rglob("*"))
    message = refuse(*train(tmp_path / "shapes", tmp_path / "m", "--resume"))
    assert message == (
        f"deformer: {tmp_path / 'm'}: the training of this model has ended, so there is nothing to "
        "resume; start without --resume to train anew"
    )
    (tmp_path / "empty").mkdir()
    assert "no checkpoint to resume" in refuse(
        *train(tmp_path / "shapes", tmp_path / "empty", "--resume")
    )
    (tmp_path / "empty").rmdir()
    assert sorted(tmp_path.rglob("*")) == before  # nothing else is written


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize(
    "moment",
    ["features 2/12", "features 12/12", "cross-validation 4", "cross-validation 7", "training 1/4",
     "training 4/4"],
)  # fmt: skip
def test_ctrl_c_at_any_moment_is_told_and_goes_on(run, shapes_path, tmp_path, moment):
    command = train(shapes_path, tmp_path / "m")
    process = subprocess.Popen([*DEFORMER, *map(str, command)], stderr=subprocess.PIPE, text=True)
    sent, line = False, ""
    try:
        assert process.stderr is not None
        for line in process.stderr:
            if line.startswith(moment) and not sent:
                process.send_signal(signal.SIGINT)
                sent = True
        status = process.wait(HANG)
    finally:
        process.kill()
        process.stderr.close()
    assert (status, "Traceback" in line) == (130, False)
    if "nothing was finished" in line:
        assert moment.startswith("features")
        return
    assert "to go on: deformer train" in line.lower() and line.endswith("--resume\n")
    status, _, err = run(*command, "--resume")
    assert status == 0, err
    assert "features" not in err
    assert deformer.load_model(tmp_path / "m").summary["epochs"] == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m"]


# The half of a checkpoint's file is written when Ctrl-C is pressed twice: the second cuts it short.
TWICE = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from deformer.io import tensors
from deformer.training import loop

loop._CHECKPOINT_SECONDS = 0.0
write, saves = tensors._save, []

def interrupted(path, *contents):
    write(path, *contents)
    saves.append(path) if "epoch-" in path.name else None
    if len(saves) == {save}:
        path.write_bytes(path.read_bytes()[:1000])
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

tensors._save = interrupted
from deformer_app.cli.main import main
main()
"""


@pytest.mark.slow
@pytest.mark.parametrize("save", [3, 5], ids=["between steps", "after the last"])
def test_a_second_ctrl_c_during_a_save_leaves_the_checkpoint_whole(
    run, shapes_path, tmp_path, save
):
    command = train(shapes_path, tmp_path / "m")
    done = subprocess.run(
        [sys.executable, "-c", TWICE.replace("{save}", str(save)), *map(str, command)],
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert done.returncode == 130 and "Traceback" not in done.stderr, done.stderr
    assert done.stderr.count("Interrupted: ") == 1, done.stderr
    assert done.stderr.endswith("--resume\n"), done.stderr
    checkpoint = tmp_path / "m.checkpoint"
    assert not [path.name for path in checkpoint.iterdir() if path.name.startswith(".")]
    deformer.check_resumable(checkpoint, components=3, epochs=4)
    status, _, err = run(*command, "--resume")
    assert status == 0, err
    assert deformer.load_model(tmp_path / "m").summary["epochs"] == 4
    assert not checkpoint.exists()


def test_the_reference_is_the_shape_or_the_file_that_is_named(tmp_path, capsys):
    shapes = bending_bar()
    deformer.save_shapes(tmp_path / "walk", shapes, "obj")
    rest = str(tmp_path / "walk" / "0004.obj")
    for given, count in (("0004", len(shapes)), (rest, len(shapes) + 1)):
        arguments = ["train", str(tmp_path / "walk"), "-o", str(tmp_path / f"model{count}")]
        arguments += ["--components", "2", "--epochs", "2", "--reference", given, "--json"]
        assert console.run(app, arguments) == 0
        assert json.loads(capsys.readouterr().out)["summary"]["shapes"] == count
        model = deformer.load_model(tmp_path / f"model{count}")
        np.testing.assert_array_equal(model.reference.vertices, shapes.vertices[4])
