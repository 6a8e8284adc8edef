"""GLB documents: positions, normals and tangents change, and the rest of the scene stays."""

import copy

import numpy as np
import pytest

import scenes
import tubes
from deformer import InputError, Mesh, io, load_document, load_mesh, load_shapes
from deformer.documents.glb_polygons import glb_polygons
from deformer.documents.obj import ObjFile

KINDS = ["plain", "interleaved", "quantised", "sparse", "deformed", "shown_twice"]
FLOAT = {5126: "<f4"}


def document(tmp_path, content, name="tube.glb"):
    (tmp_path / name).write_bytes(content)
    found = load_document(tmp_path / name)
    assert found is not None
    return found


def asset_of(data):
    return io.GltfAsset(data, "a test")


def posed(tmp_path):
    own = load_mesh(tmp_path / "tube.glb").vertices
    return own + 0.3 * np.sin(own[:, [1, 2, 0]])


def attribute(data, name, shape="VEC3"):
    asset = asset_of(data)
    number = asset.json["meshes"][0]["primitives"][0]["attributes"][name]
    return asset.floats(number, shape, FLOAT, name)


@pytest.mark.parametrize("kind", KINDS)
def test_positions_change_and_the_scene_stays(tmp_path, kind):
    content = getattr(scenes, kind)().data
    found = document(tmp_path, content)
    goal = posed(tmp_path)
    written = found.write(goal)
    (tmp_path / "pose.glb").write_bytes(written)
    mesh = load_mesh(tmp_path / "pose.glb")
    size = 1000 if kind == "quantised" else 1
    np.testing.assert_allclose(mesh.vertices, goal, atol=2e-6 * size)
    np.testing.assert_array_equal(mesh.faces, found.faces)
    old, new = asset_of(content).json, asset_of(written).json
    same = ("asset", "scene", "scenes", "cameras", "materials", "textures")
    assert {key: new[key] for key in same} == {key: old[key] for key in same}
    for n, node in enumerate(old["nodes"]):
        for key, value in node.items():
            assert key in ("mesh", "skin") or new["nodes"][n][key] == value
    assert new["meshes"][0]["name"] == "Tube"
    assert new["meshes"][0]["extras"] == {"by": "hand"}


@pytest.mark.parametrize("kind", KINDS)
def test_all_other_arrays_and_images_keep_their_bytes(tmp_path, kind):
    content = getattr(scenes, kind)().data
    written = document(tmp_path, content).write(posed(tmp_path))
    old, new = asset_of(content), asset_of(written)

    def picture(asset):
        view = asset.json["bufferViews"][asset.json["images"][0]["bufferView"]]
        first = view.get("byteOffset", 0)
        return asset.buffer(0, "a test")[first : first + view["byteLength"]]

    assert picture(new) == picture(old) == scenes.image()
    before = old.json["meshes"][0]["primitives"][0]["attributes"]
    after = new.json["meshes"][0]["primitives"][0]["attributes"]
    for name, shape in (("TEXCOORD_0", "VEC2"), ("COLOR_0", "VEC3")):
        if name in before:
            types = {5126: "<f4", 5123: "<u2"}
            np.testing.assert_array_equal(
                new.array(after[name], shape, types, name),
                old.array(before[name], shape, types, name),
            )


@pytest.mark.parametrize("kind", KINDS)
def test_the_own_positions_give_the_own_bytes(tmp_path, kind):
    content = getattr(scenes, kind)().data
    found = document(tmp_path, content)
    assert found.write(load_mesh(tmp_path / "tube.glb").vertices) == content


def test_arrays_of_single_precision_are_written_over(tmp_path):
    content = scenes.plain().data
    written = document(tmp_path, content).write(posed(tmp_path))
    old, new = asset_of(content), asset_of(written)
    assert new.json["bufferViews"] == old.json["bufferViews"]
    positions = new.json["accessors"][0]
    rows = attribute(written, "POSITION").astype("f4")
    assert positions["min"] == rows.min(axis=0).tolist()
    assert positions["max"] == rows.max(axis=0).tolist()


def test_a_pose_of_another_pose_takes_no_more_room(tmp_path):
    for kind in KINDS:
        first = document(tmp_path, getattr(scenes, kind)().data).write(posed(tmp_path))
        again = document(tmp_path, first)
        assert abs(len(again.write(posed(tmp_path))) - len(first)) < 400


