"""Rigs with all that their mesh's file has: textures, materials, colours, normals, names."""

import numpy as np
import pytest

import deformer
import scenes
import tubes
from deformer import InputError, io
from foreign import as_other_programs_read
from rigs import two_bones

KINDS = ["plain", "interleaved", "quantised", "sparse", "deformed", "shown_twice"]
FLOATS = {5126: "<f4", 5121: "u1", 5123: "<u2", 5120: "i1", 5122: "<i2"}
# The nodes of `scenes` that show its mesh, which mirror it.
MIRROR = np.diag([1.0, -1, 1])
TURN = 2 * np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ MIRROR


def files(folder, name, content):
    """The path of a file, its mesh, and a rig of that."""
    path = folder / name
    path.write_bytes(content)
    mesh = deformer.load_mesh(path)
    return path, mesh, two_bones(mesh)


def asset_of(data):
    return io.GltfAsset(data, "a test")


def attribute(asset, name, shape, mesh=0):
    accessor = asset.json["meshes"][mesh]["primitives"][0]["attributes"][name]
    return asset.floats(accessor, shape, FLOATS, name)


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_plays_as_the_rig_poses_and_its_scene_stays(tmp_path, kind):
    path, mesh, rig = files(tmp_path, "tube.glb", getattr(scenes, kind)().data)
    rig.save(tmp_path / "rig.glb", fps=24, like=path)
    shapes = deformer.load_shapes(tmp_path / "rig.glb", fps=24)
    expected = rig.pose(rig.clip)
    assert shapes.vertices.shape == expected.shape
    assert abs(shapes.vertices - expected).max() < 1e-5 * mesh.bounding_diagonal
    np.testing.assert_array_equal(shapes.faces, mesh.faces)
    old, new = asset_of(path.read_bytes()), asset_of((tmp_path / "rig.glb").read_bytes())
    for key in ("materials", "textures", "cameras", "asset"):
        assert new.json[key] == old.json[key]
    assert picture(new) == picture(old) == scenes.image()
    uvs = attribute(old, "TEXCOORD_0", "VEC2")
    np.testing.assert_array_equal(attribute(new, "TEXCOORD_0", "VEC2"), uvs)
    skinned = [node for node in new.json["nodes"] if "skin" in node]
    assert skinned[0]["name"] == "Body" and skinned[0]["extras"] == {"id": 7}
    assert len(skinned) == (2 if kind == "shown_twice" else 1)
    roots = [new.json["nodes"][n] for n in new.json["scenes"][0]["nodes"]]
    for node in skinned:
        assert node in roots
        assert not {"matrix", "translation", "rotation", "scale"} & node.keys()
    # The camera is where it was, and nothing else is left.
    left = [node["name"] for node in new.json["nodes"] if "mesh" not in node]
    assert left == ["Root", "Eye", "near", "far"]
    eye = io.GltfScene(new).tree.world(2)
    np.testing.assert_array_equal(eye, io.GltfScene(old).tree.world(2))
    assert new.json["animations"][0]["name"] == "examples"


def picture(asset):
    view = asset.json["bufferViews"][asset.json["images"][0]["bufferView"]]
    start = view["byteOffset"]
    return bytes(asset.buffer(0, "a test")[start : start + view["byteLength"]])


def test_normals_and_tangents_are_those_of_the_world(tmp_path):
    path, _, rig = files(tmp_path, "tube.glb", scenes.plain().data)
    new, arrays = asset_of(rig.glb(like=path)), scenes.tube_arrays()
    # Orthogonal but for the scale, which is the same along all axes.
    normals, tangents = attribute(new, "NORMAL", "VEC3"), attribute(new, "TANGENT", "VEC4")
    np.testing.assert_allclose(normals, arrays["NORMAL"] @ TURN.T / 2, atol=1e-6)
    np.testing.assert_allclose(tangents[:, :3], arrays["TANGENT"][:, :3] @ TURN.T / 2, atol=1e-6)
    # A mirror turns the bitangent, n × t · w, against the normal and the tangent.
    np.testing.assert_array_equal(tangents[:, 3], -1)


