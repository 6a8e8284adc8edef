"""Truths of the builder of GLB files, read back by trimesh and byte for byte."""

import io
import json

import numpy as np
import pytest
import trimesh

from deformer.io import INDICES, VERTICES, GlbBuilder

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])


def parts(data):
    """JSON and binary chunk of a GLB file, by the lengths that it states."""
    assert data[:4] == b"glTF" and int.from_bytes(data[8:12], "little") == len(data)
    length = int.from_bytes(data[12:16], "little")
    text, rest = data[20 : 20 + length], data[20 + length :]
    assert len(data) % 4 == length % 4 == 0
    assert not rest or int.from_bytes(rest[:4], "little") == len(rest) - 8
    return json.loads(text), rest[8:]


def array_of(data, index):
    """An accessor's rows as glTF 2.0 lays them out."""
    described, binary = parts(data)
    accessor = described["accessors"][index]
    view = described["bufferViews"][accessor["bufferView"]]
    kind = {5126: "<f4", 5121: "u1", 5123: "<u2", 5125: "<u4"}[accessor["componentType"]]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor["type"]]
    size = np.dtype(kind).itemsize
    stride = view.get("byteStride", width * size)
    shape, strides = (accessor["count"], width), (stride, size)
    return np.ndarray(shape, kind, binary, view["byteOffset"], strides)


def test_a_mesh_is_read_by_another_program():
    asset = GlbBuilder()
    positions = asset.add_array(TRIANGLE, VERTICES)
    corners = asset.add_array(np.array([0, 1, 2], dtype=np.uint16), INDICES)
    primitive = {"attributes": {"POSITION": positions}, "indices": corners}
    mesh = asset.add("meshes", {"primitives": [primitive]})
    asset.add("scenes", {"nodes": [asset.add("nodes", {"mesh": mesh, "name": "one"})]})
    scene = trimesh.load_scene(io.BytesIO(asset.data), file_type="glb")
    (found,) = scene.geometry.values()
    np.testing.assert_array_equal(found.vertices, TRIANGLE)
    accessor = asset.json["accessors"][positions]
    assert accessor["min"] == [0, 0, 0] and accessor["max"] == [1, 2, 0]


@pytest.mark.parametrize("kind", ["u1", "<u2", "<u4", "<f4"])
@pytest.mark.parametrize("target", [VERTICES, INDICES, None])
@pytest.mark.parametrize("row", [(), (2,), (3,), (4,)])
def test_arrays_come_back(kind, target, row):
    """Also after bytes that end at no multiple of four; rows of vertices begin at one."""
    asset = GlbBuilder()
    asset.add_bytes(b"odd")
    array = np.arange(5 * int(np.prod(row, dtype=int))).astype(kind).reshape(5, *row)
    index = asset.add_array(array, target)
    np.testing.assert_array_equal(array_of(asset.data, index), array.reshape(5, -1))
    view = asset.json["bufferViews"][1]
    assert view["byteOffset"] % 4 == 0
    if target == VERTICES:
        assert view.get("byteStride", array[0].nbytes) % 4 == 0


def test_matrices_are_stored_by_columns():
    asset = GlbBuilder()
    matrices = np.arange(32.0).reshape(2, 4, 4)
    index = asset.add_array(matrices)
    found = array_of(asset.data, index)
    np.testing.assert_array_equal(found.reshape(2, 4, 4), matrices.swapaxes(1, 2))


def test_extensions_are_named_once():
    asset = GlbBuilder()
    asset.use_extension("KHR_mesh_quantization", required=True)
    asset.use_extension("KHR_mesh_quantization")
    described, binary = parts(asset.data)
    assert described["extensionsUsed"] == described["extensionsRequired"]
    assert described["extensionsUsed"] == ["KHR_mesh_quantization"] and not binary
