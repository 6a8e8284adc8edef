"""The document of a model: kept with it, checked on loading, and refused for other meshes."""

import json
from dataclasses import replace

import numpy as np
import pytest

from deformer import Document, InputError, Mesh, io, load_model, save_mesh, save_names, train
from deformer.model.storage import _digest_of_description
from shapes import sequence, small_model

COLOURS = {"red": (1.0, 0.0, 0.0, 0.5)}


def document(suffix=".obj"):
    reference = small_model().reference
    data = io.mesh_bytes(reference, suffix)
    if suffix == ".obj":
        data = b"# by hand\nusemtl red\n" + data
    count = len(reference.vertices)
    return Document(suffix, data, "walk 01", count, reference.faces, COLOURS)


@pytest.fixture
def saved(tmp_path):
    replace(small_model(), document=document()).save(tmp_path / "model")
    return tmp_path / "model"


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
def test_it_is_kept_with_the_model(tmp_path, suffix):
    given = document(suffix)
    replace(small_model(), document=given).save(tmp_path / "model")
    model = load_model(tmp_path / "model")
    found = model.document
    assert found is not None
    assert (found.suffix, found.data, found.name) == (suffix, given.data, "walk 01")
    assert found.colours == COLOURS
    assert model.fingerprint == small_model().fingerprint
    files = {entry.name for entry in (tmp_path / "model").iterdir()}
    assert files == {
        "model.json", "reference.ply", "weights.safetensors", f"document{suffix}"}  # fmt: skip


def test_naming_components_keeps_it_and_saving_without_removes_it(saved):
    assert save_names(saved, {0: "nod"}).document is not None
    model = load_model(saved)
    assert model.document is not None and model.component_names == {0: "nod"}
    replace(model, document=None).save(saved)
    assert load_model(saved).document is None
    assert not (saved / "document.obj").exists()


def test_altered_and_missing_ones_are_refused(saved):
    data = (saved / "document.obj").read_bytes()
    (saved / "document.obj").write_bytes(data + b"# more\n")
    with pytest.raises(InputError, match=r"document\.obj: altered since the model was saved"):
        load_model(saved)
    (saved / "document.obj").unlink()
    with pytest.raises(InputError, match=r"document\.obj: missing"):
        load_model(saved)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("file", "../other/document.obj"),
        ("file", "reference.ply"),
        ("name", 3),
        ("colours", {"red": [2, 0, 0, 1]}),
        ("colours", {"red": [0, 0, 1]}),
        ("more", 1),
    ],
)
def test_damaged_descriptions_are_refused(saved, key, value):
    path = saved / "model.json"
    description = json.loads(path.read_text())
    description["document"][key] = value
    description["sha256"]["model.json"] = _digest_of_description(description)
    io.write_json(path, description)
    with pytest.raises(InputError, match=r"model\.json: document"):
        load_model(saved)


def test_meshes_are_written_like_it(saved, tmp_path):
    model = load_model(saved)
    mesh = Mesh(model.reference.vertices + 1, model.reference.faces)
    save_mesh(tmp_path / "a.obj", mesh, like=model)
    assert (tmp_path / "a.obj").read_bytes() == document().write(mesh.vertices)
    assert (tmp_path / "a.obj").read_bytes().startswith(b"# by hand\nusemtl red\n")
    save_mesh(tmp_path / "b.obj", mesh, like=replace(model, document=None))
    assert (tmp_path / "b.obj").read_bytes() == io.mesh_bytes(mesh, ".obj")


def test_one_of_another_mesh_is_refused():
    shapes = sequence(3)
    other = document()
    other = replace(other, faces=other.faces[::-1])
    with pytest.raises(InputError, match=r"document walk 01\.obj"):
        replace(small_model(), document=other)
    with pytest.raises(InputError, match=r"document walk 01\.obj"):
        train(shapes, 2, document=other)
    with pytest.raises(InputError, match="document: expected a Document"):
        train(shapes, 2, document="walk.obj")  # pyright: ignore
    np.testing.assert_array_equal(shapes.faces, document().faces)
