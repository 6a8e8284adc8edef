"""Spellings that formats allow are read; damaged files are refused in one line, in bounds."""

import io as streams
import json
import os
import struct
import time
import tracemalloc
import zipfile

import numpy as np
import pytest

from deformer import io
from deformer.errors import InputError
from deformer.geometry import Mesh

POINTS = np.array(
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1.5, 1.25, 0.5], [0.125, 0.25, 3], [7, 0.5, 7]]
)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 4], [0, 3, 2], [3, 1, 4], [4, 2, 3]])
DIGITS = "1" * 5000


def write(path, content):
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def refusal(path):
    with pytest.raises(InputError) as caught:
        io.load_shapes(path)
    message = str(caught.value)
    assert "\n" not in message
    assert "allow_pickle" not in message
    assert path.name in message
    return message


def saved(suffix, folder):
    """Contents of a file that `deformer` writes."""
    path = folder / f"valid.{suffix}"
    if suffix == "npz":
        io.write_npz(path, {"vertices": POINTS[None], "faces": FACES})
    else:
        io.save_mesh(path, Mesh(POINTS, FACES))
    return path.read_bytes()


ROWS = "".join(f"{x} {y} {z}\n" for x, y, z in POINTS)
TRIANGLES = "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)
OFF = f"OFF\n7 6 0\n{ROWS}{TRIANGLES}"
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in POINTS)
OBJ += "".join(f"f {a} {b} {c}\n" for a, b, c in FACES + 1)
XYZ = "property double x\nproperty double y\nproperty double z\n"
LIST = "property list uchar int vertex_indices\n"
HEADER = f"ply\nformat {{}} 1.0\nelement vertex 7\n{XYZ}element face 6\n{LIST}end_header\n"
PLY = HEADER.format("ascii") + ROWS + TRIANGLES
BINARY_PLY = HEADER.format("binary_little_endian").encode() + POINTS.tobytes()
BINARY_PLY += b"".join(struct.pack("<B3i", 3, *face) for face in FACES)


def stl_text(keyword=str):
    lines = ["solid a"]
    for face in FACES:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in POINTS[face]]
        lines += ["endloop", "endfacet"]
    return keyword("\n".join([*lines, "endsolid a", ""]))


def stl_binary(header=b"", count=6, rest=b""):
    soup = np.zeros(len(FACES), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("_", "<u2")])
    soup["corners"] = POINTS[FACES]
    return header.ljust(80) + struct.pack("<I", count) + soup.tobytes() + rest


# Spellings


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("glued.off", OFF.replace("OFF\n", "OFF")),
        ("glued-lower.off", OFF.replace("OFF\n", "off")),
        ("lower.off", OFF.replace("OFF", "off")),
        ("variant.off", OFF.replace("OFF", "coff").replace("\n0 ", "\n0  ")),
        ("SUFFIX.OFF", OFF),
        ("upper.OBJ", OBJ.upper()),
        ("indented.obj", "\n".join("  " + line for line in OBJ.upper().splitlines())),
        ("utf-8.obj", OBJ.encode("utf-8-sig")),
        ("utf-16-le.obj", OBJ.encode("utf-16")),
        ("utf-16-be.obj", b"\xfe\xff" + OBJ.encode("utf-16-be")),
        ("utf-16.off", OFF.encode("utf-16")),
        ("utf-16.ply", PLY.encode("utf-16")),
        ("cr.ply", PLY.replace("\n", "\r")),
        ("crlf.ply", PLY.replace("\n", "\r\n")),
        ("cr-binary.ply", BINARY_PLY.partition(b"end_")[0].replace(b"\n", b"\r")
            + b"end_header\r" + BINARY_PLY.partition(b"end_header\n")[2]),
        ("comment.ply", PLY.replace("element face", "comment before end_header\nelement face")),
        ("upper.ply", HEADER.format("ascii").upper() + ROWS + TRIANGLES),
        ("blank-end.ply", BINARY_PLY + b"\n"),
        ("empty-element.ply", PLY.replace("end_header", "element camera 0\nend_header")),
    ],
)  # fmt: skip
def test_spellings_are_read_exactly(tmp_path, name, content):
    mesh = io.load_mesh(write(tmp_path / name, content))
    np.testing.assert_array_equal(mesh.vertices, POINTS)
    np.testing.assert_array_equal(mesh.faces, FACES)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("upper.stl", stl_text(str.upper)),
        ("UPPER.STL", stl_text()),
        ("utf-16.stl", stl_text().encode("utf-16")),
        ("two.stl", stl_text().replace("endfacet\n", "endfacet\nendsolid\nsolid b\n", 1)),
        ("solid.stl", stl_binary(b"solid made by exporter")),
        ("trailing.stl", stl_binary(b"solid made by exporter", rest=b"\0\0\0\0")),
    ],
)
def test_spellings_of_stl_are_read_exactly(tmp_path, name, content):
    mesh = io.load_mesh(write(tmp_path / name, content))
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], POINTS[FACES])


