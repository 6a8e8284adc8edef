"""GLB files of this program, read by it, give what was written, whichever axis is up."""

import json
import logging
from dataclasses import replace

import numpy as np
import pytest

import deformer
import tubes
from deformer import Mesh, MeshSequence, io, load_mesh, load_shapes, save_mesh, save_shapes
from foreign import as_other_programs_read, unmarked
from rigs import two_bones
from shapes import small_model

# Axes of a y-up file that shows data with z up.
Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def model_of(up):
    return replace(small_model(), summary={"up": up})


def motion(model, frames=12):
    path = np.linspace(model.codes[8], model.codes[3], frames)
    return MeshSequence([model.decode(z) for z in path], model.reference.faces)


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_pose(up, tmp_path):
    """The axis is the model's, without a word of the caller's."""
    model = model_of(up)
    shape = motion(model).vertices[4]
    save_mesh(tmp_path / "pose.glb", Mesh(shape, model.reference.faces), like=model)
    np.testing.assert_allclose(load_mesh(tmp_path / "pose.glb").vertices, shape, atol=1e-6)
    np.testing.assert_allclose(load_shapes(tmp_path / "pose.glb").vertices[0], shape, atol=1e-6)
    shown = shape @ Y_UP if up == "z" else shape
    other = as_other_programs_read(tmp_path / "pose.glb")[0]
    np.testing.assert_allclose(other, shown, atol=1e-6)


@pytest.mark.parametrize("fps", [24.0, 30.0])
@pytest.mark.parametrize("up", ["y", "z"])
def test_a_clip(up, fps, tmp_path):
    """Its frames, one for one: the principal shapes of its morph targets are no shapes."""
    model = model_of(up)
    shapes = motion(model)
    saved = save_shapes(tmp_path / "a.glb", shapes, like=model, fps=fps, tolerance=1e-5)
    assert saved.principal
    for options in ({}, {"clip": "a"}, {"clip": 0, "fps": fps}):
        found = load_shapes(tmp_path / "a.glb", **options)
        assert found.vertices.shape == shapes.vertices.shape
        np.testing.assert_allclose(found.vertices, shapes.vertices, atol=1e-4)
    other = as_other_programs_read(tmp_path / "a.glb", clip=0, fps=fps)
    shown = shapes.vertices @ Y_UP if up == "z" else shapes.vertices
    np.testing.assert_allclose(other, shown, atol=1e-4)
    assert load_shapes(unmarked(tmp_path / "a.glb")).names[1].startswith("principal")


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_directory(up, tmp_path):
    model = model_of(up)
    shapes = motion(model, 3)
    save_shapes(tmp_path / "out", shapes, "glb", like=model)
    np.testing.assert_allclose(load_shapes(tmp_path / "out").vertices, shapes.vertices, atol=1e-6)
    other = as_other_programs_read(tmp_path / "out" / "0001.glb")[0]
    shown = shapes.vertices[1] @ Y_UP if up == "z" else shapes.vertices[1]
    np.testing.assert_allclose(other, shown, atol=1e-6)


def test_a_file_of_data_with_z_up_is_a_document_of_data_with_z_up(tmp_path):
    """Written into, it stands upright and is read as it was written; so does a rig like it."""
    model = model_of("z")
    shapes = motion(model, 6)
    save_shapes(tmp_path / "a.glb", shapes, like=model, tolerance=1e-5)
    document = deformer.load_document(tmp_path / "a.glb")
    assert document is not None and document.up == "z"
    pose = Mesh(shapes.vertices[3], shapes.faces)
    save_mesh(tmp_path / "b.glb", pose, like=document)
    np.testing.assert_allclose(load_mesh(tmp_path / "b.glb").vertices, pose.vertices, atol=1e-6)
    other = as_other_programs_read(tmp_path / "b.glb")[0]
    np.testing.assert_allclose(other, pose.vertices @ Y_UP, atol=1e-6)
    rig = two_bones(model.reference)
    rig.save(tmp_path / "rig.glb", like=document)
    bare = tmp_path / "bare.glb"
    rig.save(bare)
    expected = load_shapes(bare).vertices
    own = load_shapes(tmp_path / "rig.glb").vertices
    np.testing.assert_allclose(own, expected, atol=1e-5)
    other = as_other_programs_read(tmp_path / "rig.glb")
    np.testing.assert_allclose(other, expected @ Y_UP, atol=1e-5)


def test_a_node_that_another_program_has_turned_is_read_as_it_shows(tmp_path):
    model = model_of("z")
    shape = model.reference.vertices
    save_mesh(tmp_path / "a.glb", model.reference, like=model)
    data = (tmp_path / "a.glb").read_bytes()
    size = int.from_bytes(data[12:16], "little")
    scene = json.loads(data[20 : 20 + size])
    node = next(n for n in scene["nodes"] if n.get("name") == "z up")
    node["rotation"] = [0.0, 0.0, 0.0, 1.0]
    node["translation"] = [0.0, 2.0, 0.0]
    changed = io.glb_of(json.dumps(scene).encode(), data[28 + size :])
    (tmp_path / "a.glb").write_bytes(changed)
    found = load_mesh(tmp_path / "a.glb").vertices
    np.testing.assert_allclose(found, shape + np.array([0, 2, 0]), atol=1e-6)


@pytest.mark.parametrize("extras", [3, [], {"deformer": 3}, {"deformer": {"data_up": ["z"]}}])
def test_extras_of_others_are_no_marks(extras, tmp_path):
    mesh = Mesh(tubes.positions(), [[0, 1, 2]])
    save_mesh(tmp_path / "a.glb", mesh, up="z")
    expected = as_other_programs_read(tmp_path / "a.glb")
    data = (tmp_path / "a.glb").read_bytes()
    size = int.from_bytes(data[12:16], "little")
    scene = json.loads(data[20 : 20 + size])
    for node in scene["nodes"]:
        node["extras"] = extras
    (tmp_path / "a.glb").write_bytes(io.glb_of(json.dumps(scene).encode(), data[28 + size :]))
    np.testing.assert_array_equal(load_shapes(tmp_path / "a.glb").vertices, expected)


def test_a_mesh_that_is_turned_from_the_other_shapes_gets_a_line(tmp_path, caplog):
    model = model_of("z")
    save_mesh(tmp_path / "pose.glb", Mesh(motion(model).vertices[4], model.reference.faces), model)
    with caplog.at_level(logging.WARNING, "deformer"):
        load_mesh(tmp_path / "pose.glb", like=model.reference)
        assert not caplog.records
        load_mesh(unmarked(tmp_path / "pose.glb"), like=model.reference)
    assert len(caplog.records) == 1
    assert "x, -z, y in place of x, y, z" in caplog.text and "unmarked-pose.glb" in caplog.text
