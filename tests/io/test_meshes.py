"""Files keep every vertex where it was, and broken ones are refused in one helpful line."""

import json
import struct

import igl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st
from hypothesis.extra import numpy as hnp

from deformer import io
from deformer.errors import InputError
from deformer.geometry.mesh import Mesh, MeshSequence
from paths import DATA

FACES = np.array([[4, 1, 0], [1, 4, 3], [3, 6, 1], [0, 1, 6], [6, 3, 4]])
EXACT = ("obj", "ply", "off")
FLOAT32 = ("glb",)


def awkward_vertices(seed=0):
    """Seven vertices, 2 and 5 without a face, 5 and 6 on one another, with awkward digits."""
    vertices = np.random.default_rng(seed).normal(size=(7, 3)) / 3
    vertices[0] = [0.1, -1e-300, 1e17 / 3]
    vertices[5] = vertices[6]
    return vertices


def awkward_shapes(count=3):
    return MeshSequence(np.stack([awkward_vertices(seed) for seed in range(count)]), FACES)


def refusal(function, *arguments):
    with pytest.raises(InputError) as caught:
        function(*arguments)
    message = str(caught.value)
    assert "\n" not in message
    return message


def write(path, content):
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


# Round trips


@pytest.mark.parametrize("suffix", EXACT)
def test_double_formats_return_every_bit(tmp_path, suffix):
    mesh = Mesh(awkward_vertices(), FACES)
    io.save_mesh(tmp_path / f"a.{suffix}", mesh)
    back = io.load_mesh(tmp_path / f"a.{suffix}")
    assert back.vertices.tobytes() == mesh.vertices.tobytes()
    np.testing.assert_array_equal(back.faces, mesh.faces)


@pytest.mark.parametrize("suffix", FLOAT32)
def test_float32_formats_return_every_vertex_rounded_once(tmp_path, suffix):
    mesh = Mesh(awkward_vertices(), FACES)
    io.save_mesh(tmp_path / f"a.{suffix}", mesh)
    back = io.load_mesh(tmp_path / f"a.{suffix}")
    np.testing.assert_array_equal(back.vertices, mesh.vertices.astype(np.float32))
    np.testing.assert_array_equal(back.faces, mesh.faces)


def test_stl_returns_the_same_triangles_rounded_once(tmp_path):
    mesh = Mesh(awkward_vertices(), FACES)
    io.save_mesh(tmp_path / "a.stl", mesh)
    back = io.load_mesh(tmp_path / "a.stl")
    assert len(back.vertices) == 5  # those with a face
    np.testing.assert_array_equal(
        back.vertices[back.faces], mesh.vertices.astype(np.float32)[mesh.faces]
    )
    # Numbered by first corner.
    np.testing.assert_array_equal(back.vertices, mesh.vertices.astype("f4")[[4, 1, 0, 3, 6]])


@pytest.mark.parametrize("name", ["shapes.npz", "obj", "ply", "off"])
def test_sequences_return_every_bit_in_order(tmp_path, name):
    shapes = awkward_shapes(12)
    io.save_shapes(tmp_path / name, shapes, format=name if "." not in name else "ply")
    back = io.load_shapes(tmp_path / name)
    assert back.vertices.tobytes() == shapes.vertices.tobytes()
    np.testing.assert_array_equal(back.faces, shapes.faces)


positions_in_reach = st.floats(-1e60, 1e60)


@st.composite
def sequences(draw):
    count, vertices = draw(st.integers(1, 3)), draw(st.integers(1, 6))
    positions = draw(hnp.arrays(np.float64, (count, vertices, 3), elements=positions_in_reach))
    faces = draw(
        hnp.arrays(np.int64, (draw(st.integers(1, 5)), 3), elements=st.integers(0, vertices - 1))
    )
    return MeshSequence(positions, faces)


@settings(max_examples=40)
@given(sequences(), st.sampled_from(["a.npz", "obj", "ply", "off"]))
def test_any_sequence_survives(tmp_path_factory, shapes, name):
    target = tmp_path_factory.mktemp("any") / name
    io.save_shapes(target, shapes, format=name if "." not in name else "ply")
    back = io.load_shapes(target)
    assert back.vertices.tobytes() == shapes.vertices.tobytes()
    assert back.faces.tobytes() == shapes.faces.tobytes()


@settings(max_examples=25)
@given(sequences())
def test_any_mesh_survives_glb_as_float32(tmp_path_factory, shapes):
    mesh = Mesh(np.clip(shapes.vertices[0], -1e30, 1e30), shapes.faces)
    target = tmp_path_factory.mktemp("any") / "a.glb"
    io.save_mesh(target, mesh)
    back = io.load_mesh(target)
    np.testing.assert_array_equal(back.vertices, mesh.vertices.astype(np.float32))
    np.testing.assert_array_equal(back.faces, mesh.faces)


@pytest.mark.parametrize("suffix", ["obj", "ply", "off"])
def test_igl_reads_what_we_write(tmp_path, suffix):
    mesh = Mesh(np.random.default_rng(0).normal(size=(7, 3)), FACES)
    io.save_mesh(tmp_path / f"a.{suffix}", mesh)
    vertices, faces = igl.read_triangle_mesh(str(tmp_path / f"a.{suffix}"))
    np.testing.assert_allclose(vertices, mesh.vertices, rtol=1e-6)
    np.testing.assert_array_equal(faces, mesh.faces)


@pytest.mark.parametrize("suffix", ["ply", "off", "stl"])
def test_trimesh_reads_what_we_write_and_writes_what_we_read(tmp_path, suffix):
    mesh = Mesh(np.random.default_rng(0).normal(size=(5, 3)).astype("f4"), [[0, 1, 2], [2, 3, 4]])
    io.save_mesh(tmp_path / f"ours.{suffix}", mesh)
    theirs = trimesh.load_mesh(tmp_path / f"ours.{suffix}", process=False)
    np.testing.assert_allclose(theirs.triangles, mesh.vertices[mesh.faces], atol=1e-7)
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(tmp_path / f"theirs.{suffix}")
    back = io.load_mesh(tmp_path / f"theirs.{suffix}")
    np.testing.assert_allclose(back.vertices, mesh.vertices, atol=1e-7)
    np.testing.assert_array_equal(back.faces, mesh.faces)