def test_normals_follow_a_scale_that_differs_by_axis(tmp_path):
    asset = scenes.plain()
    asset.json["nodes"][1]["scale"] = [1.0, 1.0, 5.0]
    path, _, rig = files(tmp_path, "tube.glb", asset.data)
    normals = attribute(asset_of(rig.glb(like=path)), "NORMAL", "VEC3")
    expected = scenes.tube_arrays()["NORMAL"] @ np.diag([1, 1, 1 / 5]) @ (TURN @ MIRROR).T
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, expected, atol=1e-6)


@pytest.mark.parametrize("name", ["tube.obj", "tube.ply"])
def test_vertices_that_a_conversion_splits_keep_their_bones(tmp_path, name):
    content = tubes.obj() if name == "tube.obj" else tubes.ply("<")
    (tmp_path / "tube.mtl").write_text(tubes.LIBRARY)
    path, mesh, rig = files(tmp_path, name, content)
    rig.save(tmp_path / "rig.glb", fps=24, like=path)
    new = asset_of((tmp_path / "rig.glb").read_bytes())
    # Each vertex has its number as its colour's red.
    red = attribute(new, "COLOR_0", "VEC3")[:, 0]
    encoded = np.where(red <= 0.0031308, 12.92 * red, 1.055 * red ** (1 / 2.4) - 0.055)
    scale = 100 if name == "tube.obj" else 255
    owners = np.rint(encoded * scale).astype(int)
    assert len(owners) > len(mesh.vertices) or name == "tube.ply"
    assert set(owners) == set(range(len(mesh.vertices)))
    shapes = deformer.load_shapes(tmp_path / "rig.glb", fps=24)
    expected = rig.pose(rig.clip)[:, owners]
    assert abs(shapes.vertices - expected).max() < 1e-5 * mesh.bounding_diagonal
    np.testing.assert_array_equal(
        np.sort(owners[shapes.faces], axis=None), np.sort(mesh.faces, axis=None)
    )
    attributes = new.json["meshes"][0]["primitives"][0]["attributes"]
    assert {"TEXCOORD_0", "NORMAL", "JOINTS_0", "WEIGHTS_0"} <= attributes.keys()
    if name == "tube.obj":
        assert [m["name"] for m in new.json["materials"]] == ["skin", "steel"]
        assert new.json["nodes"][0]["name"] == "Tube"


def test_objects_of_a_file_share_one_skeleton(tmp_path):
    lines = tubes.obj().decode().replace("g caps", "o Caps").encode()
    path, _, rig = files(tmp_path, "tube.obj", lines)
    new = asset_of(rig.glb(like=path)).json
    assert [(n["name"], n["skin"]) for n in new["nodes"] if "mesh" in n] == [
        ("Tube", 0), ("Caps", 0)]  # fmt: skip
    assert len(new["skins"]) == 1


def test_an_obj_without_normals_is_smooth_and_a_glb_without_them_flat(tmp_path):
    (tmp_path / "tube.obj").write_bytes(tubes.obj())
    plain = io.mesh_bytes(deformer.load_mesh(tmp_path / "tube.obj"), ".obj")
    path, mesh, rig = files(tmp_path, "plain.obj", plain)
    normals = attribute(asset_of(rig.glb(like=path)), "NORMAL", "VEC3")
    expected = deformer.vertex_normals(mesh.vertices, mesh.faces)
    np.testing.assert_allclose(normals, expected, atol=1e-6)
    asset = scenes.plain()
    primitive = asset.json["meshes"][0]["primitives"][0]
    del primitive["attributes"]["NORMAL"], primitive["attributes"]["TANGENT"]
    path, _, rig = files(tmp_path, "flat.glb", asset.data)
    new = asset_of(rig.glb(like=path)).json
    assert "NORMAL" not in new["meshes"][0]["primitives"][0]["attributes"]