def test_a_binary_body_may_begin_with_a_line_feed_after_a_header_of_carriage_returns(tmp_path):
    points = POINTS.copy()
    points[0, 0] = np.frombuffer(b"\n\0\0\0\0\0\0?")[0]
    header = HEADER.format("binary_little_endian").replace("\n", "\r").encode()
    body = points.tobytes() + b"".join(struct.pack("<B3i", 3, *face) for face in FACES)
    mesh = io.load_mesh(write(tmp_path / "a.ply", header + body))
    assert mesh.vertices.tobytes() == points.tobytes()


# GLB


def glb(scene, binary):
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def glb_scene():
    binary = FACES.astype("<u4").tobytes() + POINTS.astype("<f4").tobytes()
    scene = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 1}, "indices": 0}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5125, "count": 18, "type": "SCALAR"},
            {"bufferView": 1, "componentType": 5126, "count": 7, "type": "VEC3"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 72},
            {"buffer": 0, "byteOffset": 72, "byteLength": 84},
        ],
        "buffers": [{"byteLength": 156}],
    }
    return scene, binary


def chain(length, copies):
    """Nodes that list the next one `copies` times; the last shows the mesh."""
    return [{"children": [i + 1] * copies} for i in range(length)] + [{"mesh": 0}]


def test_glb_of_a_deep_chain_is_read(tmp_path):
    scene, binary = glb_scene()
    scene["nodes"] = chain(3000, 1)
    mesh = io.load_mesh(write(tmp_path / "a.glb", glb(scene, binary)))
    np.testing.assert_array_equal(mesh.vertices, POINTS)


