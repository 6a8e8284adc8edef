"""MDD and PC2 files, byte by byte, and the mesh beside them."""

import struct

import numpy as np
import pytest

import tubes
from deformer import InputError, MeshSequence, load_mesh, save_shapes


@pytest.fixture
def shapes(tmp_path):
    (tmp_path / "tube.obj").write_bytes(tubes.obj())
    faces = load_mesh(tmp_path / "tube.obj").faces
    vertices = np.stack([tubes.positions(bend) for bend in (0.0, 0.5, 1.0)])
    return MeshSequence(vertices, faces)


def test_mdd_has_counts_times_and_points_in_big_endian(tmp_path, shapes):
    saved = save_shapes(tmp_path / "walk.mdd", shapes, fps=8)
    data = (tmp_path / "walk.mdd").read_bytes()
    assert struct.unpack(">ii", data[:8]) == (3, 40)
    assert struct.unpack(">fff", data[8:20]) == (0.0, 0.125, 0.25)
    points = np.frombuffer(data[20:], ">f4").reshape(3, 40, 3)
    np.testing.assert_array_equal(points, shapes.vertices.astype("f4"))
    assert saved.files == (tmp_path / "walk.mdd", tmp_path / "walk.obj") and saved.targets is None


def test_pc2_has_a_sample_for_each_frame_in_little_endian(tmp_path, shapes):
    save_shapes(tmp_path / "walk.pc2", shapes, fps=8)
    data = (tmp_path / "walk.pc2").read_bytes()
    assert data[:12] == b"POINTCACHE2\0"
    assert struct.unpack("<iiffi", data[12:32]) == (1, 40, 0.0, 1.0, 3)
    points = np.frombuffer(data[32:], "<f4").reshape(3, 40, 3)
    np.testing.assert_array_equal(points, shapes.vertices.astype("f4"))


@pytest.mark.parametrize("suffix", [".mdd", ".pc2"])
def test_the_mesh_beside_a_cache_is_like_the_document(tmp_path, shapes, suffix):
    path = tmp_path / f"walk{suffix}"
    save_shapes(path, shapes, like=tmp_path / "tube.obj")
    assert b"usemtl skin" in (tmp_path / "walk.obj").read_bytes()
    np.testing.assert_array_equal(load_mesh(tmp_path / "walk.obj").vertices, shapes.vertices[0])
    (tmp_path / "tube.ply").write_bytes(tubes.ply("<"))
    side = load_mesh(tmp_path / "tube.ply")
    other = MeshSequence(np.stack([side.vertices, side.vertices + 1]), side.faces)
    saved = save_shapes(tmp_path / f"side{suffix}", other, like=tmp_path / "tube.ply")
    assert saved.files[1] == tmp_path / "side.ply"
    assert b"property double quality" in (tmp_path / "side.ply").read_bytes()


def test_a_mesh_of_the_same_connectivity_stays_and_another_is_refused(tmp_path, shapes):
    text = tubes.obj(0.3)
    (tmp_path / "walk.obj").write_bytes(text)
    save_shapes(tmp_path / "walk.mdd", shapes)
    assert (tmp_path / "walk.obj").read_bytes() == text
    before = (tmp_path / "walk.mdd").read_bytes()
    (tmp_path / "walk.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"walk.obj: is another mesh, expected .* walk.mdd"):
        save_shapes(tmp_path / "walk.mdd", shapes)
    assert (tmp_path / "walk.mdd").read_bytes() == before


@pytest.mark.parametrize("suffix", [".mdd", ".pc2"])
def test_positions_beyond_single_precision_are_refused(tmp_path, shapes, suffix):
    far = MeshSequence(shapes.vertices * 1e45, shapes.faces)
    with pytest.raises(InputError, match="single-precision"):
        save_shapes(tmp_path / f"walk{suffix}", far)
    assert not [p.name for p in tmp_path.iterdir() if "walk" in p.name]
