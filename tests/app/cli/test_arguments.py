"""Outputs that are inputs are refused by every command, before any work."""

import pytest

import deformer
from bars import bending_bar


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory with a model, shapes, and files that commands read."""
    model = deformer.load_model("flag")
    model.save(tmp_path / "model")
    shapes = bending_bar()
    deformer.save_shapes(tmp_path / "walk", shapes)
    deformer.save_shapes(tmp_path / "walk.npz", shapes)
    deformer.save_mesh(tmp_path / "pose.ply", shapes.mesh(0))
    (tmp_path / "frames.npz").write_text('{"frames": [[{"vertex": 0, "position": [0, 0, 0]}]]}')
    (tmp_path / "code.json").write_text("{}")
    (tmp_path / "link").symlink_to("model")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    "command",
    [
        "train walk -o walk",
        "train walk -o ./walk/",
        "train walk.npz -o walk.npz",
        "train walk --split code.json -o code.json",
        "fit model frames.npz -o frames.npz",
        "fit model frames.npz -o model",
        "fit model frames.npz -o model/poses.npz",
        "fit model code.json -o model/reference.ply",
        "fit link code.json -o model/pose.ply",
        "fit model code.json -o link/pose.ply",
        "demo --model model -o model",
        "components model -o model/components",
        "name model 3=nod -o model/named",
        "synthesize model --weights 2=1 --from pose.ply -o pose.ply",
        "synthesize humanoid --onto model --weights 2=1 -o model/pose.ply",
        "interpolate model pose.ply reference -o model",
        "encode model pose.ply -o pose.ply",
        "encode model pose.ply -o model/code.json",
    ],
)
def test_an_output_that_is_an_input_is_refused(refuse, folder, command):
    before = contents(folder)
    told = refuse(*command.split())
    assert "is also the input" in told or "is inside" in told
    assert contents(folder) == before


def test_an_output_beside_the_inputs_is_not(run, folder):
    handles = folder / "handles.json"
    handles.write_text('{"handles": [{"vertex": 0, "position": [0, 0, 0]}]}')
    status, _, err = run("fit", "model", "handles.json", "-o", "out.ply")
    assert status == 0, err