@pytest.mark.parametrize("kind", ["i1", "u1", "<i2", "<u2"])
@pytest.mark.parametrize("normalized", [False, True])
def test_glb_quantised_positions_are_read_exactly(tmp_path, kind, normalized):
    """The values are those of glTF 2.0, 3.6.2.2, and the node's transform is applied to them."""
    scene, _ = glb_scene()
    limits = np.iinfo(kind)
    stored = np.zeros((7, 4), kind)
    stored[:, :3] = np.random.default_rng(0).integers(limits.min, limits.max, (7, 3), endpoint=True)
    stored[0, :2] = limits.min, limits.max
    length = stored.nbytes
    number = {"i1": 5120, "u1": 5121, "<i2": 5122, "<u2": 5123}[kind]
    scene["accessors"][1].update(componentType=number, normalized=normalized)
    scene["bufferViews"][1].update(byteLength=length, byteStride=length // 7)
    scene["nodes"] = [{"mesh": 0, "scale": [0.5, 0.25, 2], "translation": [1, 2, 3]}]
    binary = FACES.astype("<u4").tobytes() + stored.tobytes()
    path = tmp_path / "a.glb"
    assert "quantisation" in refusal(write(path, glb(scene, binary)))
    scene["extensionsUsed"] = scene["extensionsRequired"] = ["KHR_mesh_quantization"]
    mesh = io.load_mesh(write(path, glb(scene, binary)))
    expected = stored[:, :3].astype(float)
    if normalized:
        expected = np.maximum(expected / limits.max, -1)
    np.testing.assert_array_equal(mesh.vertices, expected * [0.5, 0.25, 2] + [1, 2, 3])
    np.testing.assert_array_equal(mesh.faces, FACES)


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (lambda s: s.update(nodes=chain(40, 2)), ["node 40", "one parent"]),
        (lambda s: s.update(nodes=[*chain(40, 2)[:-1], {}]), ["node 40", "one parent"]),
        (lambda s: s.update(nodes=[{"children": [0]}]), ["node 0", "one parent"]),
        (lambda s: s.update(nodes=[{"children": [1]}, {"children": [0]}]), ["one parent"]),
        (lambda s: s.update(nodes=[{"children": [-1]}]), ["node 0", "-1"]),
        (lambda s: s.update(nodes=[{"children": 3}]), ["node 0", "children 3", "a list"]),
        (lambda s: s.update(nodes=[{"mesh": -1}]), ["node 0", "-1", "meshes"]),
        (lambda s: s.update(nodes=[{"mesh": 0, "rotation": [5] * 4}]), ["node 0", "rotation"]),
        (lambda s: s.update(nodes=[{"mesh": 0, "rotation": ["a"] * 4}]), ["node 0", "rotation"]),
        (lambda s: s.update(nodes=[{"mesh": 0, "scale": [1, 2]}]), ["node 0", "scale"]),
        (lambda s: s.update(nodes=[{"mesh": 0, "scale": [10**400] * 3}]), ["node 0", "scale"]),
        (lambda s: s.update(nodes=[{"mesh": 0, "scale": [1e308] * 3}]), ["node 0", "scale"]),
        (lambda s: s.update(scene=-1), ["scenes", "-1"]),
        (lambda s: s.update(meshes=[{"primitives": [3]}]), ["mesh 0 primitive 0"]),
        (lambda s: s.update(meshes=[{"primitives": [{}]}]), ["mesh 0 primitive 0", "accessors"]),
        (lambda s: s.update(meshes=[{}]), ["mesh 0", "no primitives"]),
        (lambda s: s.update(meshes=[3]), ["meshes", "no object"]),
        (lambda s: s["meshes"][0]["primitives"][0]["attributes"].update(POSITION=-1), ["-1"]),
        (lambda s: s["accessors"][1].update(bufferView=-1), ["accessor 1", "-1"]),
        (lambda s: s["accessors"][1].update(type="SCALAR"), ["accessor 1", "SCALAR", "VEC3"]),
        (lambda s: s["accessors"][0].update(type="VEC3"), ["accessor 0", "VEC3", "SCALAR"]),
        (lambda s: s["accessors"][1].update(byteOffset=2**63), ["accessor 1", "byteOffset"]),
        (lambda s: s["accessors"][1].update(byteOffset=4), ["accessor 1", "byte 4"]),
        (lambda s: s["accessors"][1].update(count=3.5), ["accessor 1", "count 3.5"]),
        (lambda s: s["accessors"][1].update(count=-7), ["accessor 1", "count -7"]),
        (lambda s: s["bufferViews"][1].update(byteStride=0), ["accessor 1", "0 apart"]),
        (lambda s: s["bufferViews"][1].update(byteStride=-12), ["accessor 1", "-12"]),
        (lambda s: s["bufferViews"][1].update(byteLength=4), ["accessor 1", "view of 4 bytes"]),
        (lambda s: s["bufferViews"][1].update(byteLength=88), ["accessor 1", "byte 160 of 156"]),
        (lambda s: s["bufferViews"][1].update(buffer=-1), ["accessor 1", "buffers"]),
        (lambda s: s.update(extensionsRequired=["KHR_draco_mesh_compression"]), ["Draco"]),
        (lambda s: s.update(extensionsRequired=["EXT_meshopt_compression"]), ["meshopt"]),
    ],
)  # fmt: skip
def test_glb_that_is_damaged_is_refused_by_element(tmp_path, change, parts):
    scene, binary = glb_scene()
    change(scene)
    message = refusal(write(tmp_path / "a.glb", glb(scene, binary)))
    for part in parts:
        assert part in message


