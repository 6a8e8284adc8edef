"""Files that Blender exports, learned from, posed, and brought back into Blender."""

import numpy as np
import pytest

import deformer

TOLERANCE = 1e-5
# Coordinates of Blender, whose z axis points up, in files whose y axis does.
UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


@pytest.fixture
def true(exported):
    """Positions that Blender had when it exported, by name."""
    return dict(np.load(exported / "positions.npz"))


def assert_same_places(found, expected):
    """Vertices that a format has split lie at those of the mesh, and none is missing."""
    diagonal = np.linalg.norm(np.ptp(expected.reshape(-1, 3), axis=0))
    for shape, other in zip(found, expected, strict=True):
        apart = np.linalg.norm(shape[:, None] - other, axis=2)
        assert apart.min(axis=1).max() < TOLERANCE * diagonal
        assert apart.min(axis=0).max() < TOLERANCE * diagonal


def test_shape_keys_are_shapes(exported, true, caplog):
    shapes = deformer.load_shapes(exported / "keys.glb")
    assert list(shapes.names) == ["base", "bend", "flat"]
    assert_same_places(shapes.vertices[1:] @ UP, true["keys"])
    assert not caplog.records
    assert deformer.load_document(exported / "keys.glb") is not None
    assert not caplog.records  # a document has nothing to say of its targets


def test_a_skin_that_moves_is_shapes(exported, true):
    shapes = deformer.load_shapes(exported / "skin.glb", fps=24)
    assert len(shapes) == 13
    assert_same_places(shapes.vertices @ UP, true["frames"])


def test_time_samples_are_shapes(exported, true):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    shapes = deformer.load_shapes(exported / "walk.usdc", fps=24)
    found = shapes.vertices
    # Blender writes USD with its own axes.
    np.testing.assert_allclose(found, true["frames"], atol=TOLERANCE)


def test_a_folder_of_files_is_shapes(exported, true):
    shapes = deformer.load_shapes(exported / "frames")
    np.testing.assert_allclose(shapes.vertices @ UP, true["frames"], atol=TOLERANCE)


@pytest.mark.parametrize("source", ["skin.glb", "frames"])
def test_a_pose_drops_back_into_the_scene(exported, source, blender, validated, tmp_path):
    path = exported / source
    shapes, document = deformer.load_shapes(path), deformer.load_document(path)
    model = deformer.train(shapes, 4, epochs=10, document=document)
    vertices = [0, len(shapes.vertices[0]) - 1, 20]
    solver = deformer.HandleSolver(model)
    solver.set_handles(vertices, shapes.vertices[9][vertices], hard=True)
    pose = solver.solve()
    suffix = ".glb" if source == "skin.glb" else ".obj"
    mesh = deformer.Mesh(pose.vertices, model.reference.faces)
    deformer.save_mesh(tmp_path / f"pose{suffix}", mesh, like=model)
    if suffix == ".glb":
        validated(tmp_path / "pose.glb")
    found = blender(tmp_path / f"pose{suffix}")
    assert_same_places(found.vertices, (pose.vertices @ UP)[None])
    own = blender(path if suffix == ".glb" else path / "0000.obj")
    for key in ("uv", "materials", "polygon_materials", "faces"):
        assert found.mesh[key] == own.mesh[key]
    assert found.mesh["name"].split(".")[0] == own.mesh["name"].split(".")[0]


def test_a_pose_drops_back_into_the_usd_stage(exported, true, blender, tmp_path):
    pytest.importorskip("pxr")
    path = exported / "walk.usdc"
    shapes, document = deformer.load_shapes(path), deformer.load_document(path)
    assert document is not None and document.up == "z"
    model = deformer.train(shapes, 4, epochs=10, document=document)
    pose = shapes.mesh(9)
    deformer.save_mesh(tmp_path / "pose.usdc", pose, like=model)
    deformer.save_shapes(tmp_path / "walk.usda", shapes, like=model)
    own, frames = blender(path), [0, 5, 12]
    found, played = blender(tmp_path / "pose.usdc", [0, 9]), blender(tmp_path / "walk.usda", frames)
    # The skeleton is there and moves nothing.
    np.testing.assert_allclose(found.vertices, true["frames"][[9, 9]], atol=TOLERANCE)
    np.testing.assert_allclose(played.vertices, true["frames"][frames], atol=TOLERANCE)
    for each in (found, played):
        for key in ("uv", "materials", "polygon_materials", "faces", "name", "custom_normals"):
            assert each.mesh[key] == own.mesh[key]
        assert each.mesh["groups"] == []


def test_a_rig_takes_the_place_of_the_own_one(exported, blender, three, validated, tmp_path):
    path = exported / "skin.glb"
    shapes, document = deformer.load_shapes(path), deformer.load_document(path)
    model = deformer.train(shapes, 4, epochs=10, document=document)
    rig = deformer.rig(model, 3)
    rig.save(tmp_path / "rig.glb", like=model)
    validated(tmp_path / "rig.glb")
    frames = [0, 5, len(rig.clip) - 1]
    poses = rig.pose(rig.clip[frames])
    found, own = blender(tmp_path / "rig.glb", frames), blender(path)
    diagonal = np.linalg.norm(np.ptp(poses[0], axis=0))
    played = three(tmp_path / "rig.glb", [frame / 24 for frame in frames])
    for vertices, expected in ((found.vertices, poses @ UP), (played, poses)):
        np.testing.assert_allclose(vertices, expected, atol=TOLERANCE * diagonal)
    for key in ("uv", "materials", "polygon_materials", "faces", "name"):
        assert found.mesh[key] == own.mesh[key]
    assert set(found.mesh["groups"]) == set(found.mesh["bones"]) == set(rig.names)
    assert found.facts["empties"] == [] and len(found.facts["actions"]) == 1
