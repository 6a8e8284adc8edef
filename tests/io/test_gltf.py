"""glTF files with morph targets, animations and skins give the shapes that a viewer would show."""

import json
import logging

import numpy as np
import pytest

from deformer import io
from deformer.errors import InputError
from gltf_files import FACES, TETRAHEDRON, GltfFile, channel, skinned, with_targets

POINTS = TETRAHEDRON.astype(float)


def load(folder, file, name="a.glb", **options):
    (folder / name).write_bytes(file.glb() if name.endswith("b") else file.gltf())
    return io.load_shapes(folder / name, **options)


def refusal(function, *arguments, **options):
    with pytest.raises(InputError) as caught:
        function(*arguments, **options)
    message = str(caught.value)
    assert "\n" not in message
    return message


def turned(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


# Morph targets


@pytest.mark.parametrize("name", ["a.glb", "a.gltf"])
def test_targets_are_shapes_with_names(tmp_path, name):
    file, up, wide = with_targets()
    shapes = load(tmp_path, file, name)
    assert shapes.names == ("base", "up", "wide")
    np.testing.assert_array_equal(shapes.vertices, [POINTS, POINTS + up, POINTS + wide])
    np.testing.assert_array_equal(shapes.faces, FACES)


def test_targets_of_one_name_move_together(tmp_path):
    file, up, wide = with_targets(second=True)
    shapes = load(tmp_path, file)
    assert shapes.names == ("base", "up", "wide", "target 1")
    there = POINTS + np.array([10, 0, 0])
    np.testing.assert_array_equal(shapes.vertices[0], [*POINTS, *there])
    np.testing.assert_array_equal(shapes.vertices[1], [*(POINTS + up), *there])
    np.testing.assert_array_equal(shapes.vertices[2], [*(POINTS + wide), *(there + 2 * wide)])
    np.testing.assert_array_equal(shapes.vertices[3], shapes.vertices[0])


def test_names_that_are_missing_or_come_twice_are_told_apart(tmp_path):
    for given, expected in (
        (None, ("target 0", "target 1")),
        (["a"], ("target 0", "target 1")),
        (["a", "a"], ("a", "a (2)")),
        ([3, "\ud800"], ("target 0", "?")),
    ):
        file, _, _ = with_targets()
        file.json["meshes"][0]["extras"] = {"targetNames": given}
        assert load(tmp_path, file).names == ("base", *expected)


@pytest.mark.parametrize("weights", [[0, 0], [1, 1], [1, 0], [0, 1]])
def test_default_weights_that_show_no_new_shape_give_none(tmp_path, weights, caplog):
    """All off; all on, as Blender makes keys; one on, which is there already."""
    file, _, _ = with_targets()
    file.json["meshes"][0]["weights"] = weights
    with caplog.at_level(logging.WARNING, "deformer"):
        assert load(tmp_path, file).names == ("base", "up", "wide")
    assert not caplog.records


@pytest.mark.parametrize("owner", ["nodes", "meshes"])
def test_default_weights_give_one_more_shape(tmp_path, owner, caplog):
    file, up, wide = with_targets()
    file.json[owner][0]["weights"] = [0.5, 2]
    with caplog.at_level(logging.WARNING, "deformer"):
        shapes = load(tmp_path, file)
    assert shapes.names == ("base", "up", "wide", "default")
    np.testing.assert_array_equal(shapes.vertices[0], POINTS)
    np.testing.assert_array_equal(shapes.vertices[3], POINTS + 0.5 * up + 2 * wide)
    assert "default weights" in caplog.text
    np.testing.assert_array_equal(io.load_mesh(tmp_path / "a.glb").vertices, shapes.vertices[3])


@pytest.mark.parametrize("normalised", [False, True])
def test_quantised_positions_and_targets_are_exact(tmp_path, normalised):
    file = GltfFile(
        nodes=[{"mesh": 0, "scale": [0.5, 0.25, 2]}], extensionsUsed=["KHR_mesh_quantization"]
    )
    rng = np.random.default_rng(0)
    points, offsets = rng.integers(-32768, 32768, (2, 4, 3)).astype("i2")
    stored = np.zeros((2, 4, 4), "i2")
    stored[..., :3] = points, offsets
    numbers = []
    for rows in stored:
        view = file.view(rows.tobytes())
        file.json["bufferViews"][view]["byteStride"] = 8
        numbers.append(file.describe(points, bufferView=view, normalized=normalised))
    corners = file.add(FACES.astype("u1").ravel())
    primitive = {"attributes": {"POSITION": numbers[0]}, "indices": corners}
    primitive["targets"] = [{"POSITION": numbers[1]}]
    file.json["meshes"] = [{"primitives": [primitive]}]
    shapes = load(tmp_path, file)
    decoded = [
        np.maximum(a / 32767, -1) if normalised else a.astype(float) for a in (points, offsets)
    ]
    scale = np.array([0.5, 0.25, 2])
    np.testing.assert_array_equal(shapes.vertices[0], decoded[0] * scale)
    np.testing.assert_array_equal(shapes.vertices[1], (decoded[0] + decoded[1]) * scale)


def test_sparse_positions_change_a_base_or_zeros(tmp_path):
    moved = TETRAHEDRON.copy()
    moved[2] = 7, 8, 9
    for base in (None, TETRAHEDRON):
        file = GltfFile(nodes=[{"mesh": 0}])
        primitive = file.primitive()
        primitive["attributes"]["POSITION"] = file.sparse(moved, base)
        file.json["meshes"] = [{"primitives": [primitive]}]
        np.testing.assert_array_equal(load(tmp_path, file).vertices[0], moved)


def test_a_folder_has_one_shape_a_file_as_it_is_shown(tmp_path, caplog):
    for n, weights in enumerate(([0, 0], [1, 0])):
        file, up, _ = with_targets()
        file.json["nodes"][0]["weights"] = weights
        (tmp_path / f"{n}.glb").write_bytes(file.glb())
    with caplog.at_level(logging.WARNING, "deformer"):
        shapes = io.load_shapes(tmp_path)
    assert shapes.names == ("0", "1")
    np.testing.assert_array_equal(shapes.vertices, [POINTS, POINTS + up])
    assert "morph targets" in caplog.text


# Animations


def test_weights_are_sampled_where_a_clip_is_named(tmp_path, caplog):
    file, up, wide = with_targets()
    animation = {"name": "talk"}
    channel(file, animation, 0, "weights", [0.5, 1], np.array([0, 1, 1, 0], "f4"))
    file.json["animations"] = [animation]
    with caplog.at_level(logging.WARNING, "deformer"):
        assert load(tmp_path, file).names == ("base", "up", "wide")
    assert "talk" in caplog.text
    for clip in ("talk", 0, "0"):
        shapes = load(tmp_path, file, fps=4, clip=clip)
        assert shapes.names == ("talk 0.5 s", "talk 0.75 s", "talk 1 s")
        expected = [POINTS + wide, POINTS + (up + wide) / 2, POINTS + up]
        np.testing.assert_allclose(shapes.vertices, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("interpolation", "half"),
    [("LINEAR", 45.0), ("STEP", 0.0)],
)
def test_turning_nodes_are_sampled(tmp_path, interpolation, half):
    file = GltfFile(nodes=[{"children": [1], "scale": [2, 2, 2]}, {"mesh": 0}])
    file.json["meshes"] = [{"primitives": [file.primitive()]}]
    animation = {}
    ends = np.array([[0, 0, 0, 1], [0, 0, -np.sqrt(0.5), -np.sqrt(0.5)]], "f4")
    channel(file, animation, 1, "rotation", [0, 1], ends, interpolation)
    file.json["animations"] = [animation]
    shapes = load(tmp_path, file, fps=2)
    assert shapes.names == ("clip 0 0 s", "clip 0 0.5 s", "clip 0 1 s")
    for vertices, degrees in zip(shapes.vertices, (0, half, 90), strict=True):
        np.testing.assert_allclose(vertices, 2 * POINTS @ turned(degrees).T, atol=1e-6)


def test_cubic_splines_meet_their_keys_and_tangents(tmp_path):
    """x(t) = t³ − 2t over two seconds is a cubic, which its keys and tangents give exactly."""
    file = GltfFile(nodes=[{"mesh": 0}])
    file.json["meshes"] = [{"primitives": [file.primitive()]}]
    animation, keys = {}, np.array([0, 2])
    values = np.zeros((2, 3, 3))
    values[:, 0, 0] = values[:, 2, 0] = 3 * keys**2 - 2
    values[:, 1, 0] = keys**3 - 2 * keys
    channel(file, animation, 0, "translation", keys, values.reshape(-1, 3).astype("f4"),
            "CUBICSPLINE")  # fmt: skip
    file.json["animations"] = [animation]
    shapes = load(tmp_path, file, fps=10)
    times = np.arange(21) / 10
    np.testing.assert_allclose(shapes.vertices[:, 0, 0], times**3 - 2 * times, atol=1e-6)


def test_skins_blend_their_joints(tmp_path):
    shapes = load(tmp_path, skinned(), fps=2)
    assert shapes.names == ("bend 0 s", "bend 0.5 s", "bend 1 s")
    np.testing.assert_allclose(shapes.vertices[0], POINTS, atol=1e-6)
    for vertices, degrees in zip(shapes.vertices, (0, 45, 90), strict=True):
        by_joint = (POINTS - [1, 0, 0]) @ turned(degrees).T + [1, 0, 0]
        expected = np.array([POINTS[0], by_joint[1], POINTS[2], (POINTS[3] + by_joint[3]) / 2])
        np.testing.assert_allclose(vertices, expected, atol=1e-6)
    np.testing.assert_allclose(io.load_mesh(tmp_path / "a.glb").vertices, POINTS, atol=1e-6)


def test_normalised_weights_of_a_skin_sum_to_one(tmp_path):
    file = skinned()
    weights = np.array([[255, 0, 0, 0], [254, 0, 0, 0], [0, 0, 0, 0], [127, 127, 0, 0]], "u1")
    primitive = file.json["meshes"][0]["primitives"][0]
    primitive["attributes"]["WEIGHTS_0"] = file.add(weights, normalized=True)
    np.testing.assert_allclose(load(tmp_path, file).vertices[0], POINTS, atol=1e-6)


def test_clips_that_move_no_mesh_are_left_out(tmp_path):
    file = skinned()
    file.json["nodes"].append({"name": "camera"})
    file.json["scenes"][0]["nodes"].append(3)
    still = {"name": "fly"}
    channel(file, still, 3, "translation", [0, 1], np.zeros((2, 3), "f4"))
    file.json["animations"].insert(0, still)
    assert load(tmp_path, file, fps=2).names[0] == "bend 0 s"
    message = refusal(load, tmp_path, file, clip="fly")
    assert "'fly' moves no mesh" in message and "bend" in message
    assert "'bend'" in refusal(load, tmp_path, file, clip="walk")
    file.json["animations"] = [still]
    assert load(tmp_path, file).names == ("a",)


def test_clips_are_refused_where_there_can_be_none(tmp_path):
    file, _, _ = with_targets()
    assert "the file has none" in refusal(load, tmp_path, file, clip=0)
    io.save_mesh(tmp_path / "a.ply", io.load_mesh(tmp_path / "a.glb"))
    assert "no animation" in refusal(io.load_shapes, tmp_path / "a.ply", clip="walk")
    assert "20000 frames" in refusal(load, tmp_path, skinned(), fps=1e5)
    for fps in (0, -1, np.nan, "x"):
        assert "fps" in refusal(load, tmp_path, skinned(), fps=fps)


# Where vertices come from


def test_ranges_say_where_vertices_come_from(tmp_path):
    file, _, _ = with_targets(second=True)
    (tmp_path / "a.glb").write_bytes(file.glb())
    scene = io.GltfScene(io.read_gltf(tmp_path / "a.glb"))
    first, second = scene.ranges
    assert (first.start, first.count, first.node, first.mesh, first.primitives) == (
        0,
        4,
        0,
        0,
        (0,),
    )
    assert (second.start, second.count, second.node, second.mesh) == (4, 4, 1, 1)
    assert (first.accessor, first.skin) == (0, None)
    assert len(first.targets) == 2 and second.targets[1] is None
    np.testing.assert_array_equal(second.transform[:3, 3], [10, 0, 0])
    (tmp_path / "b.glb").write_bytes(skinned().glb())
    (moved,) = io.GltfScene(io.read_gltf(tmp_path / "b.glb")).ranges
    assert moved.skin == 0
    np.testing.assert_allclose(moved.transform, np.tile(np.eye(4), (4, 1, 1)), atol=1e-6)


# Files beside the file


def external(folder, uri="a%20b.bin"):
    file, _, _ = with_targets()
    (folder / "a b.bin").write_bytes(file.binary)
    (folder / "a.gltf").write_bytes(file.gltf(uri))
    return folder / "a.gltf"


def test_buffers_in_files_are_read(tmp_path):
    assert len(io.load_shapes(external(tmp_path))) == 3


@pytest.mark.parametrize(
    ("uri", "part"),
    [
        ("gone.bin", "missing"),
        ("../a.bin", "not a file in its folder"),
        ("%2e%2e/a.bin", "not a file in its folder"),
        ("/etc/passwd", "not a file in its folder"),
        ("link.bin", "not a file in its folder"),
        ("file:///etc/passwd", "not a file in its folder"),
        ("C:\\a.bin", "not a file in its folder"),
        ("a\0.bin", "not a file in its folder"),
        ("data:application/octet-stream;base64,@@@@", "no base64"),
        ("data:text/plain,hello", "no base64"),
        ("folder", "is a directory"),
    ],
)
def test_buffers_that_are_not_there_are_refused(tmp_path, uri, part):
    inside = tmp_path / "inside"
    (inside / "folder").mkdir(parents=True)
    (tmp_path / "a.bin").write_bytes(b"secret")
    (inside / "link.bin").symlink_to(tmp_path / "a.bin")
    assert part in refusal(io.load_shapes, external(inside, uri))


def test_a_packed_file_has_all_inside(tmp_path):
    path = external(tmp_path)
    scene = json.loads(path.read_bytes())
    (tmp_path / "skin.png").write_bytes(b"\x89PNG and so on")
    gone = ["/home/somebody/gone.jpg", r"C:\Users\somebody\away.jpg"]
    scene["images"] = [{"uri": uri} for uri in ("skin.png", *gone, "skin.png")]
    path.write_text(json.dumps(scene))
    (tmp_path / "packed").mkdir()
    packed = tmp_path / "packed" / "a.glb"
    packed.write_bytes(io.packed_gltf(path))
    asset = io.read_gltf(packed)
    first, *missing, again = asset.json["images"]
    assert first == again and first["mimeType"] == "image/png"
    view = asset.json["bufferViews"][first["bufferView"]]
    data = asset.buffer(0, "the test")[view["byteOffset"] :][: view["byteLength"]]
    assert data == b"\x89PNG and so on"
    assert missing == [{"uri": "gone.jpg"}, {"uri": "away.jpg"}]
    assert b"somebody" not in packed.read_bytes()
    ours, theirs = io.load_shapes(packed), io.load_shapes(path)
    np.testing.assert_array_equal(ours.vertices, theirs.vertices)
    assert ours.names == theirs.names
    repacked = io.packed_gltf(packed)
    assert len(repacked) == len(packed.read_bytes())


# Refusals


def change_target(file, **changes):
    number = file.json["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]
    file.json["accessors"][number].update(changes)


def attributes_of(file):
    return file.json["meshes"][0]["primitives"][0]["attributes"]


def change_sampler(file, **changes):
    file.json["animations"][0]["samplers"][0].update(changes)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda f: f.json.update(extensionsRequired=["KHR_draco_mesh_compression"]), "Draco"),
        (lambda f: f.json.update(extensionsRequired=["EXT_meshopt_compression"]), "meshopt"),
        (lambda f: f.json.update(extensionsRequired=["ACME_voxels"]), "ACME_voxels"),
        (lambda f: f.json["nodes"][0].update(weights=[1]), "2 numbers"),
        (lambda f: f.json["nodes"][0].update(weights=["a", "b"]), "2 numbers"),
        (lambda f: f.json["meshes"][0]["primitives"][0].update(targets=[3]), "target 0"),
        (lambda f: change_target(f, count=5), "5 vertices"),
        (lambda f: change_target(f, count=10**12), "1000000000000 items"),
        (lambda f: change_target(f, sparse={"count": 1}), "type None"),
        (lambda f: change_target(f, sparse={"count": 9}), "9 sparse items of 4"),
        (lambda f: change_target(f, sparse=3), "sparse 3"),
    ],
)
def test_targets_that_are_damaged_are_refused(tmp_path, change, part):
    file, _, _ = with_targets()
    change(file)
    assert part in refusal(load, tmp_path, file)


