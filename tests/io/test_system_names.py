"""Paths with spaces, other scripts and backslashes; names as Windows and macOS see them."""

import sys
import unicodedata

import numpy as np
import pytest

import deformer
from deformer import InputError, io
from deformer.documents import USD_SUFFIXES
from deformer.io import system_names
from shapes import sequence, small_model

NAMES = ["my walk (1) & b's", "περπάτημα", "走路 🚶", "Прогулка – №2"]
WINDOWS_SEPARATOR = pytest.param(
    r"C:\walk\take", marks=pytest.mark.skipif(sys.platform == "win32", reason="is a folder there")
)


@pytest.fixture(params=[*NAMES, WINDOWS_SEPARATOR])
def folder(request, tmp_path):
    """A folder of such a name."""
    made = tmp_path / request.param
    made.mkdir()
    return made


@pytest.mark.parametrize("suffix", [*io.MESH_SUFFIXES, *USD_SUFFIXES])
def test_meshes_of_such_names_come_back(folder, suffix):
    if suffix.startswith(".usd"):
        pytest.importorskip("pxr", reason="needs usd-core")
    mesh, path = sequence().mesh(1), folder / f"{folder.name}{suffix}"
    deformer.save_mesh(path, mesh)
    again = deformer.load_mesh(path)
    assert len(again.faces) == len(mesh.faces)
    assert np.allclose(np.sort(again.vertices, 0), np.sort(mesh.vertices, 0), atol=1e-6)


@pytest.mark.parametrize("suffix", [".npz", ".mdd", ".pc2", ".glb", ".usdc", ""])
def test_sequences_of_such_names_come_back(folder, suffix):
    if suffix.startswith(".usd"):
        pytest.importorskip("pxr", reason="needs usd-core")
    shapes, path = sequence(), folder / f"{folder.name}{suffix}"
    deformer.save_shapes(path, shapes, tolerance=1e-4)
    again = deformer.load_shapes(path)
    assert np.abs(again.vertices - shapes.vertices).max() < 1e-3


def test_models_of_such_names_come_back(folder):
    model = small_model()
    model.save(folder / folder.name)
    assert deformer.load_model(folder / folder.name).fingerprint == model.fingerprint


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("con", "device"),
        ("CON.ply", "device"),
        ("aux.tar.ply", "device"),
        ("Lpt1.obj", "device"),
        ("com².obj", "device"),
        ("prn.ply", "device"),
        ("NUL .ply", "device"),
        *((f"a{character}b.ply", repr(character)) for character in '<>:"|?*\t'),
        ("walk.", "ends in a dot"),
        ("walk ", "ends in a dot or a space"),
    ],
)
def test_what_windows_has_no_file_for_is_told_before_any_work(tmp_path, monkeypatch, name, why):
    io.check_output_file(tmp_path / name)  # other systems have such files
    monkeypatch.setattr(system_names, "WINDOWS", True)
    with pytest.raises(InputError, match="choose another name") as refused:
        io.check_output_file(tmp_path / name)
    assert why in str(refused.value)
    with pytest.raises(InputError, match="choose another name"), io.atomic_path(tmp_path / name):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["console.ply", "com10.ply", "nul1.obj", ".hidden", *NAMES])
def test_other_names_are_as_good_on_windows(tmp_path, monkeypatch, name):
    monkeypatch.setattr(system_names, "WINDOWS", True)
    io.check_output_file(tmp_path / name)


def test_names_that_some_system_takes_for_one():
    decomposed = unicodedata.normalize("NFD", "é.ply")
    assert decomposed != "é.ply"
    for name in ("É.ply", "é.PLY", decomposed):
        assert io.folded_name(name) == io.folded_name("é.ply")
    assert io.folded_name("e.ply") != io.folded_name("é.ply")
    # Marks in another order, and a letter whose capital is a letter and a mark.
    assert io.folded_name("α\u0345\u0301.ply") == io.folded_name("\u1fb4.ply")
    assert io.folded_name("\u03aa\u0301.ply") == io.folded_name("\u0390.ply")


def test_a_cache_finds_its_mesh_in_another_case(tmp_path):
    """As where "walk.mdd" opens Walk.MDD, but the folder lists the mesh as Walk.obj."""
    shapes = sequence()
    deformer.save_shapes(tmp_path / "walk.mdd", shapes)
    (tmp_path / "walk.obj").rename(tmp_path / "Walk.obj")
    assert len(deformer.load_shapes(tmp_path / "walk.mdd")) == len(shapes)


def test_a_cache_prefers_the_mesh_of_its_own_case(tmp_path):
    shapes = sequence()
    deformer.save_shapes(tmp_path / "walk.mdd", shapes)
    (tmp_path / "WALK.obj").write_text("v 0 0 0\n")
    if len(list(tmp_path.glob("*.obj"))) < 2:
        pytest.skip("one file here")
    assert len(deformer.load_shapes(tmp_path / "walk.mdd")) == len(shapes)
