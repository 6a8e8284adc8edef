"""What commands write keeps what the examples' file has beside positions and triangles."""

import json
import re

import numpy as np
import pytest

import deformer
import scenes
import tubes
from deformer import io
from deformer.documents.obj import ObjFile

VECTORS = re.compile(rb"^v[ \t]|^vn[ \t]")
OTHERS = [line for line in tubes.obj().split(b"\n") if not VECTORS.match(line)]


def others(path):
    return [line for line in path.read_bytes().split(b"\n") if not VECTORS.match(line)]


@pytest.fixture(scope="module")
def model_path(tmp_path_factory):
    """A model of bent tubes."""
    folder = tmp_path_factory.mktemp("walk")
    for n in range(5):
        (folder / f"{n}.obj").write_bytes(tubes.obj(n / 4))
    (folder / "tube.mtl").write_text(tubes.LIBRARY)
    shapes = deformer.load_shapes(folder)
    document = deformer.load_document(folder)
    model = deformer.train(shapes, 2, epochs=20, document=document, device="cpu")
    model.save(folder / "model")
    return folder / "model"


@pytest.fixture
def handles_path(tmp_path):
    end = tubes.positions(0.6)[-1].tolist()
    handles = [{"vertex": 39, "position": end}]
    (tmp_path / "handles.json").write_text(json.dumps({"handles": handles}))
    return tmp_path / "handles.json"


def test_train_keeps_the_first_file(run_json, model_path, tmp_path):
    shapes = model_path.parent
    options = ("--components", 2, "--epochs", 2)
    found = run_json("train", shapes, "-o", tmp_path / "model", *options)
    assert found["document"] == "0.obj"
    document = deformer.load_model(tmp_path / "model").document
    assert document is not None
    assert document.data == tubes.obj()
    assert str(shapes) not in (tmp_path / "model" / "model.json").read_text()
    deformer.save_shapes(tmp_path / "s.npz", deformer.load_shapes(shapes))
    found = run_json("train", tmp_path / "s.npz", "-o", tmp_path / "other", *options)
    assert found["document"] is None


def test_fit_writes_like_it(run_json, model_path, handles_path, tmp_path):
    out = tmp_path / "pose.obj"
    run_json("fit", model_path, handles_path, "-o", out)
    assert others(out) == OTHERS
    pose = deformer.load_mesh(out)
    np.testing.assert_allclose(pose.vertices[39], tubes.positions(0.6)[-1], atol=0.05)
    run_json("fit", model_path, handles_path, "-o", out, "--bare")
    assert out.read_bytes() == io.mesh_bytes(pose, ".obj")
    run_json("fit", model_path, handles_path, "-o", tmp_path / "pose.glb")
    materials = io.read_gltf(tmp_path / "pose.glb").json["materials"]
    assert [material["name"] for material in materials] == ["skin", "steel"]


def test_synthesize_and_encode_write_like_it(run_json, model_path, tmp_path):
    out = tmp_path / "new.obj"
    run_json("synthesize", model_path, "--weights", "0=0.5", "-o", out)
    assert others(out) == OTHERS
    run_json("synthesize", model_path, "--weights", "0=0.5", "-o", tmp_path / "b.obj", "--bare")
    assert b"usemtl" not in (tmp_path / "b.obj").read_bytes()
    run_json("encode", model_path, out, "-o", tmp_path / "again.obj")
    assert others(tmp_path / "again.obj") == OTHERS
    run_json("encode", model_path, out, "-o", tmp_path / "c.obj", "--bare")
    assert b"usemtl" not in (tmp_path / "c.obj").read_bytes()


@pytest.mark.slow
def test_components_have_its_format(run_json, model_path, tmp_path):
    folder = tmp_path / "components"
    run_json("components", model_path, "-o", folder, "--top", 1, "--turntable", 0)
    (file,) = folder.glob("component-*.obj")
    assert others(file) == OTHERS
    run_json("components", model_path, "-o", folder, "--top", 1, "--turntable", 0, "--bare")
    assert [file.suffix for file in folder.glob("component-*.[!p]*")] == []
    (file,) = folder.glob("component-*.ply")
    assert (
        deformer.load_mesh(file).faces.shape
        == deformer.load_model(model_path).reference.faces.shape
    )


def test_a_split_seam_of_a_glb_stays_closed_and_smooth(tmp_path, run_json):
    folder = tmp_path / "walk"
    folder.mkdir()
    for n in range(5):
        (folder / f"{n}.glb").write_bytes(scenes.plain(n / 4).data)
    shapes = deformer.load_shapes(folder)
    document = deformer.load_document(folder)
    model = deformer.train(shapes, 2, epochs=20, document=document, device="cpu")
    model.save(tmp_path / "model")
    out = tmp_path / "pose.glb"
    run_json("synthesize", tmp_path / "model", "--weights", "0=0.7", "-o", out)
    found = io.GltfAsset(out.read_bytes(), "a test")
    attributes = found.json["meshes"][0]["primitives"][0]["attributes"]
    for name in ("POSITION", "NORMAL"):
        rows = found.floats(attributes[name], "VEC3", {5126: "<f4"}, name)
        grid = rows.reshape(tubes.RINGS, scenes.COLUMNS, 3)
        np.testing.assert_array_equal(grid[:, 0], grid[:, -1])
    assert scenes.image() in out.read_bytes()


def test_an_obj_of_a_glb_has_its_texture_coordinates(tmp_path):
    (tmp_path / "a.glb").write_bytes(scenes.plain().data)
    mesh = deformer.load_mesh(tmp_path / "a.glb")
    deformer.save_mesh(tmp_path / "a.obj", mesh, like=tmp_path / "a.glb")
    assert ObjFile((tmp_path / "a.obj").read_bytes()).polygons({}).uvs is not None