def test_sparse_indices_beyond_the_vertices_are_refused(tmp_path):
    file, _, _ = with_targets()
    number = file.json["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]
    bad = file.view(np.array([4], "u2").tobytes())
    file.json["accessors"][number]["sparse"]["indices"]["bufferView"] = bad
    assert "sparse index 4" in refusal(load, tmp_path, file)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda f: f.json["nodes"][0].update(skin=3), "skins"),
        (lambda f: f.json["skins"][0].update(joints=[1, 7]), "joint 7"),
        (lambda f: f.json["skins"][0].update(joints=[]), "no joints"),
        (lambda f: f.json["skins"][0].update(joints=[1]), "joint 1 of 1"),
        (lambda f: f.json["skins"][0].update(joints=[1, 2, 2]), "2 inverse bind matrices"),
        (lambda f: attributes_of(f).pop("JOINTS_0"), "JOINTS_0"),
        (lambda f: attributes_of(f).pop("WEIGHTS_0"), "accessors"),
        (lambda f: change_sampler(f, interpolation="SMOOTH"), "SMOOTH"),
        (lambda f: change_sampler(f, input=f.add(np.array([1, 0], "f4"))), "do not grow"),
        (lambda f: change_sampler(f, input=f.add(np.array([0, 1e30], "f4"))), "at most"),
        (lambda f: change_sampler(f, input=f.add(np.array([0, np.nan], "f4"))), "not finite"),
        (lambda f: change_sampler(f, output=f.add(np.ones((3, 4), "f4"))), "3 values"),
        (lambda f: change_sampler(f, output=f.add(np.zeros((2, 4), "f4"))), "unit quaternion"),
        (lambda f: f.json["animations"][0]["channels"][0].update(sampler=7), "sampler 7"),
        (lambda f: f.json["animations"][0].update(channels=[3]), "channel 0"),
        (lambda f: f.json["nodes"][2].update(matrix=np.eye(4).ravel().tolist()), "matrix"),
        (lambda f: f.json["animations"][0].update(
            channels=2 * f.json["animations"][0]["channels"]), "second time"),
    ],
)  # fmt: skip
def test_skins_and_clips_that_are_damaged_are_refused(tmp_path, change, part):
    file = skinned()
    change(file)
    assert part in refusal(load, tmp_path, file, clip="bend")