def test_glb_with_zero_stride_and_a_large_count_is_refused_from_its_header(tmp_path):
    scene, binary = glb_scene()
    for part in (0, 1):
        scene["accessors"][part]["count"] = 300_000_000
        scene["bufferViews"][part]["byteStride"] = 0
    assert "300000000 items" in refusal(write(tmp_path / "a.glb", glb(scene, binary)))


def test_glb_whose_nodes_repeat_a_mesh_without_end_is_refused(tmp_path, monkeypatch):
    scene, binary = glb_scene()
    scene["nodes"] = [{"mesh": 0}] * 100
    scene["scenes"] = [{"nodes": list(range(100))}]
    path = write(tmp_path / "a.glb", glb(scene, binary))
    assert io.load_mesh(path).vertices.shape == (700, 3)
    monkeypatch.setattr("deformer.io.gltf_meshes._MOST_ITEMS", 20_000)
    assert "repeat their meshes" in refusal(path)


# Text and PLY


@pytest.mark.parametrize(
    ("name", "content", "parts"),
    [
        ("a.off", OFF.replace("7 6 0", "7 5 0"), ["line 15", "3 4 2 3", "5 faces"]),
        ("a.off", OFF + "junk\n", ["line 16", "junk"]),
        ("a.off", OFF.replace("7 6 0", "7 7 0"), ["13 lines", "7 faces", "cut short"]),
        ("a.off", OFF.replace("7 6 0", f"7 {DIGITS} 0"), ["line 2", "counts"]),
        ("a.off", OFF.replace("7 6 0", "7.5 6 0"), ["line 2", "counts"]),
        ("a.off", OFF.replace("7 6 0", "-7 6 0"), ["line 2", "counts"]),
        ("a.off", OFF.replace("3 4 2 3", DIGITS), ["line 15", "corner count"]),
        ("a.off", OFF.replace("3 4 2 3", "3 4 2 3.5"), ["line 15", "3.5"]),
        ("a.off", OFF.replace("3 4 2 3", f"3 4 2 {DIGITS}"), ["line 15"]),
        ("a.off", OFF.replace("OFF", "nOFF"), ["nOFF"]),
        ("a.obj", OBJ.replace("f 5 3 4", "f 5 3 4.5"), ["line 13", "4.5"]),
        ("a.obj", OBJ.replace("f 5 3 4", f"f 5 3 {DIGITS}"), ["line 13"]),
        ("a.obj", OBJ.encode("utf-16")[:-1], ["UTF-16"]),
        ("a.obj", OBJ.replace("v 1.0", "v 1,0"), ["line 2", "1,0"]),
        ("a.ply", PLY.replace("vertex 7", f"vertex {DIGITS}"), ["line 3", "element vertex"]),
        ("a.ply", PLY.replace("vertex 7", "vertex 7.5"), ["line 3", "element vertex"]),
        ("a.ply", PLY.replace("3 4 2 3", DIGITS), ["line 22", "111"]),
        ("a.ply", PLY.replace("3 4 2 3", "3.7 4 2 3"), ["line 22", "3.7"]),
        ("a.ply", PLY.replace("3 4 2 3", "3 4 2 3.5"), ["line 22", "3.5"]),
        ("a.ply", PLY.replace("3 4 2 3", "3 4 2 3 3"), ["line 22", "3 4 2 3 3"]),
        ("a.ply", PLY.replace("1.0 0.0 0.0", "1.0 0.0 0.0 9"), ["line 11", "3 numbers"]),
        ("a.ply", PLY + "junk\n", ["line 23", "junk"]),
        ("a.ply", PLY.replace("double y", "double x"), ["line 5", "'vertex' once"]),
        ("a.ply", PLY.replace("elem", "elm"), ["line 3", "elment vertex"]),
        ("a.ply", PLY.replace(f"element face 6\n{LIST}",
            f"element face 3\n{LIST}element face 3\n{LIST}"), ["line 9", "element face"]),
        ("a.ply", PLY.replace("element face", f"element vertex 7\n{XYZ}element face"),
            ["line 7", "element vertex"]),
    ],
)  # fmt: skip
def test_text_that_is_damaged_is_refused_by_line(tmp_path, name, content, parts):
    message = refusal(write(tmp_path / name, content))
    for part in parts:
        assert part in message


