"""Options far from any sense: one line, at once, without memory; and names that are no text."""

import json
import os
import sys

import numpy as np
import pytest

import deformer
from bars import bending_bar

HUGE = "1000000000"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    deformer.load_model("flag").save(tmp_path / "model")
    deformer.save_shapes(tmp_path / "walk.npz", bending_bar())
    (tmp_path / "h.json").write_text('{"handles": [{"vertex": 0, "position": [0, 0, 0]}]}')
    (tmp_path / "f.json").write_text('{"frames": [[{"vertex": 0, "position": [0, 0, 0]}]]}')
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (f"train walk.npz -o m --components {HUGE}", "components"),
        (f"train walk.npz -o m --components {HUGE}{HUGE}{HUGE}", "components"),
        ("train walk.npz -o m --components 1.5", "components"),
        (f"train walk.npz -o m --epochs {HUGE}", "epochs"),
        ("train walk.npz -o m --epochs 1e9", "epochs"),
        (f"train walk.npz -o m --seed {HUGE}{HUGE}{HUGE}", "seed"),
        ("train walk.npz -o m --device cpu:foo", "device"),
        ("train walk.npz -o m --device cuda:99999999999999999999", "device"),
        ("train walk.npz -o m --device --", "device"),
        ("train walk.npz -o m --up q", "up"),
        (f"synthesize model --sweep 2=-1:1:{HUGE} -o out", "--sweep"),
        ("synthesize model --sweep 2=nan:1:3 -o out", "--sweep"),
        ("synthesize model --sweep 2=-1e308:1e308:3 -o out", "--sweep"),
        ("synthesize model --sweep 2=0:1:-3 -o out", "--sweep"),
        (f"synthesize model --sweep 2=0:1:{'9' * 5000} -o out", "--sweep"),
        (f"synthesize model --random {HUGE} -o out", "random"),
        ("synthesize model --random 2 --bound nan -o out", "bound"),
        (f"synthesize model --random 2 --seed {HUGE}{HUGE}{HUGE} -o out", "seed"),
        ("synthesize model --weights 2=nan -o out.ply", "weight"),
        ("synthesize model --weights 2=1e300 -o out.ply", "weight"),
        ("synthesize model --weights 2=1e400 -o out.ply", "weight"),
        (f"synthesize model --weights {'9' * 5000}=1 -o out.ply", "component"),
        ("synthesize model --weights ²=1 -o out.ply", "component"),
        ("synthesize model --weights 2=1 --from ² -o out.ply", "²"),
        (f"synthesize model --weights 2=1 --from {'9' * 5000} -o out.ply", "shape"),
        (f"interpolate model 0 reference -o out --steps {HUGE}", "steps"),
        (f"components model -o out --turntable {HUGE}", "turntable"),
        (f"name model {HUGE}=nod -o named", "component"),
        (f"name model 1={'x' * 100_000} -o named", "component 1"),
        ("name model 1=\x1b[31mred -o named", "component 1"),
        ("name model 1=\udcff -o named", "component 1"),
        (f"evaluate walk.npz -o out --splits {HUGE}", "splits"),
        (f"evaluate walk.npz -o out --seeds {HUGE}", "seeds"),
        (f"evaluate walk.npz -o out --processes {HUGE}", "processes"),
        (f"evaluate walk.npz -o out --counts 5,{HUGE}", "counts"),
        (f"evaluate walk.npz -o out --counts {'9' * 5000}", "counts"),
        ("evaluate walk.npz -o out --components 1.5", "components"),
        ("evaluate walk.npz -o out --components 0", "components"),
        (f"evaluate walk.npz -o out --epochs {HUGE}", "epochs"),
        ("fit model f.json -o out --smoothness nan", "smoothness"),
        ("fit model f.json -o out --smoothness inf", "smoothness"),
        ("fit model f.json -o out --smoothness 1e300", "smoothness"),
        ("fit model f.json -o out --device cpu:foo", "device"),
        ("fit model f.json -o out --backend foo", "backend"),
    ],
)
def test_absurd_options_are_refused_in_one_line(refuse, folder, command, words):
    before = sorted(path.name for path in folder.iterdir())
    told = refuse(*command.split(" "))
    assert words in told and len(told) < 500
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names of files")
def test_names_of_files_that_are_no_text_are_written_and_read(run, folder):
    name = os.fsdecode(b"model-\xff")
    (folder / "model").rename(folder / name)
    handles = os.fsdecode(b"h\xfe.json")
    (folder / "h.json").rename(folder / handles)
    status, out, err = run("fit", name, handles, "-o", os.fsdecode(b"out\xff.ply"), "--json")
    assert status == 0, err
    assert json.loads(out)["output"] == os.fsdecode(b"out\xff.ply")
    for json_flag in ((), ("--json",)):
        status, _, err = run("info", name, *json_flag)
        assert status == 0, err
    status, _, err = run("fit", "model", handles, "-o", "out.ply")
    assert status == 2 and "Traceback" not in err
    deformer.io.write_json(folder / "a.json", {"name": name})
    assert deformer.io.read_json(folder / "a.json") == {"name": name}


def test_a_result_beyond_memory_is_refused_before_it_is_computed(refuse, folder, monkeypatch):
    monkeypatch.setattr("deformer.checks._memory", lambda: 1e6)
    rows = [[{"vertex": 0, "position": [0, 0, 0]}]] * 1000
    (folder / "f.json").write_text(json.dumps({"frames": rows}))
    told = refuse("fit", "model", "f.json", "-o", "out.glb")
    assert "out.glb: 1000 shapes of" in told and "write .npz, .mdd, .pc2 or a directory" in told
    assert "fit: 1 handles" in refuse(
        "fit", "model", "f.json", "-o", "out.npz", "--memory", "500MB"
    )
    assert "count: 500 shapes" in refuse("synthesize", "model", "--random", "500", "-o", "out")
    assert "500 shapes" in refuse("synthesize", "model", "--sweep", "2=0:1:500", "-o", "out")
    told = refuse("interpolate", "model", "0", "reference", "--steps", "500", "-o", "out")
    assert "steps: 500 shapes" in told
    assert "training: 50 components" in refuse("train", "walk.npz", "-o", "m", "--memory", "600MB")


def test_memory_that_runs_out_is_one_line(refuse, folder, monkeypatch):
    def fails(*_):
        np.empty(2**50)

    monkeypatch.setattr("deformer.load_model", fails)
    assert "not enough memory" in refuse("info", "model")
