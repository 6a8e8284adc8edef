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
    with pytest.raises(InputError, match=r"other\.json: expected .* a session, handles.*none of"):
        kind_of(tmp_path / "other.json")
    (tmp_path / "damaged.json").write_text('{"handles": [')
    with pytest.raises(InputError, match=r"damaged\.json, line 1: not JSON"):
        kind_of(tmp_path / "damaged.json")


def test_what_the_window_does_not_open_is_told_as_what_it_is(tmp_path):
    (tmp_path / "split.json").write_text('{"train": [0], "test": []}')
    with pytest.raises(InputError, match=r"split\.json: is a split .*; give it to --split"):
        kind_of(tmp_path / "split.json")
    (tmp_path / "view.png").write_bytes(b"x")
    assert kind_of(tmp_path / "view.png") == "picture"
    small_model().save(tmp_path / "model")
    with pytest.raises(InputError, match=r"model\.json: is a file of a model; drop its folder"):
        kind_of(tmp_path / "model" / "model.json")


def test_any_other_ending_is_told(tmp_path):
    file = tmp_path / "letter.odt"
    file.write_text("x")
    with pytest.raises(InputError, match=r"letter\.odt: expected a model.*none of these"):
        kind_of(file)