FLOAT_LIST = BINARY_PLY.partition(b"end_header\n")[0].replace(b"uchar int", b"uchar float")
FLOAT_LIST += b"end_header\n" + POINTS.tobytes()


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (BINARY_PLY + b"junk" * 100, ["400 bytes", "'face'"]),
        (BINARY_PLY.replace(b"vertex 7", b"vertex 6"), ["'face'"]),
        (BINARY_PLY.replace(b"vertex 7", b"vertex 999999999999"), ["'vertex'", "999999999999"]),
        (BINARY_PLY.replace(b"face 6", b"face 999999999999"), ["'face'", "999999999999"]),
        (BINARY_PLY.replace(b"list uchar", b"list double"), ["line 8", "integer type"]),
        (BINARY_PLY.replace(b"double y", b"double x"), ["line 5", "'vertex' once"]),
        (BINARY_PLY.replace(b"list uchar", b"list uint"), ["'face'"]),
        (FLOAT_LIST + struct.pack("<B3f", 3, 0, 1, 2.5) * 6, ["face 0", "2.5"]),
        (FLOAT_LIST + struct.pack("<B3f", 3, 0, 1, np.nan) * 6, ["face 0", "nan"]),
        (FLOAT_LIST + struct.pack("<B3f", 3, 0, 1, np.inf) * 6, ["face 0", "inf"]),
    ],
)
def test_binary_ply_that_is_damaged_is_refused_by_element(tmp_path, content, parts):
    message = refusal(write(tmp_path / "a.ply", content))
    for part in parts:
        assert part in message


def test_binary_ply_with_whole_numbers_as_floats_is_read(tmp_path):
    content = FLOAT_LIST + b"".join(struct.pack("<B3f", 3, *face) for face in FACES)
    np.testing.assert_array_equal(io.load_mesh(write(tmp_path / "a.ply", content)).faces, FACES)


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (stl_text()[: stl_text().rindex("facet normal")], ["without 'endsolid'"]),
        (stl_text().replace("endsolid a\n", ""), ["without 'endsolid'"]),
        (stl_text().replace("vertex", "vertax", 3), ["line 4", "vertax"]),
        (stl_text().replace("endfacet\n", "", 1), ["line 8", "facet normal", "'endfacet'"]),
        (stl_text().replace("endloop", "vertex 0 0 0\nendloop", 1), ["line 7", "'endloop'"]),
        (stl_text().replace("vertex 0.0 0.0 0.0", "vertex 0.0 0.0 0.0 0.0", 1), ["line 4"]),
        (stl_text() + "junk\n", ["junk", "'solid'"]),
        (b"solid x\nvertex 0 0 0\n" + b"\xff\0garbage" * 40, ["bytes"]),
        (stl_binary(rest=bytes(50)), ["6 triangles"]),
        (stl_binary(count=5), ["5 triangles"]),
        (stl_binary(count=7), ["7 triangles"]),
        (stl_binary(count=0), ["0 triangles"]),
    ],
)
def test_stl_with_missing_or_extra_facets_is_refused(tmp_path, content, parts):
    message = refusal(write(tmp_path / "a.stl", content))
    for part in parts:
        assert part in message


# NPZ


def npz(header, faces=FACES, values=POINTS, name="vertices.npy", method=zipfile.ZIP_DEFLATED):
    """An archive whose array of vertices has any header, with right checksums."""
    stored = streams.BytesIO()
    np.save(stored, faces)
    with zipfile.ZipFile(archive := streams.BytesIO(), "w", method) as target:
        text = header.encode().ljust(117) + b"\n"
        target.writestr(name, b"\x93NUMPY\x01\0" + struct.pack("<H", 118) + text + values.tobytes())
        target.writestr("faces.npy", stored.getvalue())
    return archive.getvalue()