def test_normals_and_tangents_follow_in_the_space_of_the_node(tmp_path):
    content = scenes.plain().data
    found = document(tmp_path, content)
    world = io.GltfScene(asset_of(content)).ranges[0].transform
    bend = scenes.split(tubes.positions(1.0))
    written = found.write(bend @ world[:3, :3].T + world[:3, 3])
    np.testing.assert_allclose(attribute(written, "POSITION"), bend, atol=1e-6)
    turn = np.repeat(np.linspace(0, 1, tubes.RINGS), scenes.COLUMNS)
    c, s = np.cos(turn), np.sin(turn)
    inner = slice(scenes.COLUMNS, -scenes.COLUMNS)
    normals = attribute(written, "NORMAL")
    x, y, z = scenes.split(tubes.side_normals()).T
    expected = np.stack([c * x - s * y, s * x + c * y, z], 1)
    np.testing.assert_allclose(normals[inner], expected[inner], atol=0.05)
    # The first and the last column are the two sides of the seam.
    grid = normals.reshape(tubes.RINGS, scenes.COLUMNS, 3)
    np.testing.assert_array_equal(grid[:, 0], grid[:, -1])
    tangents = attribute(written, "TANGENT", "VEC4")
    np.testing.assert_allclose(tangents[inner, :3], np.stack([c, s, 0 * c], 1)[inner], atol=0.1)
    np.testing.assert_allclose((tangents[:, :3] * normals).sum(axis=1), 0, atol=1e-6)
    np.testing.assert_array_equal(tangents[:, 3], 1)


def test_what_would_deform_the_pose_again_is_removed(tmp_path):
    content = scenes.deformed().data
    written = document(tmp_path, content).write(posed(tmp_path))
    new = asset_of(written).json
    assert "skins" not in new
    assert "skin" not in new["nodes"][1]
    assert "weights" not in new["meshes"][0]
    primitive = new["meshes"][0]["primitives"][0]
    assert "targets" not in primitive
    assert set(primitive["attributes"]) == {
        "POSITION", "NORMAL", "TANGENT", "TEXCOORD_0", "COLOR_0"}  # fmt: skip
    # The camera's motion stays, and the second animation had nothing else.
    assert [(a["name"], len(a["channels"])) for a in new["animations"]] == [("walk", 1)]
    channel = new["animations"][0]["channels"][0]
    assert channel["target"] == {"node": 2, "path": "scale"}
    steps = new["animations"][0]["samplers"][channel["sampler"]]["output"]
    np.testing.assert_array_equal(
        asset_of(written).floats(steps, "VEC3", FLOAT, "a test"), [[0, 0, 0], [1, 1, 1]]
    )
    assert len(load_shapes(tmp_path / "tube.glb")) == 3
    assert len(written) < len(content)


def test_the_motion_of_the_bones_is_removed_with_the_skin(tmp_path):
    asset = scenes.deformed()
    turn = asset.add_array(np.array([[0.0, 0, 0, 1], [0, 0, 1, 0]]))
    walk, rise = asset.json["animations"]
    for clip in (walk, rise):
        clip["samplers"] = [*clip["samplers"], {"input": walk["samplers"][0]["input"],
                                                "output": turn}]  # fmt: skip
        clip["channels"].append({"sampler": 2, "target": {"node": 3, "path": "rotation"}})
    new = asset_of(document(tmp_path, asset.data).write(posed(tmp_path))).json
    targets = [c["target"]["node"] for a in new["animations"] for c in a["channels"]]
    assert targets == [2]


def test_two_nodes_of_one_mesh_get_a_pose_each(tmp_path):
    content = scenes.shown_twice().data
    written = document(tmp_path, content).write(posed(tmp_path))
    new = asset_of(written).json
    assert [node.get("mesh") for node in new["nodes"]] == [None, 0, None, 1]
    assert new["meshes"][0]["primitives"][0]["material"] == 0
    assert new["meshes"][1]["primitives"][0]["material"] == 0


