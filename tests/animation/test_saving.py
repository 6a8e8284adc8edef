"""Sequences as directories and NPZ, what is checked beforehand, and what is refused."""

import numpy as np
import pytest

import tubes
from deformer import (
    InputError,
    MeshSequence,
    check_shapes_output,
    load_mesh,
    load_shapes,
    save_shapes,
)


@pytest.fixture
def shapes(tmp_path):
    (tmp_path / "tube.obj").write_bytes(tubes.obj())
    faces = load_mesh(tmp_path / "tube.obj").faces
    vertices = np.stack([tubes.positions(bend) for bend in (0.0, 0.5, 1.0)])
    return MeshSequence(vertices, faces, ("rest", "half", "full"))


def test_a_directory_is_like_the_document(tmp_path, shapes):
    saved = save_shapes(tmp_path / "out", shapes, like=tmp_path / "tube.obj")
    assert saved.files == (tmp_path / "out",)
    names = sorted(p.name for p in (tmp_path / "out").glob("[0-9]*"))
    assert names == ["0000.obj", "0001.obj", "0002.obj"]
    assert b"usemtl steel" in (tmp_path / "out" / "0002.obj").read_bytes()
    np.testing.assert_array_equal(load_shapes(tmp_path / "out").vertices, shapes.vertices)


def test_a_directory_may_have_another_format_than_the_document(tmp_path, shapes):
    save_shapes(tmp_path / "out", shapes, "ply", tmp_path / "tube.obj")
    assert b"property uchar red" in (tmp_path / "out" / "0001.ply").read_bytes()
    save_shapes(tmp_path / "bare", shapes)
    assert (tmp_path / "bare" / "0001.ply").is_file()


def test_npz_keeps_the_names(tmp_path, shapes):
    save_shapes(tmp_path / "s.npz", shapes)
    with np.load(tmp_path / "s.npz") as arrays:
        assert arrays["names"].tolist() == ["rest", "half", "full"]
    np.testing.assert_array_equal(load_shapes(tmp_path / "s.npz").vertices, shapes.vertices)


@pytest.mark.parametrize("name", ["a.npz", "a.glb", "a.mdd", "a.PC2", "a.usda", "a.usdc", "out"])
def test_names_of_sequences_are_accepted_beforehand(tmp_path, name):
    check_shapes_output(tmp_path / name)


@pytest.mark.parametrize("name", ["a.obj", "a.stl"])
def test_names_of_meshes_are_not(tmp_path, name, shapes):
    for call in (check_shapes_output, lambda path: save_shapes(path, shapes)):
        with pytest.raises(InputError, match=r"names one mesh file, expected one of .npz, .glb"):
            call(tmp_path / name)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"fps": 0}, "fps"),
        ({"fps": float("nan")}, "fps"),
        ({"tolerance": -1}, "tolerance"),
        ({"up": "x"}, "up: expected one of y, z"),
        ({"name": 3}, "name"),
        ({"like": 3}, "like"),
        ({"format": "fbx"}, "format 'fbx'"),
    ],
)
def test_wrong_options_are_refused_by_name(tmp_path, shapes, given, message):
    with pytest.raises(InputError, match=message):
        save_shapes(tmp_path / "out", shapes, **given)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("suffix", [".glb", ".mdd", ".pc2", ".usda", ".npz"])
def test_a_failure_leaves_the_old_file(tmp_path, shapes, suffix, monkeypatch):
    path = tmp_path / f"walk{suffix}"
    path.write_bytes(b"old")
    monkeypatch.setattr("pathlib.Path.replace", _full)
    with pytest.raises(OSError, match="full"):
        save_shapes(path, shapes)
    assert path.read_bytes() == b"old"
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".walk")]


def _full(*_):
    raise OSError(28, "disk full")


@pytest.mark.parametrize("suffix", [".fbx", ".gltf", ".usdz", ".abc"])
def test_files_of_other_formats_are_no_directories(suffix, tmp_path):
    with pytest.raises(InputError, match=rf"names a file of format \{suffix}, expected one of"):
        check_shapes_output(tmp_path / f"walk{suffix}")
    assert not list(tmp_path.iterdir())
    check_shapes_output(tmp_path / "walk.v2")