# OBJ syntax

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    ("text", "faces"),
    [
        (SQUARE + "f 1 2 3\nf 1 3 4\n", [[0, 1, 2], [0, 2, 3]]),
        (SQUARE + "f 1 2 3 4\n", [[0, 1, 2], [0, 2, 3]]),
        (SQUARE + "f 2 3 4 1\n", [[1, 2, 3], [1, 3, 0]]),
        (SQUARE + "v 2 2 2\nf 5 4 3 2 1\n", [[4, 3, 2], [4, 2, 1], [4, 1, 0]]),
        (SQUARE + "f 1// 2// 3//\n", [[0, 1, 2]]),
        (SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\nf 1/3 3/1 4/2\n", [[0, 1, 2], [0, 2, 3]]),
        (SQUARE + "vn 0 0 1\nf 1//1 2//1 3//1\nf 1//2 2//2 4//2\n", [[0, 1, 2], [0, 1, 3]]),
        (SQUARE + "vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\n", [[0, 1, 2]]),
        (SQUARE + "f -4 -3 -2\nf -4 -2 -1\n", [[0, 1, 2], [0, 2, 3]]),
        (SQUARE + "f -4 -3 -2\nv 5 5 5\nf -2 -1 1\n", [[0, 1, 2], [3, 4, 0]]),
        ("v 9 9 9\nv 8 8 8\nv 7 7 7\nf -3/-1 -2/-1 -1/-1\n" + SQUARE, [[0, 1, 2]]),
        ("f 1 2 3\n" + SQUARE, [[0, 1, 2]]),
        ("# made by hand\n\n" + SQUARE + "# end\nf 1 2 3 # the first\n", [[0, 1, 2]]),
        ("mtllib a.mtl\no thing\ng part\n" + SQUARE + "usemtl red\ns off\nf 1 2 3\n", [[0, 1, 2]]),
        (SQUARE + "l 1 2\np 3\nf 1 2 3\n", [[0, 1, 2]]),
        (SQUARE + "f 1 2 \\\n 3 \\\n 4\n", [[0, 1, 2], [0, 2, 3]]),
        ("# in C:\\\n" + SQUARE + "f 1 2 3\n", [[0, 1, 2]]),
        (SQUARE.replace("v 0 0 0", "v 0 \\\n0 0") + "f 1 2 3\n", [[0, 1, 2]]),
        ((SQUARE + "f 1 2 3\n").replace("\n", "\r\n"), [[0, 1, 2]]),
        ((SQUARE + "f 1 2 \\\n3\n").replace("\n", "\r\n"), [[0, 1, 2]]),
        ((SQUARE + "f 1 2 3\n").replace("\n", "\r"), [[0, 1, 2]]),
        ((SQUARE + "f 1 2 3").replace(" ", "\t"), [[0, 1, 2]]),
        ("  " + SQUARE + "  f  1  2  3  ", [[0, 1, 2]]),
        ("\ufeff" + SQUARE + "f 1 2 3\n", [[0, 1, 2]]),
        (SQUARE.replace("\n", " 0.5\n") + "f 1 2 3\n", [[0, 1, 2]]),
        (SQUARE.replace("\n", " 0.1 0.2 0.3\n") + "f 1 2 3\n", [[0, 1, 2]]),
    ],
)  # fmt: skip
def test_obj_syntax(tmp_path, text, faces):
    mesh = io.load_mesh(write(tmp_path / "a.obj", text))
    np.testing.assert_array_equal(mesh.faces, faces)
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    start = 3 if text.startswith("v 9") else 0
    np.testing.assert_array_equal(mesh.vertices[start : start + 4], corners)


def test_scape_reads_as_its_header_says():
    if not (DATA / "scape-obj").is_dir():
        pytest.skip("the SCAPE example meshes are not on this machine")
    shapes = io.load_shapes(DATA / "scape-obj")
    assert shapes.vertices.shape == (71, 2161, 3)
    assert shapes.faces.shape == (4318, 3)
    assert shapes.faces[0].tolist() == [1140, 1084, 1164]
    for index, name in ((0, "1.obj"), (1, "2.obj"), (70, "71.obj")):
        vertices, faces = igl.read_triangle_mesh(str(DATA / "scape-obj" / name))
        np.testing.assert_array_equal(shapes.vertices[index], vertices)
        np.testing.assert_array_equal(shapes.faces, faces)


# Polygons and variants of the other formats

PENTAGON = [[3.0, 0, 0], [0, 3, 0], [-3, 0, 0], [-2, -3, 0], [2, -3, 0]]
PENTAGON_FAN = [[1, 2, 3], [1, 3, 4], [1, 4, 0], [2, 3, 4]]


def test_off_polygons_comments_and_colours(tmp_path):
    lines = [f"{x} {y} {z} 255 0 0 # red" for x, y, z in PENTAGON]
    text = "\n".join(["COFF", "# by hand", "5 2 0", *lines, "", "5  1 2 3 4 0  9 9 9", "3 2 3 4"])
    for name, content in (("a.off", text), ("b.off", text.replace("COFF\n# by hand\n", "COFF "))):
        mesh = io.load_mesh(write(tmp_path / name, content))
        np.testing.assert_array_equal(mesh.vertices, PENTAGON)
        np.testing.assert_array_equal(mesh.faces, PENTAGON_FAN)


PLY_HEADER = """ply
format {order} 1.0
comment by hand
element camera 1
property float focus
property list uchar short flags
element vertex 5
property uchar red
property float x
property double y
property float z
element face 2
property int group
property list uchar int vertex_indices
property list uchar float texcoord
end_header
"""


def ply_binary(order, group=7):
    content = struct.pack(order + "fB2h", 1.5, 2, 3, 4)
    for x, y, z in PENTAGON:
        content += struct.pack(order + "Bfdf", 255, x, y, z)
    content += struct.pack(order + "iB3iB", group, 3, 2, 3, 4, 0)
    return content + struct.pack(order + "iB5iB2f", group, 5, 1, 2, 3, 4, 0, 2, 0.5, 0.5)


def test_ply_polygons_in_text_and_both_byte_orders(tmp_path):
    text = "1.5 2 3 4\n" + "".join(f"255 {x} {y} {z}\n" for x, y, z in PENTAGON)
    text += "7 3 2 3 4 0\n7 5 1 2 3 4 0 2 0.5 0.5\n"
    contents = {
        "ascii": text.encode(),
        "binary_little_endian": ply_binary("<"),
        "binary_big_endian": ply_binary(">"),
    }
    for order, content in contents.items():
        data = PLY_HEADER.format(order=order).encode() + content
        mesh = io.load_mesh(write(tmp_path / f"{order}.ply", data))
        np.testing.assert_array_equal(mesh.vertices, PENTAGON)
        np.testing.assert_array_equal(mesh.faces, PENTAGON_FAN[-1:] + PENTAGON_FAN[:-1])


