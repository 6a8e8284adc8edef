"""Shapes that are read into a file are those that are read into memory."""

import numpy as np
import pytest

from deformer import InputError, MeshSequence, StoredShapes, Workspace, examine, load_shapes
from deformer.animation import save_shapes
from deformer.io import save_shapes as save_folder, with_reference
from deformer.workspace import LEAST_MEMORY
from shapes import sequence


@pytest.fixture
def shapes():
    return sequence(7)


@pytest.fixture
def workspace(tmp_path):
    """One that leaves nothing in memory."""
    folder = tmp_path / "cache"
    folder.mkdir()
    return Workspace(LEAST_MEMORY, folder)


def assert_same(found, expected):
    assert isinstance(found, StoredShapes) and isinstance(expected, MeshSequence)
    np.testing.assert_array_equal(found.vertices[:], expected.vertices)
    np.testing.assert_array_equal(found.faces, expected.faces)
    assert found.names == expected.names and len(found) == len(expected)


@pytest.mark.parametrize("name", ["walk.npz", "walk.mdd", "walk.pc2", "walk.glb", "walk.usda"])
def test_a_file_of_several_shapes(tmp_path, shapes, workspace, name):
    if name.endswith("usda"):
        pytest.importorskip("pxr", reason="USD files need usd-core")
    path = tmp_path / name
    save_shapes(path, shapes)
    clip = "walk" if name.endswith("glb") else None
    assert_same(load_shapes(path, clip=clip, workspace=workspace), load_shapes(path, clip=clip))


def test_a_folder_and_its_reference(tmp_path, shapes, workspace):
    save_folder(tmp_path / "walk", shapes)
    found, expected = (
        load_shapes(tmp_path / "walk", workspace=workspace),
        load_shapes(tmp_path / "walk"),
    )
    assert_same(found, expected)
    assert with_reference(found, 3, workspace) == (found, 3)
    file = str(tmp_path / "walk" / "0002.ply")
    moved, index = with_reference(found, file, workspace)
    assert index == 0
    assert_same(moved, with_reference(expected, file)[0])


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("compressed", [True, False])
def test_npz_of_any_layout(tmp_path, shapes, workspace, order, compressed):
    path = tmp_path / "walk.npz"
    save = np.savez_compressed if compressed else np.savez
    vertices = np.asarray(shapes.vertices, dtype=np.float32, order=order)
    save(path, vertices=vertices, faces=shapes.faces)
    assert_same(load_shapes(path, workspace=workspace), load_shapes(path))


def test_one_shape_in_an_npz(tmp_path, shapes, workspace):
    path = tmp_path / "one.npz"
    np.savez(path, vertices=shapes.vertices[0], faces=shapes.faces)
    found = load_shapes(path, workspace=workspace)
    np.testing.assert_array_equal(found.vertices[0], shapes.vertices[0])


def test_small_sets_stay_in_memory(tmp_path, shapes):
    save_shapes(tmp_path / "walk.npz", shapes)
    found = load_shapes(tmp_path / "walk.npz", workspace=Workspace(1e10, tmp_path))
    assert isinstance(found, MeshSequence)


def test_a_position_that_is_not_finite_is_named(tmp_path, shapes, workspace):
    vertices = shapes.vertices.copy()
    vertices[5, 2, 1] = np.nan
    np.savez(tmp_path / "walk.npz", vertices=vertices, faces=shapes.faces)
    with pytest.raises(InputError, match=r"walk\.npz, shape 5, vertex 2: found .*nan"):
        load_shapes(tmp_path / "walk.npz", workspace=workspace)


def test_a_damaged_npz_is_one_line(tmp_path, shapes, workspace):
    path = tmp_path / "walk.npz"
    np.savez(path, vertices=shapes.vertices, faces=shapes.faces)
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 1  # of the positions: only the checksum tells
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"walk\.npz: not an NPZ archive, or a damaged one"):
        load_shapes(path, workspace=workspace)


def test_the_examination_finds_the_same(tmp_path, shapes, workspace):
    vertices = np.concatenate([shapes.vertices, shapes.vertices[2:3], shapes.vertices[:3] * 0.1])
    np.savez(tmp_path / "walk.npz", vertices=vertices, faces=shapes.faces)
    stored = load_shapes(tmp_path / "walk.npz", workspace=workspace)
    assert examine(stored).as_dict() == examine(load_shapes(tmp_path / "walk.npz")).as_dict()


def test_parts_of_stored_shapes(tmp_path, shapes, workspace):
    save_shapes(tmp_path / "walk.npz", shapes)
    stored = load_shapes(tmp_path / "walk.npz", workspace=workspace)
    some = stored.subset([5, 1, 2]).subset([2, 0])
    np.testing.assert_array_equal(some.vertices[:], shapes.vertices[[2, 5]])
    np.testing.assert_array_equal(some.mesh(-1).vertices, shapes.vertices[5])
    with pytest.raises(InputError, match="shape 2 does not exist"):
        some.mesh(2)
    with pytest.raises(InputError):
        stored.subset([7])
