"""Outputs of commands: one process at a time, and no foreign file is lost."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import deformer
from bars import bending_bar
from deformer import io
from shapes import small_model


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a model, shapes and handles of two frames, and the outputs in it."""
    monkeypatch.chdir(tmp_path)
    small_model().save("model")
    deformer.save_shapes("bar.npz", bending_bar())
    handles = [{"vertex": 3, "position": [0.0, 0.0, 0.0]}]
    Path("frames.json").write_text(json.dumps({"frames": [handles, handles]}))
    return tmp_path


COMMANDS = {
    "train": "train bar.npz -o out --components 2 --epochs 2",
    "evaluate": "evaluate bar.npz -o out --methods pca --components 2 --counts 5",
    "fit": "fit model frames.json -o out",
    "components": "components model -o out",
    "sweeps": "synthesize model --sweep 2=0:1:3 -o out",
    "random": "synthesize model --random 3 -o out",
    "interpolate": "interpolate model 1 2 -o out",
    "demo": "demo --model model -o out",
}
HOLD = "import sys; from deformer import io\nwith io.locked('out'): print(flush=True); input()"


@pytest.mark.parametrize("command", COMMANDS)
def test_an_output_that_another_process_writes_is_refused(folder, refuse, command):
    with subprocess.Popen(
        [sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        other.stdout.readline()
        line = refuse(*COMMANDS[command].split())
        assert line.startswith("deformer: out: another process is writing it; wait")
        other.communicate(b"\n")
    left = sorted(path.name for path in folder.iterdir())
    assert [name for name in left if name != "out"] == ["bar.npz", "frames.json", "model"]


def no_work(*_, **__):
    raise AssertionError("work has started")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_foreign_file_is_kept_and_named_before_the_work(folder, refuse, monkeypatch, command):
    Path("out").mkdir()
    Path("out/notes.txt").write_text("keep me")
    for work in ("train", "fit_sequence_parts", "ComponentAnalysis", "Synthesis", "draw_codes",
                 "interpolate", "HandleSolver"):  # fmt: skip
        monkeypatch.setattr(deformer, work, no_work)
    monkeypatch.setattr(deformer.evaluation, "evaluate", no_work)
    line = refuse(*COMMANDS[command].split())
    assert "out: " in line and ("notes.txt" in line or command == "evaluate")
    assert [path.name for path in Path("out").iterdir()] == ["notes.txt"]
    assert not list(folder.glob(".*"))


def test_the_copy_that_gets_names_is_no_foreign_folder(folder, refuse):
    Path("out").mkdir()
    Path("out/notes.txt").write_text("keep me")
    assert "notes.txt" in refuse("name", "model", "1=nod", "-o", "out")


@pytest.mark.parametrize("output", ["out/nowhere/pose.ply", "model"])
def test_an_output_file_is_checked_before_the_work(folder, refuse, monkeypatch, output):
    handles = [{"vertex": 3, "position": [0.0, 0.0, 0.0]}]
    io.write_json("one.json", {"handles": handles})
    monkeypatch.setattr(deformer, "HandleSolver", no_work)
    assert output.split("/")[0] in refuse("fit", "model", "one.json", "-o", output)


@pytest.mark.slow
def test_a_folder_of_the_same_command_is_replaced_as_a_whole(folder, run):
    command = ["synthesize", "model", "--sweep", "2=0:1:2", "-o", "out"]
    assert run(*command, "--sweep", "1=0:1:2")[0] == 0
    assert Path("out/sweep-1.gif").is_file()
    assert run(*command)[0] == 0
    names = [".deformer.json", "sheet.png", "sweep-0.gif", "sweep-0.npz"]
    assert sorted(path.name for path in Path("out").iterdir()) == names


@pytest.mark.slow
def test_names_given_by_two_processes_at_once_all_stay(folder):
    code = (
        "import sys, deformer\n"
        "for n in range(5): deformer.save_names('model', {int(sys.argv[1]): f'{sys.argv[1]} {n}.'})"
    )
    commands = [[sys.executable, "-c", code, str(k)] for k in range(4)]
    processes = [subprocess.Popen(command) for command in commands]
    assert [process.wait() for process in processes] == [0] * 4
    names = deformer.load_model("model").component_names
    assert names == {k: f"{k} 4." for k in range(4)}
    assert sorted(path.name for path in folder.iterdir()) == ["bar.npz", "frames.json", "model"]