def test_stl_text(tmp_path):
    facet = "facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n"
    corners = [
        "vertex 0 0 0\n",
        "vertex 1 0 0\n",
        "vertex 1 1 0.1\n",
        "vertex 0 1 0\n",
        "vertex -0 0 0\n",
    ]
    text = "".join(facet.format("".join(corners[i] for i in f)) for f in ([0, 1, 2], [2, 3, 4]))
    mesh = io.load_mesh(write(tmp_path / "a.stl", f"solid thing\n{text}endsolid\n"))
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [2, 3, 0]])


def test_obj_stl_ply_and_off_split_polygons_alike_whatever_the_shape(tmp_path):
    """A fan around the first corner, even where another diagonal is shorter."""
    stretched = np.array([[0, 0, 0], [9, 0, 0], [10, 1, 0], [0.5, 0.5, 0]])
    for i, corners in enumerate((stretched, stretched[[1, 2, 3, 0]])):
        lines = "".join(f"{x} {y} {z}\n" for x, y, z in corners)
        write(tmp_path / f"{i}.off", f"OFF\n4 1 0\n{lines}4 0 1 2 3\n")
    np.testing.assert_array_equal(io.load_shapes(tmp_path).faces, [[0, 1, 2], [0, 2, 3]])


# GLB scenes


