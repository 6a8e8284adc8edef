"""GLB files with morph-target clips, read back; what the document has stays."""

import json

import numpy as np
import pytest

import scenes
import tubes
from deformer import (
    InputError,
    MeshSequence,
    io,
    load_document,
    load_mesh,
    load_shapes,
    save_shapes,
)
from foreign import unmarked


def description(path):
    """The JSON of a GLB file."""
    data = path.read_bytes()
    return json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])


def moved(mesh, count=12):
    """Shapes that turn about y and wander; the first one is the mesh."""
    found = []
    for t in np.linspace(0, 1, count):
        s, c = np.sin(t), np.cos(t)
        found.append(mesh.vertices @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) + [t, 0, t * t])
    return MeshSequence(np.stack(found), mesh.faces)


def size_of(shapes):
    return np.linalg.norm(np.ptp(shapes.vertices[0], axis=0))


KINDS = ("plain", "interleaved", "quantised", "sparse", "deformed", "shown_twice")


@pytest.fixture(params=KINDS)
def glb(request, tmp_path):
    path = tmp_path / f"{request.param}.glb"
    path.write_bytes(getattr(scenes, request.param)().data)
    return path


def test_a_clip_of_a_glb_document_gives_the_shapes_back(glb, tmp_path):
    shapes = moved(load_mesh(glb))
    saved = save_shapes(tmp_path / "walk.glb", shapes, like=glb, fps=30)
    back = load_shapes(tmp_path / "walk.glb", clip="walk", fps=30)
    far = np.linalg.norm(back.vertices - shapes.vertices, axis=2).max() / size_of(shapes)
    assert saved.error is not None and far < saved.error + 1e-5 < 1e-3
    np.testing.assert_array_equal(back.faces, shapes.faces)
    assert saved.targets is not None and saved.targets < 8 and saved.principal
    assert saved.files == (tmp_path / "walk.glb",)
    # At rest the file shows the first shape.
    still = load_mesh(tmp_path / "walk.glb").vertices
    np.testing.assert_allclose(still, shapes.vertices[0], atol=1e-5)


def test_what_a_glb_document_has_stays(glb, tmp_path):
    save_shapes(tmp_path / "walk.glb", moved(load_mesh(glb)), like=glb)
    old, new = description(glb), description(tmp_path / "walk.glb")
    for key in ("materials", "textures", "images", "cameras", "scenes"):
        assert len(new[key]) == len(old[key])
    assert new["materials"] == old["materials"]
    assert [n.get("name") for n in new["nodes"]] == [n.get("name") for n in old["nodes"]]
    assert new["nodes"][0] == old["nodes"][0]
    assert new["nodes"][1]["extras"] == {"id": 7} and "skin" not in new["nodes"][1]
    mesh = new["meshes"][new["nodes"][1]["mesh"]]
    assert mesh["extras"]["by"] == "hand"
    assert mesh["extras"]["targetNames"][0] == "principal 1" and "up" not in mesh["extras"]
    attributes = mesh["primitives"][0]["attributes"]
    assert {"POSITION", "NORMAL", "TEXCOORD_0"} <= set(attributes)
    # An animation of the camera has stayed after the clip; those of the mesh are gone.
    paths = [[c["target"]["path"] for c in a["channels"]] for a in new["animations"]]
    assert set(paths[0]) == {"weights"}
    assert paths[1:] == ([["scale"]] if "animations" in old else [])


def test_the_first_shape_may_be_as_the_document_shows_it(tmp_path):
    path = tmp_path / "deformed.glb"
    path.write_bytes(scenes.deformed().data)
    shapes = moved(load_mesh(path))
    save_shapes(tmp_path / "still.glb", shapes.subset([0, 0]), like=path)
    found = description(tmp_path / "still.glb")
    assert "targets" not in found["meshes"][0]["primitives"][0] and "skins" not in found
    np.testing.assert_allclose(
        load_mesh(tmp_path / "still.glb").vertices, shapes.vertices[0], atol=1e-5
    )


