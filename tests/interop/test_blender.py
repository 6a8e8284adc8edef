"""What Blender has of the files that are written: positions, faces, names, materials, bones."""

import numpy as np
import pytest

import deformer
import scenes
import tubes
from deformer.documents import rooted_glb
from rigs import two_bones
from shapes import small_model
from upright import upright

TOLERANCE = 1e-5


def assert_near(found, expected, tolerance=TOLERANCE):
    diagonal = np.linalg.norm(np.ptp(expected.reshape(-1, 3), axis=0))
    assert found.shape == expected.shape
    assert np.abs(found - expected).max() <= tolerance * diagonal


@pytest.fixture
def tube(tmp_path):
    """The OBJ file of a tube and its document; a pose of it."""
    (tmp_path / "tube.obj").write_bytes(tubes.obj())
    (tmp_path / "tube.mtl").write_text(tubes.LIBRARY)
    document = deformer.load_document(tmp_path / "tube.obj")
    assert document is not None
    return document, tubes.positions(0.8)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
def test_a_posed_document(tube, suffix, tmp_path, blender):
    document, pose = tube
    path = tmp_path / f"posed{suffix}"
    path.write_bytes(document.write(pose, suffix))
    mesh = blender(path)
    expected = pose if suffix == ".ply" else upright(pose)
    if suffix == ".glb":
        # Its vertices are split where their attributes differ.
        distance = np.linalg.norm(mesh.vertices[0][:, None] - expected, axis=2)
        assert distance.min(axis=1).max() < TOLERANCE * 2.5
        assert distance.min(axis=0).max() < TOLERANCE * 2.5
        assert set(mesh.mesh["materials"]) == {"skin", "steel"}
        assert len(mesh.mesh["uv"]) == 1
    else:
        assert_near(mesh.vertices[0], expected)
        assert sorted(mesh.mesh["faces"]) == [4] * 32 + [8] * 2
    if suffix == ".obj":
        assert mesh.mesh["materials"] == ["skin", "steel"]
        (uv,) = mesh.mesh["uv"].values()
        # Each quad spans an eighth of the way around, and a quarter of the way along.
        spans = np.ptp(np.array(uv[: 4 * 32]).reshape(32, 4, 2), axis=1)
        np.testing.assert_allclose(spans, [[1 / 8, 1 / 4]] * 32, atol=1e-4)


def test_a_rig_plays_as_it_poses(tmp_path, blender, three, validated):
    rig = deformer.rig(small_model(), bones=6)
    rig.save(tmp_path / "rig.glb", fps=24.0)
    validated(tmp_path / "rig.glb")
    frames = [0, 2, len(rig.clip) - 1]
    poses = rig.pose(rig.clip[frames])
    assert_near(three(tmp_path / "rig.glb", [frame / 24 for frame in frames]), poses)
    found = blender(tmp_path / "rig.glb", frames)
    assert_near(found.vertices, upright(poses))
    assert set(rig.names) <= set(found.mesh["bones"])
    assert set(found.mesh["groups"]) == set(rig.names)


@pytest.mark.parametrize("source", ["obj", "scene"])
def test_a_rig_has_what_its_document_has(source, tube, tmp_path, blender, three, validated):
    document, _ = tube
    if source == "scene":
        (tmp_path / "scene.glb").write_bytes(scenes.shown_twice().data)
        document = deformer.load_document(tmp_path / "scene.glb")
        mesh = deformer.load_mesh(tmp_path / "scene.glb")
    else:
        mesh = deformer.load_mesh(tmp_path / "tube.obj")
    rig, path = two_bones(mesh), tmp_path / "rig.glb"
    rig.save(path, fps=24.0, like=document)
    validated(path)
    frames = range(len(rig.clip))
    _, owners = rooted_glb(document, mesh.vertices)
    poses = rig.pose(rig.clip)[:, owners]
    # In three.js each material of an object has all of its vertices.
    played = three(path, [frame / 24 for frame in frames])
    assert_near(played, np.concatenate([poses] * (played.shape[1] // len(owners)), axis=1))
    found = blender(path, frames)
    # Blender numbers the vertices material by material, so their ways over all frames are compared.
    ways = [np.concatenate(list(each), axis=1) for each in (found.vertices, upright(poses))]
    distance = np.linalg.norm(ways[0][:, None] - ways[1], axis=2)
    assert len(ways[0]) == len(ways[1])
    assert max(distance.min(axis=0).max(), distance.min(axis=1).max()) < TOLERANCE
    for facts in found.facts["meshes"]:
        assert set(rig.names) == set(facts["bones"]) == set(facts["groups"])
        assert facts["custom_normals"] and len(facts["uv"]) == len(facts["colours"]) == 1
    names = {facts["name"]: facts["materials"] for facts in found.facts["meshes"]}
    shown = {"Body": ["skin"], "Twin": ["skin"]}
    assert names == (shown if source == "scene" else {"Tube": ["skin", "steel"]})
    (tmp_path / "still.glb").write_bytes(document.write(mesh.vertices, ".glb"))
    still = blender(tmp_path / "still.glb")
    assert found.facts["empties"] == still.facts["empties"]
    for facts, before in zip(found.facts["meshes"], still.facts["meshes"], strict=True):
        assert facts["polygon_materials"] == before["polygon_materials"]
        # Triangles of a node that mirrors them have their corners in the opposite order.
        (uv,), (expected,) = facts["uv"].values(), before["uv"].values()
        assert [sorted(uv[n : n + 3]) for n in range(0, len(uv), 3)] == [
            sorted(expected[n : n + 3]) for n in range(0, len(uv), 3)
        ]


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
def test_a_bare_mesh(suffix, tmp_path, blender, validated):
    mesh = small_model().reference
    path = tmp_path / f"bare{suffix}"
    deformer.save_mesh(path, mesh)
    found = blender(path).vertices[0]
    assert_near(found, mesh.vertices if suffix == ".ply" else upright(mesh.vertices))
    if suffix == ".glb":
        validated(path)