def test_a_gltf_with_its_files_becomes_one_glb(tmp_path):
    asset = scenes.plain()
    description = copy.deepcopy(asset.json)
    description["buffers"] = [{"uri": "tube.bin", "byteLength": len(asset.binary)}]
    description["images"] = [{"uri": "checks.png"}]
    (tmp_path / "tube.bin").write_bytes(bytes(asset.binary))
    (tmp_path / "checks.png").write_bytes(scenes.image())
    io.write_json(tmp_path / "tube.gltf", description)
    found = load_document(tmp_path / "tube.gltf")
    assert found is not None
    assert (found.suffix, found.name) == (".glb", "tube")
    assert scenes.image() in found.data
    assert b"tube.bin" not in found.data
    mesh = load_mesh(tmp_path / "tube.gltf")
    (tmp_path / "pose.glb").write_bytes(found.write(mesh.vertices + 1))
    np.testing.assert_allclose(
        load_mesh(tmp_path / "pose.glb").vertices, mesh.vertices + 1, atol=1e-5
    )


def test_a_node_that_flattens_its_mesh_is_refused(tmp_path):
    asset = scenes.plain()
    asset.json["nodes"][1]["scale"] = [1.0, 0.0, 1.0]
    found = document(tmp_path, asset.data)
    with pytest.raises(InputError, match="node 1 of the document flattens"):
        found.write(load_mesh(tmp_path / "tube.glb").vertices + 1)


# Other formats


def test_an_obj_becomes_glb_with_materials_texture_coordinates_and_hard_edges(tmp_path):
    (tmp_path / "tube.mtl").write_text(tubes.LIBRARY)
    (tmp_path / "tube.obj").write_bytes(tubes.obj())
    found = load_document(tmp_path / "tube.obj")
    assert found is not None
    goal = tubes.positions(1.0)
    written = found.write(goal, ".glb")
    new = asset_of(written).json
    assert [node["name"] for node in new["nodes"]] == ["Tube"]
    assert [material["name"] for material in new["materials"]] == ["skin", "steel"]
    factors = [m["pbrMetallicRoughness"]["baseColorFactor"] for m in new["materials"]]
    assert factors == [[0.8, 0.5, 0.25, 0.5], [0.1, 0.2, 0.3, 1.0]]
    assert [p["material"] for p in new["meshes"][0]["primitives"]] == [0, 1]
    # The side's vertices, those of the seam twice, and those of the caps.
    assert new["accessors"][0]["count"] == tubes.RINGS * scenes.COLUMNS + 2 * tubes.AROUND
    (tmp_path / "pose.glb").write_bytes(written)
    mesh = load_mesh(tmp_path / "pose.glb")
    np.testing.assert_allclose(mesh.vertices[mesh.faces], goal[found.faces], atol=1e-6)
    own, other = ObjFile(found.data).polygons({}), glb_polygons(written)
    corners = own.corners_of(found.faces).ravel()
    assert own.uvs is not None and other.uvs is not None
    np.testing.assert_allclose(other.uvs, np.nan_to_num(own.uvs[corners]), atol=1e-6)
    assert own.colours is not None and other.colours is not None
    np.testing.assert_allclose(
        other.colours[other.corners], own.colours[own.corners[corners]], atol=1e-6
    )
    normals = attribute(written, "NORMAL")[mesh.faces.ravel()]
    np.testing.assert_allclose(normals, own.shading(goal)[own.normals][corners], atol=1e-6)


def test_a_glb_becomes_obj_in_the_world(tmp_path):
    found = document(tmp_path, scenes.plain().data)
    goal = posed(tmp_path)
    written = found.write(goal, ".obj")
    (tmp_path / "pose.obj").write_bytes(written)
    mesh = load_mesh(tmp_path / "pose.obj")
    np.testing.assert_array_equal(mesh.vertices, goal)
    np.testing.assert_array_equal(mesh.faces, found.faces)
    assert b"o Body\n" in written
    assert b"usemtl skin\n" in written
    new = ObjFile(written).polygons({})
    uv = scenes.tube_arrays()["TEXCOORD_0"] * (1, -1) + (0, 1)
    assert new.uvs is not None
    np.testing.assert_allclose(new.uvs, uv[mesh.faces.ravel()], atol=1e-6)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".off"])
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_becomes_every_format(tmp_path, kind, suffix):
    found = document(tmp_path, getattr(scenes, kind)().data)
    goal = posed(tmp_path)
    (tmp_path / f"pose{suffix}").write_bytes(found.write(goal, suffix))
    mesh = load_mesh(tmp_path / f"pose{suffix}")
    np.testing.assert_array_equal(mesh.vertices, goal)
    np.testing.assert_array_equal(mesh.faces, found.faces)