HEAD = "{'descr': '<f8', 'fortran_order': False, 'shape': (7, 3)}"
OBJECTS = HEAD.replace("<f8", "|O")


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (npz(HEAD.replace("7, 3", "1000000000000, 3")), ["'vertices'", "168 bytes"]),
        (npz(HEAD.replace("7, 3", "2**64, 3")), ["'vertices'", "header"]),
        (npz(HEAD.replace("7, 3", "18446744073709551616, 3")), ["'vertices'", "168 bytes"]),
        (npz(HEAD.replace("7, 3", "-7, -3")), ["'vertices'", "168 bytes"]),
        (npz(HEAD.replace("7, 3", "")), ["'vertices'", "168 bytes"]),
        (npz(HEAD.replace("7, 3)", "7")), ["'vertices'", "header"]),
        (npz(HEAD.replace("7, 3", "21,")), ["vertices", "(N, V, 3)"]),
        (npz(HEAD.replace("7, 3", "1, 1, 7, 3")), ["vertices", "(N, V, 3)"]),
        (npz("(" * 110), ["'vertices'", "header"]),
        (npz(OBJECTS), ["'vertices'", "plain number arrays"]),
        (npz(HEAD, values=POINTS[:0]), ["'vertices'", "0 bytes"]),
        (npz(HEAD, name="vertices.nzy"), ["'vertices.nzy'", "add 'vertices'"]),
        (npz(HEAD)[:200], ["NPZ"]),
        (npz(HEAD).replace(b"vertices.npy", b"vortices.npy", 1), ["damaged"]),
    ],
)
def test_npz_that_is_damaged_is_refused_by_array(tmp_path, content, parts):
    message = refusal(write(tmp_path / "a.npz", content))
    for part in parts:
        assert part in message


def test_npz_with_a_wrong_checksum_is_refused(tmp_path):
    content = npz(HEAD, method=zipfile.ZIP_STORED).replace(np.float64(1.25).tobytes(), b"damaged!")
    assert "'vertices': its header or checksum" in refusal(write(tmp_path / "a.npz", content))


def test_npz_that_would_fill_the_memory_is_refused(tmp_path, monkeypatch):
    shape = (1, 500_000, 3)
    content = npz(HEAD.replace("(7, 3)", str(shape)), values=np.zeros(shape))
    path = write(tmp_path / "a.npz", content)
    assert io.load_shapes(path).vertices.shape == shape
    monkeypatch.setattr("deformer.io.npz._MOST_UNPACKED", 10_000_000)
    assert "1500000 numbers" in refusal(path)


# All formats


COUNT = 150_000
TINY_ROWS = {
    "a.obj": b"v 0 0 0\nv 0 0 0\nv 0 0 0\n" + b"f\n" * COUNT,
    "b.obj": b"v \\\n" * COUNT + b"\nf 1 2 3\n",
    "a.off": b"OFF\n%d 1 0\n" % COUNT + b"0\n" * COUNT,
    "a.ply": HEADER.format("ascii").replace("face 6", f"face {COUNT}").encode()
    + ROWS.encode()
    + b"0\n" * COUNT,
    "b.ply": b"ply\nformat ascii 1.0\n"
    + b"".join(b"element e%d 0\n" % i for i in range(COUNT // 3))
    + b"end_header\n",
    "c.ply": b"ply\nformat ascii 1.0\nelement vertex 1\n"
    + b"".join(b"property int a%d\n" % i for i in range(COUNT // 3))
    + b"end_header\n0\n",
    "a.stl": b"solid\n" + b"\n" * COUNT,
}


@pytest.mark.parametrize("name", TINY_ROWS)
def test_many_tiny_rows_take_time_and_memory_in_proportion(tmp_path, name):
    path = write(tmp_path / name, TINY_ROWS[name])
    tracemalloc.start()
    start = time.process_time()
    refusal(path)
    seconds, peak = time.process_time() - start, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # 10 s and 1 GB for a file of 10 MB; tracing takes several times as long.
    assert seconds < 5
    assert peak < 100 * len(TINY_ROWS[name])


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.off", "a.stl", "a.glb", "a.npz"])
def test_only_regular_files_are_read(tmp_path, name):
    os.mkfifo(tmp_path / name)
    assert "pipe" in refusal(tmp_path / name)
    (tmp_path / "d" / name).mkdir(parents=True)
    (tmp_path / "link").mkdir()
    (tmp_path / "link" / name).symlink_to("/dev/zero")
    assert "device" in refusal(tmp_path / "link" / name)