def test_what_hangs_on_a_mesh_stays_where_it_is(tmp_path):
    asset = scenes.shown_twice()
    lamp = asset.add("nodes", {"name": "Lamp", "translation": [1.0, 0, 0]})
    # The second tube on the first, with a lamp below each.
    asset.json["scenes"][0]["nodes"].remove(3)
    asset.json["nodes"][1]["children"] = [3]
    asset.json["nodes"][3]["children"] = [lamp]
    asset.add("scenes", {"nodes": [0]})
    asset.add("scenes", {"nodes": [asset.add("nodes", {"name": "Sun"})]})
    asset.add("scenes", {"name": "Empty"})
    path, mesh, rig = files(tmp_path, "tube.glb", asset.data)
    old = io.GltfScene(asset_of(path.read_bytes()))
    rig.save(tmp_path / "rig.glb", like=path)
    new = io.GltfScene(asset_of((tmp_path / "rig.glb").read_bytes()))
    nodes, shown = new.asset.json["nodes"], new.asset.json["scenes"]
    np.testing.assert_array_equal(new.tree.world(lamp), old.tree.world(lamp))
    assert shown[0] == shown[1] != shown[2]
    assert len(shown[2]["nodes"]) == 1 and shown[3] == {"name": "Empty"}
    skinned = [n for n in shown[0]["nodes"] if "skin" in nodes[n]]
    assert [nodes[n]["name"] for n in skinned] == ["Body", "Twin"]
    assert all("children" not in nodes[n] for n in skinned)
    assert sum("mesh" in node for node in nodes) == 2
    shapes = deformer.load_shapes(tmp_path / "rig.glb", fps=24)
    assert abs(shapes.vertices - rig.pose(rig.clip)).max() < 1e-5 * mesh.bounding_diagonal


def two_skins():
    """`scenes.deformed` with a lens that moves, and another scene whose mesh has a skin, too."""
    asset = scenes.deformed()
    lens = asset.add("nodes", {"name": "Lens", "camera": 0})
    asset.json["scenes"][0]["nodes"].append(lens)
    for channel in asset.json["animations"][0]["channels"]:
        if channel["target"]["node"] == 2:
            channel["target"]["node"] = lens
    joint = asset.add("nodes", {"name": "Joint"})
    asset.add("skins", {"joints": [joint], "skeleton": joint})
    other = asset.add("nodes", {"name": "Other", "mesh": 0, "skin": 1})
    asset.add("scenes", {"nodes": [joint, other]})
    return asset


def test_the_former_skeleton_is_removed_and_all_else_keeps_its_references(tmp_path):
    path, mesh, rig = files(tmp_path, "tube.glb", two_skins().data)
    rig.save(tmp_path / "rig.glb", like=path)
    new = asset_of((tmp_path / "rig.glb").read_bytes()).json
    nodes = new["nodes"]

    def names(numbers):
        return [nodes[n]["name"] for n in numbers]

    assert names(range(len(nodes))) == [
        "Root", "Body", "Eye", "Lens", "Joint", "Other", "near", "far"]  # fmt: skip
    assert names(new["scenes"][0]["nodes"]) == ["Root", "Lens", "Body", "near"]
    assert names(nodes[0]["children"]) == ["Eye"]
    assert names(new["scenes"][1]["nodes"]) == ["Joint", "Other"]
    assert [names(skin["joints"]) for skin in new["skins"]] == [["Joint"], ["near", "far"]]
    assert [names([skin["skeleton"]]) for skin in new["skins"]] == [["Joint"], ["near"]]
    assert [(n["name"], n["skin"]) for n in nodes if "skin" in n] == [("Body", 1), ("Other", 0)]
    assert [clip["name"] for clip in new["animations"]] == ["examples", "walk"]
    assert names(c["target"]["node"] for c in new["animations"][1]["channels"]) == ["Lens"]
    shapes = deformer.load_shapes(tmp_path / "rig.glb", fps=24)
    assert abs(shapes.vertices - rig.pose(rig.clip)).max() < 1e-5 * mesh.bounding_diagonal