def test_concave_polygons_are_cut_as_the_reader_cuts_them(tmp_path):
    text = b"v 0 0 0\nv 2 0 0\nv 0.5 0.5 0\nv 0 2 0\nv 1 -1 0\nf 1 2 3 4\nf 5 2 1\n"
    (tmp_path / "dart.obj").write_bytes(text)
    found = load_document(tmp_path / "dart.obj")
    assert found is not None
    mesh = load_mesh(tmp_path / "dart.obj")
    (tmp_path / "dart.glb").write_bytes(found.write(mesh.vertices, ".glb"))
    back = load_mesh(tmp_path / "dart.glb")
    np.testing.assert_array_equal(back.vertices[back.faces], mesh.vertices[mesh.faces])
    assert io.mesh_bytes(Mesh(mesh.vertices, mesh.faces), ".glb") != found.data


def test_arrays_over_the_same_bytes_keep_theirs(tmp_path):
    """An attribute that reads the bytes of the positions has the old ones after a pose."""
    asset = scenes.plain()
    attributes = asset.json["meshes"][0]["primitives"][0]["attributes"]
    rest = {**asset.json["accessors"][attributes["POSITION"]]}
    attributes["_REST"] = asset.add("accessors", rest)
    found = document(tmp_path, asset.data)
    written = found.write(posed(tmp_path))
    np.testing.assert_array_equal(attribute(written, "_REST"), attribute(asset.data, "POSITION"))
    assert (attribute(written, "POSITION") != attribute(asset.data, "POSITION")).any()


def test_bytes_of_what_is_removed_stay_where_another_array_has_them(tmp_path):
    """A morph target over the bytes of the texture coordinates goes without them."""
    asset = scenes.deformed()
    primitive = asset.json["meshes"][0]["primitives"][0]
    target = asset.json["accessors"][primitive["targets"][0]["POSITION"]]
    uvs = asset.json["accessors"][primitive["attributes"]["TEXCOORD_0"]]
    view = {**asset.json["bufferViews"][uvs["bufferView"]]}
    target |= {"bufferView": asset.add("bufferViews", view), "count": uvs["count"]}
    view["byteLength"] = target["count"] * 12
    found = document(tmp_path, asset.data)
    written = found.write(posed(tmp_path))
    for name, shape in (("TEXCOORD_0", "VEC2"), ("COLOR_0", "VEC3")):
        np.testing.assert_array_equal(
            attribute(written, name, shape), attribute(asset.data, name, shape)
        )


def test_polygons_without_normals_among_others_are_flat(tmp_path):
    text = b"v 0 0 0\nv 1 0 0\nv 1 1 1\nv 0 1 0\nv 2 0 0\nv 2 1 0\nvn 0 0 1\n"
    text += b"f 1//1 2//1 4//1\nf 2 3 4\nf 2 5 6\n"
    (tmp_path / "some.obj").write_bytes(text)
    found = load_document(tmp_path / "some.obj")
    assert found is not None
    mesh = load_mesh(tmp_path / "some.obj")
    written = found.write(mesh.vertices, ".glb")
    (tmp_path / "some.glb").write_bytes(written)
    back = load_mesh(tmp_path / "some.glb")
    normals = attribute(written, "NORMAL")[back.faces]
    corners = back.vertices[back.faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, np.repeat(flat[:, None], 3, axis=1), atol=1e-6)


def broken_material(asset):
    asset.json["materials"] = [3]


def broken_texture(asset):
    asset.json["materials"][0]["normalTexture"] = "checks"


def broken_animation(asset):
    asset.json["animations"] = [{"channels": [{"sampler": 5, "target": {"node": 2}}]}]


@pytest.mark.parametrize("damage", [broken_material, broken_texture, broken_animation])
def test_damage_beside_the_mesh_is_told_in_one_line(tmp_path, damage):
    asset = scenes.plain()
    damage(asset)
    found = document(tmp_path, asset.data)
    with pytest.raises(InputError, match=r"document tube\.glb: damaged .*; write positions"):
        found.write(posed(tmp_path))