@pytest.mark.parametrize("name", ["tube.obj", "tube.ply"])
def test_other_documents_have_their_materials_and_names_in_a_clip(tmp_path, name):
    (tmp_path / "tube.mtl").write_text(tubes.LIBRARY)
    path = tmp_path / name
    path.write_bytes(tubes.obj() if name == "tube.obj" else tubes.ply("<"))
    shapes = moved(load_mesh(path))
    saved = save_shapes(tmp_path / "walk.glb", shapes, like=path, name="stroll")
    back = load_shapes(tmp_path / "walk.glb", clip="stroll")
    bound = saved.error * size_of(shapes) + 1e-5
    # Vertices are split at the seam: each is where one of the document's is, in every frame.
    for frame, shape in zip(back.vertices, shapes.vertices, strict=True):
        apart = np.linalg.norm(frame[:, None] - shape[None], axis=2)
        assert apart.min(axis=1).max() < bound and apart.min(axis=0).max() < bound
    first = np.linalg.norm(back.vertices[0][:, None] - shapes.vertices[0][None], axis=2)
    owners = first.argmin(axis=1)
    far = np.linalg.norm(back.vertices - shapes.vertices[:, owners], axis=2)
    assert far.max() < bound
    new = description(tmp_path / "walk.glb")
    if name == "tube.obj":
        assert [m["name"] for m in new["materials"]] == ["skin", "steel"]
        assert new["meshes"][0]["name"] == "Tube" and len(owners) > len(shapes.vertices[0])
    assert "TEXCOORD_0" in new["meshes"][0]["primitives"][0]["attributes"]


def test_meshes_that_do_not_move_have_no_targets(tmp_path):
    path = tmp_path / "two.glb"
    path.write_bytes(scenes.shown_twice().data)
    mesh = load_mesh(path)
    shapes = np.repeat(mesh.vertices[None], 5, axis=0)
    half = len(mesh.vertices) // 2
    shapes[:, half:, 1] += np.linspace(0, 1, 5)[:, None]
    save_shapes(tmp_path / "walk.glb", MeshSequence(shapes, mesh.faces), like=path)
    new = description(tmp_path / "walk.glb")
    with_targets = ["targets" in new["meshes"][n["mesh"]]["primitives"][0]
                    for n in new["nodes"] if "mesh" in n]  # fmt: skip
    assert sorted(with_targets) == [False, True]
    back = load_shapes(tmp_path / "walk.glb", clip=0).vertices
    np.testing.assert_allclose(back, shapes, atol=1e-5)


def test_a_clip_without_a_document_has_positions_alone(tmp_path):
    mesh = io.load_mesh(_obj(tmp_path))
    shapes = moved(mesh)
    saved = save_shapes(tmp_path / "walk.glb", shapes, tolerance=1e-6)
    back = load_shapes(tmp_path / "walk.glb", clip="walk")
    np.testing.assert_allclose(back.vertices, shapes.vertices, atol=1e-5)
    assert saved.error < 5e-6
    assert back.names[6] == "walk 0.25 s"
    # The frames are the shapes of the file; the targets are none by themselves.
    np.testing.assert_array_equal(load_shapes(tmp_path / "walk.glb").vertices, back.vertices)
    assert load_shapes(unmarked(tmp_path / "walk.glb")).names[1] == "principal 1"


def test_shapes_without_anything_in_common_are_targets_and_that_is_told(tmp_path):
    mesh = load_mesh(_obj(tmp_path))
    noise = np.random.default_rng(0).normal(size=(4, *mesh.vertices.shape))
    shapes = MeshSequence(mesh.vertices + noise, mesh.faces, ("a", "b", "c", "d"))
    saved = save_shapes(tmp_path / "walk.glb", shapes)
    assert saved.targets == 3 and not saved.principal
    assert load_shapes(tmp_path / "walk.glb").names == ("base", "b", "c", "d")


def test_a_clip_of_shapes_that_stand_still_is_a_mesh(tmp_path):
    mesh = load_mesh(_obj(tmp_path))
    still = MeshSequence(np.repeat(mesh.vertices[None], 3, axis=0), mesh.faces)
    saved = save_shapes(tmp_path / "walk.glb", still)
    assert saved.targets == 0 and saved.error == 0
    assert len(load_shapes(tmp_path / "walk.glb")) == 1


def _obj(folder):
    path = folder / "tube.obj"
    path.write_bytes(tubes.obj())
    return path


def test_a_document_of_another_mesh_is_refused(tmp_path):
    found = load_document(_obj(tmp_path))
    other = MeshSequence(np.zeros((2, 3, 3)), [[0, 1, 2]])
    with pytest.raises(InputError, match=r"document tube.obj: 40 vertices"):
        save_shapes(tmp_path / "walk.glb", other, like=found)
    assert not (tmp_path / "walk.glb").exists()