def test_targets_that_would_fill_the_memory_are_refused(tmp_path, monkeypatch):
    file, _, _ = with_targets()
    targets = file.json["meshes"][0]["primitives"][0]["targets"]
    zeros = file.describe(TETRAHEDRON)
    targets += [{"POSITION": zeros}] * 5000
    file.json["meshes"][0].pop("extras")
    assert len(load(tmp_path, file)) == 5003
    monkeypatch.setattr("deformer.io.sampling._MOST_BYTES", 100_000)
    monkeypatch.setattr("deformer.io.sampling._MOST_GROWN", 1)
    assert "5003 morph targets" in refusal(load, tmp_path, file)
    targets += [{"POSITION": zeros}] * 5000
    assert "10002 targets" in refusal(load, tmp_path, file)


# Copies


def test_a_copy_of_one_file_of_several_shapes_is_one_npz(tmp_path):
    file, _, _ = with_targets()
    (tmp_path / "face.glb").write_bytes(file.glb())
    shapes = io.load_shapes(tmp_path / "face.glb")
    target = tmp_path / "copy"
    written = io.save_copy(
        tmp_path / "face.glb", target, shapes, changed=[1], kept=np.arange(4), faces_changed=False
    )
    assert written == ("face.npz",)
    again = io.load_shapes(io.copied_path(tmp_path / "face.glb", target, len(shapes)))
    np.testing.assert_array_equal(again.vertices, shapes.vertices)