def test_nodes_stay_where_an_extension_or_something_on_them_needs_them(tmp_path):
    kept = {}
    for name in ("known", "unknown", "socket", "shared"):
        asset = scenes.deformed()
        if name == "shared":
            asset.add("skins", {"joints": [3]})
            other = asset.add("nodes", {"name": "Other", "mesh": 0, "skin": 1})
            asset.add("scenes", {"nodes": [3, other]})
        elif name == "socket":
            socket = asset.add("nodes", {"name": "Socket"})
            asset.json["nodes"][3]["children"] = [socket]
        else:
            extension = "KHR_lights_punctual" if name == "known" else "EXT_of_nodes"
            asset.use_extension(extension)
            asset.json["extensions"] = {extension: {"bone": 3}}
        path, _, rig = files(tmp_path, f"{name}.glb", asset.data)
        nodes = asset_of(rig.glb(like=path)).json["nodes"]
        kept[name] = "Bone" in {node["name"] for node in nodes}
    assert kept == {"known": False, "unknown": True, "socket": True, "shared": True}


def test_groups_of_meshes_alone_are_removed(tmp_path):
    asset = scenes.plain()
    asset.json["nodes"][0]["children"] = [1]
    asset.json["scenes"][0]["nodes"] += [2]
    path, _, rig = files(tmp_path, "tube.glb", asset.data)
    new = asset_of(rig.glb(like=path)).json
    assert [node["name"] for node in new["nodes"]] == ["Body", "Eye", "near", "far"]
    assert new["scenes"][0]["nodes"] == [1, 0, 2]


@pytest.mark.parametrize("source", ["bare", "tube.obj", "tube.glb"])
def test_data_with_z_up_stands_upright(tmp_path, source):
    """With a node that turns it, as glTF has y up; a GLB document has y up already."""
    name = "tube.glb" if source == "tube.glb" else "tube.obj"
    path, mesh, rig = files(
        tmp_path, name, scenes.plain().data if name == "tube.glb" else tubes.obj()
    )
    like = None if source == "bare" else path
    shapes = []
    for up in ("y", "z"):
        rig.save(tmp_path / "rig.glb", like=like, up=up)
        shapes.append(as_other_programs_read(tmp_path / "rig.glb", fps=24))
        # This program gives the data back, as they were written.
        own = deformer.load_shapes(tmp_path / "rig.glb", fps=24).vertices
        assert abs(own - shapes[0]).max() < 1e-5 * mesh.bounding_diagonal
    expected = shapes[0] if source == "tube.glb" else shapes[0][..., [0, 2, 1]] * [1, 1, -1]
    assert abs(shapes[1] - expected).max() < 1e-5 * mesh.bounding_diagonal
    nodes = asset_of((tmp_path / "rig.glb").read_bytes()).json
    skinned = [n for n, node in enumerate(nodes["nodes"]) if "skin" in node]
    assert set(skinned) <= set(nodes["scenes"][0]["nodes"])
    with pytest.raises(InputError, match="up"):
        rig.glb(up="x")


def test_a_document_of_another_mesh_is_refused(tmp_path):
    _, _, rig = files(tmp_path, "tube.glb", scenes.plain().data)
    other, _, _ = files(tmp_path, "tube.obj", tubes.obj())
    with pytest.raises(InputError, match=r"document tube\.obj: 40 vertices"):
        rig.save(tmp_path / "rig.glb", like=other)
    with pytest.raises(InputError, match="like: expected a document"):
        rig.glb(like=3)
    assert not (tmp_path / "rig.glb").exists()
