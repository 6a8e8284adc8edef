"""What a dropped file or folder is taken for."""

import json

import pytest

import deformer
from deformer import InputError
from deformer_app.viewer.dropped import kind_of
from deformer_app.viewer.session import ModelName, Session
from shapes import sequence, small_model


def test_models_and_shapes_and_meshes(tmp_path):
    small_model().save(tmp_path / "model")
    shapes = sequence(3)
    deformer.save_shapes(tmp_path / "walk", shapes)
    deformer.save_shapes(tmp_path / "walk.npz", shapes)
    assert kind_of(tmp_path / "model") == "model"
    assert kind_of(tmp_path / "walk") == "shapes"
    assert kind_of(tmp_path / "walk.npz") == "shapes"
    assert {kind_of(path) for path in (tmp_path / "walk").glob("*.ply")} == {"mesh"}


def test_json_files_are_told_apart_by_what_they_hold(tmp_path):
    Session.begin(ModelName("tube", "x"), [0.0]).save(tmp_path / "session.json")
    (tmp_path / "handles.json").write_text(json.dumps({"handles": []}))
    (tmp_path / "frames.json").write_text(json.dumps({"frames": []}))
    (tmp_path / "other.json").write_text("{}")
    assert kind_of(tmp_path / "session.json") == "session"
    assert kind_of(tmp_path / "handles.json") == kind_of(tmp_path / "frames.json") == "handles"
    with pytest.raises(InputError, match=r"other\.json: expected a session or handles"):
        kind_of(tmp_path / "other.json")


def test_any_other_ending_is_told(tmp_path):
    file = tmp_path / "letter.odt"
    file.write_text("x")
    with pytest.raises(InputError, match=r"letter\.odt.*another ending"):
        kind_of(file)