def glb(scene, binary):
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def glb_scene(**changes):
    """Two triangles on one array of positions, interleaved with normals, and 16-bit indices."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
    binary = np.hstack([points, points]).tobytes() + struct.pack("<6H", 0, 1, 2, 2, 1, 3)
    scene = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [1, 0]}],
        "nodes": [{"mesh": 0}, {"translation": [10, 0, 0], "children": [2]}, {"mesh": 0}],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0}, "indices": 1},
                    {"attributes": {"POSITION": 0}, "indices": 2},
                ]
            }
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
            {
                "bufferView": 1,
                "byteOffset": 6,
                "componentType": 5123,
                "count": 3,
                "type": "SCALAR",
            },
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 96, "byteStride": 24},
            {"buffer": 0, "byteOffset": 96, "byteLength": 12},
        ],
        "buffers": [{"byteLength": 108}],
    }
    scene.update(changes)
    return points.astype(float), scene, binary


def test_glb_nodes_keep_scene_order_and_apply_transforms(tmp_path):
    points, scene, binary = glb_scene()
    mesh = io.load_mesh(write(tmp_path / "a.glb", glb(scene, binary)))
    # Node 1 → 2 (moved) comes first, then node 0; both primitives share four vertices.
    np.testing.assert_array_equal(mesh.vertices, np.vstack([points + np.array([10, 0, 0]), points]))
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [2, 1, 3], [4, 5, 6], [6, 5, 7]])


def test_glb_rotation_scale_and_matrix_agree_with_trimesh(tmp_path):
    turn = trimesh.transformations.random_rotation_matrix(np.random.default_rng(1).random(3))
    quaternion = trimesh.transformations.quaternion_from_matrix(turn)[[1, 2, 3, 0]]
    nodes = [
        {"mesh": 0, "translation": [1, 2, 3], "rotation": quaternion.tolist(), "scale": [2, 3, 4]},
        {"matrix": (turn @ np.diag([1, 2, 3, 1])).T.ravel().tolist(), "children": [2]},
        {"mesh": 0, "translation": [1, 0, 0]},
    ]
    points, scene, binary = glb_scene(nodes=nodes, scenes=[{"nodes": [0, 1]}])
    mesh = io.load_mesh(write(tmp_path / "a.glb", glb(scene, binary)))
    first = points * [2, 3, 4] @ turn[:3, :3].T + [1, 2, 3]
    second = (points + np.array([1, 0, 0])) * [1, 2, 3] @ turn[:3, :3].T
    np.testing.assert_allclose(mesh.vertices, np.vstack([first, second]), atol=1e-14)
    theirs = trimesh.load_scene(tmp_path / "a.glb").to_mesh()
    key = np.sort(theirs.triangles.reshape(-1, 9), axis=0)
    ours = np.sort(mesh.vertices[mesh.faces].reshape(-1, 9), axis=0)
    np.testing.assert_allclose(ours, key, atol=1e-6)


def test_glb_mirroring_turns_faces_back(tmp_path):
    points, scene, binary = glb_scene(nodes=[{"mesh": 0, "scale": [-1, 1, 1]}], scenes=[])
    mesh = io.load_mesh(write(tmp_path / "a.glb", glb(scene, binary)))
    np.testing.assert_array_equal(mesh.vertices, points * [-1, 1, 1])
    np.testing.assert_array_equal(mesh.faces, [[0, 2, 1], [2, 3, 1]])


MESHOPT = {"EXT_meshopt_compression": {}}


def with_extension(scene):
    scene["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": {}}


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (with_extension, "Draco"),
        (lambda s: s["bufferViews"][0].update(extensions=MESHOPT), "meshopt"),
        (lambda s: s["accessors"][0].update(sparse={"count": 1}), "sparse"),
        (lambda s: s["accessors"][0].update(componentType=5122), "quantisation"),
        (lambda s: s["meshes"][0]["primitives"][1].update(mode=1), "mode 1"),
        (lambda s: s["nodes"][0].update(skin=0), "list of skins"),
        (lambda s: s["meshes"][0].update(weights=[0, 0.5]), "0 numbers"),
        (lambda s: s["buffers"][0].update(uri="a.bin"), "missing"),
        (lambda s: s["accessors"][0].update(count=99), "broken glTF"),
        (lambda s: s["accessors"][0].update(count=2), "vertex index 2"),
        (lambda s: s["nodes"][2].update(children=[1]), "broken glTF"),
        (lambda s: s.update(meshes=[]), "broken glTF"),
        (lambda s: s.update(scenes=[{}]), "no faces"),
    ],
)  # fmt: skip
def test_glb_refuses_what_it_cannot_keep(tmp_path, change, part):
    _, scene, binary = glb_scene()
    change(scene)
    message = refusal(io.load_mesh, write(tmp_path / "odd.glb", glb(scene, binary)))
    assert "odd.glb" in message
    assert part in message


# Sequences


def test_directory_is_read_in_natural_order_and_ignores_other_files(tmp_path):
    for i in (1, 2, 10, 9, 100):
        io.save_mesh(tmp_path / f"pose{i}.obj", Mesh(np.eye(3) * i, [[0, 1, 2]]))
    write(tmp_path / "README.txt", "hello")
    write(tmp_path / "pose1.mtl", "newmtl a")
    write(tmp_path / ".pose3.obj", "broken")
    (tmp_path / "old.obj").mkdir()
    calls = []
    shapes = io.load_shapes(tmp_path, progress=lambda done, total: calls.append((done, total)))
    assert shapes.vertices[:, 0, 0].tolist() == [1, 2, 9, 10, 100]
    assert calls == [(1, 5), (2, 5), (3, 5), (4, 5), (5, 5)]


def test_one_file_is_a_sequence_of_one(tmp_path):
    io.save_mesh(tmp_path / "a.PLY", Mesh(np.eye(3), [[0, 1, 2]]))
    assert io.load_shapes(tmp_path / "a.PLY").vertices.shape == (1, 3, 3)


def test_same_faces_in_other_words_are_the_same(tmp_path):
    write(tmp_path / "1.obj", SQUARE + "f 1 2 3 4\n")
    write(tmp_path / "2.obj", SQUARE + "f 1/7 2/8 3/9\nf 1 3 4\n")
    write(tmp_path / "3.obj", SQUARE + "f -4 -3 -2 -1\n")
    assert len(io.load_shapes(tmp_path)) == 3


def test_relative_faces_are_read_anew_in_every_file(tmp_path):
    write(tmp_path / "1.obj", SQUARE + "f -4 -3 -2\n")
    write(tmp_path / "2.obj", SQUARE.replace("v 0 1 0\n", "f -3 -2 -1\nv 0 1 0\n"))
    assert len(io.load_shapes(tmp_path)) == 2
    write(tmp_path / "3.obj", "v 0 0 0\n" * 3 + "f -3 -2 -1\nv 0 0 0\n")
    write(tmp_path / "4.obj", "v 0 0 0\n" * 4 + "f -3 -2 -1\n")
    assert "4.obj" in refusal(io.load_shapes, tmp_path)


@pytest.mark.parametrize(
    ("second", "parts"),
    [
        (SQUARE + "v 5 5 5\nf 1 2 3\nf 1 3 4\n", ["2.obj", "5 vertices", "expected 4", "1.obj"]),
        (SQUARE + "f 1 2 3\n", ["2.obj", "1 triangles", "expected 2", "1.obj"]),
        (SQUARE + "f 1 2 3\nf 3 1 4\n", ["2.obj", "triangle 1", "[2, 0, 3]", "[0, 2, 3]"]),
    ],
)
def test_shapes_that_differ_are_refused(tmp_path, second, parts):
    write(tmp_path / "1.obj", SQUARE + "f 1 2 3\nf 1 3 4\n")
    write(tmp_path / "2.obj", second)
    message = refusal(io.load_shapes, tmp_path)
    for part in parts:
        assert part in message


def test_mixed_formats_are_refused(tmp_path):
    for name in ("1.obj", "2.ply"):
        io.save_mesh(tmp_path / name, Mesh(np.eye(3), [[0, 1, 2]]))
    message = refusal(io.load_shapes, tmp_path)
    assert "1.obj" in message
    assert "2.ply" in message


def stl_sequence(tmp_path, second):
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    soup = np.array([[0, 1, 2], [3, 4, 5]])
    io.save_mesh(tmp_path / "1.stl", Mesh(square[[0, 1, 2, 0, 2, 3]], soup))
    io.save_mesh(tmp_path / "2.stl", Mesh(np.array(second), soup))
    return tmp_path


def test_stl_weld_of_the_first_shape_holds_for_all(tmp_path):
    a, b, c, d = [0.0, 0, 1], [1.0, 0, 1], [1.0, 1, 1], [0.0, 1, 1]
    shapes = io.load_shapes(stl_sequence(tmp_path, [a, b, c, a, c, d]))
    np.testing.assert_array_equal(shapes.faces, [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(shapes.vertices[1], [a, b, c, d])


def test_stl_vertices_that_meet_later_stay_apart(tmp_path):
    a, b, c = [0.0, 0, 1], [1.0, 0, 1], [1.0, 1, 1]
    shapes = io.load_shapes(stl_sequence(tmp_path, [a, b, c, a, c, b]))
    np.testing.assert_array_equal(shapes.faces, [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(shapes.vertices[1], [a, b, c, b])


def test_stl_weld_that_tears_is_refused(tmp_path):
    a, b, c, d = [0.0, 0, 1], [1.0, 0, 1], [1.0, 1, 1], [0.0, 1, 1]
    message = refusal(io.load_shapes, stl_sequence(tmp_path, [a, b, c, a, [1, 1, 1.001], d]))
    for part in ("2.stl", "triangle 1", "vertex 2", "1.stl"):
        assert part in message


# Broken files

NPZ = {"vertices": np.eye(3)[None], "faces": np.array([[0, 1, 2]])}


def npz(path, **changes):
    arrays = {k: v for k, v in {**NPZ, **changes}.items() if v is not None}
    np.savez(path, **arrays)
    return path


def test_written_arrays_keep_their_types(tmp_path):
    arrays = {"vertices": np.eye(3, dtype="f4")[None], "faces": np.array([[0, 1, 2]], "i4")}
    io.write_npz(tmp_path / "no-suffix", arrays | {"names": np.array(["rest"])})
    assert [path.name for path in tmp_path.iterdir()] == ["no-suffix"]
    with np.load(tmp_path / "no-suffix", allow_pickle=False) as stored:
        assert sorted(stored) == ["faces", "names", "vertices"]
        assert stored["names"].tolist() == ["rest"]
        for name, array in arrays.items():
            assert stored[name].dtype == array.dtype
            np.testing.assert_array_equal(stored[name], array)
    assert "create it first" in refusal(io.write_npz, tmp_path / "gone" / "a.npz", arrays)


def test_written_arrays_replace_a_file_at_the_end(tmp_path, monkeypatch):
    io.write_npz(tmp_path / "a.npz", {"faces": np.zeros(3)})
    before = (tmp_path / "a.npz").read_bytes()

    def full(stream, *_, **__):
        stream.write(b"half a file")
        raise OSError("no space left on device")

    monkeypatch.setattr(np.lib.format, "write_array", full)
    with pytest.raises(OSError, match="no space"):
        io.write_npz(tmp_path / "a.npz", {"faces": np.ones(3)})
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]
    assert (tmp_path / "a.npz").read_bytes() == before


def test_npz_takes_one_shape_and_ignores_other_arrays(tmp_path):
    path = npz(tmp_path / "a.npz", vertices=np.eye(3, dtype="f4"), rest=np.array([{}], object))
    assert io.load_shapes(path).vertices.shape == (1, 3, 3)


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"faces": None}, ["['vertices']", "'faces'"]),
        ({"vertices": None}, ["['faces']", "'vertices'"]),
        ({"vertices": np.eye(3)[:, :2]}, ["(1, 3, 2)", "(N, V, 3)"]),
        ({"faces": np.array([[0, 1, 2, 0]])}, ["(1, 4)", "(F, 3)"]),
        ({"faces": np.array([[0, 1, 3]])}, ["faces[0]", "[0, 1, 3]", "0…2"]),
        ({"faces": np.array([[0.0, 1, 2]])}, ["integers", "float64"]),
        ({"vertices": np.full((2, 3, 3), np.nan)}, ["[0, 0]", "nan"]),
        ({"vertices": np.eye(3)[None].astype(str)}, ["floats"]),
        ({"vertices": np.array([[[None]]], object)}, ["plain number arrays"]),
    ],
)
def test_npz_errors(tmp_path, changes, parts):
    message = refusal(io.load_shapes, npz(tmp_path / "odd.npz", **changes))
    for part in ["odd.npz", *parts]:
        assert part in message


def test_npz_that_is_no_archive_or_damaged(tmp_path):
    assert "odd.npz" in refusal(io.load_shapes, write(tmp_path / "odd.npz", "hello"))
    np.save(tmp_path / "plain.npy", np.eye(3))
    (tmp_path / "plain.npy").rename(tmp_path / "plain.npz")
    assert "plain.npz" in refusal(io.load_shapes, tmp_path / "plain.npz")
    io.save_shapes(tmp_path / "a.npz", awkward_shapes(50))
    data = bytearray((tmp_path / "a.npz").read_bytes())
    data[200:300] = bytes(100)
    assert "a.npz" in refusal(io.load_shapes, write(tmp_path / "a.npz", bytes(data)))
    assert "a.npz" in refusal(io.load_shapes, write(tmp_path / "a.npz", bytes(data[:150])))


PLY_TEXT = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""
BINARY_PLY = PLY_TEXT.partition("end_header\n")[0].replace("ascii", "binary_little_endian")
BINARY_PLY = (BINARY_PLY + "end_header\n").encode() + np.eye(3, dtype="<f4").tobytes()

STL_TEXT = """solid a
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 1 0 0
vertex 0 1 0
endloop
endfacet
endsolid a
"""
NAN_STL = bytes(80) + struct.pack("<I12fH", 1, *[0] * 6, np.nan, *[0] * 6)


@pytest.mark.parametrize(
    ("name", "content", "parts"),
    [
        ("a.obj", "", ["empty"]),
        ("a.obj", "f 1 2 3\n", ["no vertices"]),
        ("a.obj", SQUARE, ["no faces"]),
        ("a.obj", SQUARE + "f 1 2\n", ["line 5", "2 corners"]),
        ("a.obj", SQUARE + "f 1 2 5\n", ["line 5", "5", "1…4"]),
        ("a.obj", SQUARE + "f 1 2 3\nf 0 1 2\n", ["line 6", "0", "1…4"]),
        ("a.obj", SQUARE + "f -5 1 2\n", ["line 5", "-5", "1…4"]),
        ("a.obj", SQUARE + "f 1 2 x\n", ["line 5", "1 2 x"]),
        ("a.obj", SQUARE + "f 1 2 3_0\n", ["line 5", "3_0"]),
        ("a.obj", SQUARE + "f 1 2 99999999999999999999\n", ["line 5", "9999"]),
        ("a.obj", "# a\n" + SQUARE + "v 1 2 x\nf 1 2 3\n", ["line 6", "1 2 x"]),
        ("a.obj", "# a\r\n\r\nv 0 \\\r\n0 0\r\nv 1 2\r\nf 1 1 1\r\n", ["line 5", "1 2"]),
        ("a.obj", SQUARE + "v\nf 1 2 3\n", ["line 5"]),
        ("a.obj", SQUARE + "v 1 nan 2\nf 1 2 3\n", ["line 5", "nan"]),
        ("a.obj", SQUARE + "v 1 1e999 2\nf 1 2 3\n", ["line 5", "1e999"]),
        ("a.obj", SQUARE + "v 1 1_0 2\nf 1 2 3\n", ["line 5", "1_0"]),
        ("a.off", "PLY\n", ["OFF"]),
        ("a.off", "# nothing\n", ["OFF"]),
        ("a.off", "OFF BINARY\n3 1 0\n", ["OFF"]),
        ("a.off", "4OFF\n3 1 0\n", ["4OFF"]),
        ("a.off", "OFF\nmany few\n", ["line 2", "counts"]),
        ("a.off", "OFF\n0 0 0\n", ["no vertices"]),
        ("a.off", "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", ["no faces"]),
        ("a.off", "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", ["4 lines", "3 vertices"]),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 x 0\n0 1 0\n3 0 1 2\n", ["line 4", "1 x 0"]),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 inf\n0 1 0\n3 0 1 2\n", ["line 4", "inf"]),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", ["line 6", "3", "0…2"]),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", ["line 6"]),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n", ["line 6", "2 corners"]),
        ("a.off", "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n4 0 1 2 2\n2 0 1", ["line 7", "2 corners"]),
        ("a.ply", "solid", ["no PLY header"]),
        ("a.ply", PLY_TEXT.replace("format ascii 1.0\n", ""), ["no 'format'"]),
        ("a.ply", PLY_TEXT.replace("float y", "quad y"), ["line 5", "quad y"]),
        ("a.ply", PLY_TEXT.replace("float y", "float why"), ["no vertices"]),
        ("a.ply", PLY_TEXT.replace("vertex_indices", "strips"), ["no faces"]),
        ("a.ply", PLY_TEXT.replace("face 1", "face 2"), ["'face'", "1 rows", "expected 2"]),
        ("a.ply", PLY_TEXT.replace("1 0 0", "1 0 x"), ["line 11", "1 0 x"]),
        ("a.ply", PLY_TEXT.replace("1 0 0", "1 0"), ["line 11", "1 0"]),
        ("a.ply", PLY_TEXT.replace("3 0 1 2", "3 0 1"), ["line 13"]),
        ("a.ply", PLY_TEXT.replace("3 0 1 2", "3 0 1 7"), ["line 13", "7", "0…2"]),
        ("a.ply", PLY_TEXT.replace("3 0 1 2", "2 0 1"), ["line 13", "2 corners"]),
        ("a.ply", BINARY_PLY, ["'face'", "0 rows", "expected 1"]),
        ("a.ply", BINARY_PLY[:-1], ["'vertex'"]),
        ("a.ply", BINARY_PLY + struct.pack("<B3i", 3, 0, 1, 9), ["face 0", "9", "0…2"]),
        ("a.ply", BINARY_PLY[:-4] + struct.pack("<fB3i", np.nan, 3, 0, 1, 2), ["vertex 2", "nan"]),
        ("a.stl", "hello", ["5 bytes"]),
        ("a.stl", bytes(84), ["no triangles"]),
        ("a.stl", "solid a\nendsolid a\n", ["no triangles"]),
        ("a.stl", STL_TEXT.replace("1 0 0", "1 x 0"), ["line 5", "1 x 0"]),
        ("a.stl", NAN_STL, ["triangle 0", "nan"]),
        ("a.glb", "hello", ["no glTF"]),
        ("a.glb", struct.pack("<4sIIII", b"glTF", 2, 99, 50, 0), ["cut short"]),
        ("a.glb", struct.pack("<4sII", b"glTF", 2, 12), ["JSON"]),
        ("a.fbx", "hello", [".fbx", ".obj"]),
    ],
)  # fmt: skip
def test_broken_files(tmp_path, name, content, parts):
    path = write(tmp_path / name, content)
    for function in (io.load_mesh, io.load_shapes):
        message = refusal(function, path)
        for part in [name, *parts]:
            assert part in message


def test_missing_paths(tmp_path):
    for name in ("gone", "gone.obj", "gone.npz"):
        message = refusal(io.load_shapes, tmp_path / name)
        assert name in message
        assert "does not exist" in message
    assert "no mesh files" in refusal(io.load_shapes, tmp_path)
    assert str(tmp_path) in refusal(io.load_mesh, tmp_path)


@settings(max_examples=150)
@given(data=st.data(), suffix=st.sampled_from(["obj", "ply", "off", "stl", "glb", "npz"]))
def test_damaged_files_load_or_are_refused_and_nothing_else(tmp_path_factory, data, suffix):
    folder = tmp_path_factory.mktemp("damaged")
    path = folder / f"a.{suffix}"
    shapes = MeshSequence(np.random.default_rng(0).normal(size=(1, 7, 3)), FACES)
    if suffix == "npz":
        io.save_shapes(path, shapes)
    else:
        io.save_mesh(path, shapes.mesh(0))
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(content)))
        end = min(len(content), start + data.draw(st.integers(0, 6)))
        content[start:end] = data.draw(st.binary(max_size=6))
    write(path, bytes(content))
    try:
        io.load_shapes(path)
    except InputError as error:
        assert "\n" not in str(error)
        assert path.name in str(error)


# Writing


class Stop(RuntimeError):
    pass


def test_failing_write_leaves_the_old_file_and_nothing_else(tmp_path):
    target = write(tmp_path / "a.txt", "old")
    with pytest.raises(Stop), io.atomic_path(target) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".txt"
        temporary.write_text("half")
        raise Stop
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_failing_directory_write_leaves_the_old_directory(tmp_path):
    target = tmp_path / "shapes"
    io.save_shapes(target, awkward_shapes(3))
    before = sorted(target.iterdir())
    with pytest.raises(Stop), io.atomic_directory(target, lambda entry: True) as temporary:
        write(temporary / "half", "x")
        raise Stop
    assert sorted(target.iterdir()) == before
    assert list(tmp_path.iterdir()) == [target]


def test_directory_of_our_own_files_is_replaced_as_a_whole(tmp_path):
    target = tmp_path / "shapes"
    target.mkdir()
    io.save_shapes(target, awkward_shapes(5), format="obj")
    io.save_shapes(f"{target}/", awkward_shapes(2))
    names = sorted(entry.name for entry in target.iterdir())
    assert names == [".deformer.json", "0000.ply", "0001.ply"]
    assert list(tmp_path.iterdir()) == [target]


def test_link_to_a_directory_stays_a_link(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real", target_is_directory=True)
    io.save_shapes(tmp_path / "link", awkward_shapes(2))
    assert (tmp_path / "link").is_symlink()
    assert len(io.load_shapes(tmp_path / "real")) == 2


def test_directory_with_other_files_is_left_alone(tmp_path):
    write(tmp_path / "notes.txt", "keep me")
    message = refusal(io.save_shapes, tmp_path, awkward_shapes())
    assert "notes.txt" in message
    assert (tmp_path / "notes.txt").read_text() == "keep me"


def test_write_errors(tmp_path):
    mesh = Mesh(np.eye(3), [[0, 1, 2]])
    file = write(tmp_path / "file", "x")
    assert ".fbx" in refusal(io.save_mesh, tmp_path / "a.fbx", mesh)
    assert "gone" in refusal(io.save_mesh, tmp_path / "gone" / "a.obj", mesh)
    (tmp_path / "dir.obj").mkdir()
    assert "dir.obj" in refusal(io.save_mesh, tmp_path / "dir.obj", mesh)
    assert "a.obj" in refusal(io.save_shapes, tmp_path / "a.obj", awkward_shapes())
    assert "'fbx'" in refusal(io.save_shapes, tmp_path / "a", awkward_shapes(), "fbx")
    assert "is a file" in refusal(io.save_shapes, file, awkward_shapes())


def test_json_round_trip_with_numpy_values(tmp_path):
    io.write_json(tmp_path / "a.json", {"z": np.arange(2.0), "n": np.int64(3), "é": None})
    text = (tmp_path / "a.json").read_text(encoding="utf-8")
    assert json.loads(text) == {"z": [0.0, 1.0], "n": 3, "é": None}
    assert text.endswith("}\n")
    for bad in (float("nan"), object()):
        with pytest.raises(InputError, match=r"a\.json: cannot be written as JSON"):
            io.write_json(tmp_path / "a.json", {"x": bad})
    assert (tmp_path / "a.json").read_text(encoding="utf-8") == text


# Splits and handles


def test_split(tmp_path):
    path = write(tmp_path / "s.json", '{"train": [2, 0], "test": [1], "note": "x"}')
    assert io.load_split(path, 3) == {"train": [2, 0], "test": [1]}


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ('{"train": [0]', ["line 1"]),
        ('{\n"train": [0],\n}', ["line 3"]),
        ("[0, 1]", ["list", "object"]),
        ("[" * 100_000, ["nested more than 100 deep"]),
        (b"\xff\xfe\xff", ["not JSON"]),
        ('{"train": [0]}', ["'test'"]),
        ('{"train": 3, "test": []}', ["train", "a list"]),
        ('{"train": [], "test": [0]}', ["'train' is empty"]),
        ('{"train": [0, 3], "test": []}', ["train[1]", "3", "0…2"]),
        ('{"train": [-1], "test": []}', ["train[0]", "-1"]),
        ('{"train": [true], "test": []}', ["train[0]", "True"]),
        ('{"train": [1.0], "test": []}', ["train[0]", "1.0"]),
        ('{"train": [1, 1], "test": []}', ["train[1]", "1", "'train'"]),
        ('{"train": [1], "test": [0, 1]}', ["test[1]", "1", "'train'"]),
    ],
)
def test_split_errors(tmp_path, text, parts):
    message = refusal(io.load_split, write(tmp_path / "split.json", text), 3)
    for part in ["split.json", *parts]:
        assert part in message


def test_handles(tmp_path):
    one = {"vertex": 4, "position": [1, 2.5, -3]}
    two = {"vertex": 0, "position": [0, 0, 0], "weight": 2}
    path = write(tmp_path / "h.json", json.dumps({"handles": [one, two]}))
    first = io.HandleTarget(4, (1.0, 2.5, -3.0), 1.0)
    second = io.HandleTarget(0, (0.0, 0.0, 0.0), 2.0)
    assert io.load_handles(path, 5) == io.HandleFile(((first, second),), False)
    path = write(tmp_path / "h.json", json.dumps({"handles": [one, two], "noise": 0.01}))
    assert io.load_handles(path, 5) == io.HandleFile(((first, second),), False, 0.01)
    path = write(tmp_path / "h.json", json.dumps({"frames": [[one], [two, one]]}))
    assert io.load_handles(path, 5) == io.HandleFile(((first,), (second, first)), True)


def test_what_else_a_pose_needs(tmp_path):
    """The regions that handles belong to, the prior, the start, and the model of their codes."""
    alone = {"vertex": 1, "position": [0, 0, 0], "gap": [0, 0.5, 0]}
    painted = {"vertex": 1, "position": [1, 0, 0], "region": 0}
    data = {
        "handles": [alone, painted],
        "regions": [[1, 2, 3]],
        "prior": {"mean": [0.5, -1], "noise": 0.02, "body": "stays"},
        "start": {"z": [1, 2], "rotation": [0, 0, 1]},
        "fingerprint": "ab",
    }
    path = write(tmp_path / "h.json", json.dumps(data))
    found = io.load_handles(path, 5, components=2)
    one = io.HandleTarget(1, (0.0, 0.0, 0.0), gap=(0.0, 0.5, 0.0))
    assert found.frames == ((one, io.HandleTarget(1, (1.0, 0.0, 0.0), region=0)),)
    assert found.regions == ((1, 2, 3),)
    assert found.prior == io.HandlePrior((0.5, -1.0), 0.02, "stays")
    assert found.start == io.HandleStart((1.0, 2.0), (0.0, 0.0, 1.0))
    found.check_model(path, "ab")
    with pytest.raises(InputError, match=r"h\.json: fingerprint: .*\(ab\).*\(cd\)"):
        found.check_model(path, "cd")
    io.HandleFile((), False).check_model(path, "cd")
    for change, part in [
        ({"prior": {"mean": [1, 2, 3]}}, "prior.mean: expected a list of 2"),
        ({"prior": {"noise": 0}}, "prior.noise: expected a finite number above 0"),
        ({"prior": {"body": "runs"}}, "prior.body: expected"),
        ({"prior": {"strength": 1}}, "prior: unknown key 'strength'"),
        ({"noise": 1.0}, "prior.noise: the file also has noise"),
        ({"start": {"z": [1]}}, "start.z: expected a list of 2"),
        ({"start": {"rotation": [0, 0, 0]}}, "start: no 'z'"),
        ({"start": {"z": [1, 2], "translation": [0, 1e999, 0]}}, "start.translation[1]"),
        ({"fingerprint": 7}, "fingerprint: expected"),
        ({"regions": [[1, 5]]}, "regions[0][1]: expected"),
        ({"regions": [[]]}, "regions[0]: expected a list of at least one vertex"),
        ({"regions": []}, "handles[1].region: expected no region"),
        ({"handles": [{**painted, "region": 1}]}, "handles[0].region: expected"),
        ({"handles": [painted, painted]}, "vertex 1 of region 0 already has handle 0"),
        ({"handles": [{**alone, "gap": [0, 1]}]}, "handles[0].gap: expected a list of 3"),
    ]:
        write(path, json.dumps({**data, **change}))
        message = refusal(io.load_handles, path, 5, None, 2)
        assert f"h.json: {part}" in message or part in message


@pytest.mark.parametrize("key", ["start", "regions"])
def test_frames_have_no_state_of_one_pose(tmp_path, key):
    value = {"z": [1.0]} if key == "start" else [[1]]
    data = {"frames": [[{"vertex": 1, "position": [0, 0, 0]}]], key: value}
    message = refusal(io.load_handles, write(tmp_path / "h.json", json.dumps(data)), 5)
    assert f"h.json: {key}: the file has frames" in message
    frames = [[{"vertex": 1, "position": [0, 0, 0], "region": 0}]]
    path = write(tmp_path / "h.json", json.dumps({"frames": frames}))
    assert "unknown key" in refusal(io.load_handles, path, 5)


def test_what_else_a_sequence_needs(tmp_path):
    """The prior with a mean for each frame, the smoothness, rounds of relaxation, a floor, gaps."""
    frames = [[{"vertex": 1, "position": [0, 0, 0], "gap": [0, 0.5, 0]}], []]
    data = {
        "frames": frames,
        "prior": {"means": [[0.5, -1], [1, 2]], "noise": 0.02, "body": "auto"},
        "smoothness": 3,
        "relaxation": 4,
        "key_frames": [1, 0],
        "floor": -0.5,
        "fingerprint": "ab",
    }
    path = write(tmp_path / "h.json", json.dumps(data))
    found = io.load_handles(path, 5, components=2)
    assert found.frames[0][0].gap == (0.0, 0.5, 0.0)
    assert found.prior == io.HandlePrior(None, 0.02, "auto", ((0.5, -1.0), (1.0, 2.0)))
    assert (found.smoothness, found.relaxation, found.floor) == (3.0, 4, -0.5)
    assert found.key_frames == (1, 0)
    for change, part in [
        ({"prior": {"means": [[1, 2]]}}, "prior.means: expected a list of 2"),
        ({"prior": {"means": [[1, 2], [1]]}}, "prior.means[1]: expected a list of 2"),
        ({"prior": {"means": [], "mean": [1, 2]}}, "prior.means: the prior also has mean"),
        ({"smoothness": -1}, "smoothness: expected"),
        ({"relaxation": 1.5}, "relaxation: expected"),
        ({"relaxation": 1001}, "relaxation: expected"),
        ({"key_frames": 0}, "key_frames: expected"),
        ({"key_frames": [0, 2]}, "key_frames[1]: expected"),
    ]:
        write(path, json.dumps({**data, **change}))
        assert f"h.json: {part}" in refusal(io.load_handles, path, 5, None, 2)
    for key in ("smoothness", "relaxation", "key_frames"):
        write(path, json.dumps({"handles": frames[0], key: 1}))
        assert f"{key}: the file has one pose" in refusal(io.load_handles, path, 5)


@pytest.mark.parametrize("missing", [None, [None] * 3])
def test_handles_that_are_not_seen_are_left_out(tmp_path, missing):
    one = {"vertex": 4, "position": [1, 2.5, -3]}
    frames = [[one, {"vertex": 2, "position": missing}], [], [{"vertex": 4, "position": missing}]]
    path = write(tmp_path / "h.json", json.dumps({"frames": frames}))
    seen = io.HandleTarget(4, (1.0, 2.5, -3.0))
    assert io.load_handles(path, 5) == io.HandleFile(((seen,), (), ()), True)


HANDLE = '{"vertex": 1, "position": [0, 0, 0]}'


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("{}", ["'handles' or 'frames'"]),
        (f'{{"handles": [{HANDLE}], "frames": [[{HANDLE}]]}}', ["'handles' or 'frames'"]),
        ('{"handles": []}', ["handles", "no handle has a position"]),
        *(
            (f'{{"handles": [{HANDLE}], "noise": {noise}}}', ["noise: expected a finite number"])
            for noise in ("0", "-1", "NaN", "null", '"1"', "true", "[1]")
        ),
        ('{"frames": [[], [{"vertex": 1, "position": null}]]}', ["frames", "no handle has"]),
        ('{"handles": {}}', ["a list"]),
        ('{"frames": []}', ["list of frames"]),
        (f'{{"handles": [{HANDLE}, 7]}}', ["handles[1]", "7"]),
        ('{"handles": [{"vertex": 1}]}', ["handles[0]", "position"]),
        (f'{{"handles": [{HANDLE}, {HANDLE}]}}', ["handles[1]", "vertex 1", "handle 0"]),
        (f'{{"frames": [[{HANDLE}], [{HANDLE.replace("1", "5")}]]}}', ["frames[1][0]", "5"]),
        (f'{{"handles": [{HANDLE.replace("1", "-1")}]}}', ["handles[0]", "-1", "0…4"]),
        (f'{{"handles": [{HANDLE.replace("1", "true")}]}}', ["handles[0]", "True"]),
        (f'{{"handles": [{HANDLE.replace("1", "1.0")}]}}', ["handles[0]", "1.0"]),
        (f'{{"handles": [{HANDLE.replace("0, 0, 0", "0, 0")}]}}', ["position", "[0, 0]"]),
        (f'{{"handles": [{HANDLE.replace("0, 0, 0", "0, NaN, 0")}]}}', ["handles[0]", "nan"]),
        (f'{{"handles": [{HANDLE.replace("0, 0, 0", "0, 1e999, 0")}]}}', ["handles[0]", "inf"]),
        (f'{{"handles": [{HANDLE.replace("0, 0, 0", f"0, {10**400}, 0")}]}}', ["handles[0]"]),
        (f'{{"handles": [{HANDLE.replace("0, 0, 0", "0, null, 0")}]}}', ["handles[0]", "None"]),
        (f'{{"handles": [{HANDLE[:-1]}, "weight": 0}}]}}', ["handles[0]", "weight"]),
        (f'{{"handles": [{HANDLE[:-1]}, "weight": "1"}}]}}', ["handles[0]", "weight", "'1'"]),
        (f'{{"handles": [{HANDLE[:-1]}, "wait": 1}}]}}', ["handles[0]", "'wait'"]),
    ],
)  # fmt: skip
def test_handle_errors(tmp_path, text, parts):
    message = refusal(io.load_handles, write(tmp_path / "handles.json", text), 5)
    for part in ["handles.json", *parts]:
        assert part in message


def test_a_mesh_like_another_has_its_triangles(tmp_path):
    """Its quads may begin at another corner, and come in another order."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]])
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in points.tolist())
    (tmp_path / "a.obj").write_text(text + "f 1 2 3 4\nf 2 5 6 3\n")
    (tmp_path / "b.obj").write_text(text + "f 6 3 2 5\nf 2 3 4 1\n")
    (tmp_path / "c.obj").write_text(text + "f 6 3 2 5\nf 2 1 4 3\n")
    first = io.load_mesh(tmp_path / "a.obj")
    assert not np.array_equal(io.load_mesh(tmp_path / "b.obj").faces, first.faces)
    np.testing.assert_array_equal(io.load_mesh(tmp_path / "b.obj", first).faces, first.faces)
    with pytest.raises(InputError, match=r"c\.obj: 6 vertices and 4 triangles, .* other triangles"):
        io.load_mesh(tmp_path / "c.obj", first)
    with pytest.raises(InputError, match=r"other shapes, 3 and 1"):
        io.load_mesh(tmp_path / "b.obj", Mesh(points[:3], [[0, 1, 2]]))
