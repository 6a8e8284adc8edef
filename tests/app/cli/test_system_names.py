"""Commands in folders of any name, and on file systems that ignore case."""

import json
import os

import pytest

import deformer
from bars import bending_bar
from deformer_app.console import expanded
from shapes import small_model

HANDLES = {"handles": [{"vertex": 3, "position": [0.0, 0.0, 0.0]}]}


@pytest.mark.parametrize("name", ["my walk (1)", "περπάτημα", "走路"])
def test_commands_work_in_folders_of_any_name(run, tmp_path, name):
    folder = tmp_path / name
    folder.mkdir()
    deformer.save_shapes(folder / name, bending_bar(), format="obj")
    small_model().save(folder / f"{name} model")
    (folder / f"{name}.json").write_text(json.dumps(HANDLES))
    model, output = folder / f"{name} model", folder / f"{name}.ply"
    assert run("check", folder / name)[0] == 0
    status, _, told = run("fit", model, folder / f"{name}.json", "-o", output)
    assert status == 0, told
    assert len(deformer.load_mesh(output).vertices) == 120


def test_an_output_is_no_input_by_another_name(refuse, model_path, tmp_path):
    """A hard link is to a path what another case is where the file system ignores it."""
    handles = tmp_path / "handles.ply"
    handles.write_text(json.dumps(HANDLES))
    os.link(handles, tmp_path / "Handles.PLY")
    before = handles.read_bytes()
    line = refuse("fit", model_path, handles, "-o", tmp_path / "Handles.PLY")
    assert "is also the input" in line
    assert handles.read_bytes() == before


def test_results_whose_names_differ_in_case_alone_are_refused(refuse, model_path, tmp_path):
    takes = []
    for folder, name in (("a", "Rise.json"), ("b", "rise.json")):
        (tmp_path / folder).mkdir()
        takes.append(tmp_path / folder / name)
        takes[-1].write_text(json.dumps(HANDLES))
    line = refuse("fit", model_path, *takes, "-o", tmp_path / "out")
    assert "some systems ignore case" in line


def test_patterns_that_a_shell_of_windows_leaves_are_expanded(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("b.json", "a.json", "c.txt"):
        (tmp_path / name).touch()
    given = ["fit", "model", "*.json", "-o", "what?", "--weights", "3=0.8"]
    assert expanded(given, windows=True) == [
        "fit", "model", "a.json", "b.json", "-o", "what?", "--weights", "3=0.8",
    ]  # fmt: skip
    assert expanded(given, windows=False) == given
