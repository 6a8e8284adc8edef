"""`deformer check`: repaired copies keep all that is not named, and the page shows what is."""

import json

import numpy as np
import pytest

from bodies import bending
from deformer import MeshSequence, load_shapes, save_shapes
from deformer_app import console
from deformer_app.cli.main import app


def deformer(*arguments):
    return console.run(app, [str(argument) for argument in arguments])


@pytest.fixture
def sound():
    return bending()


@pytest.fixture
def bad(sound):
    vertices = sound.vertices.copy()
    vertices[1] *= [-1, 1, 1]
    vertices[3] *= 1000
    vertices[5, 90] += 9
    return MeshSequence(vertices, sound.faces)


def test_a_folder_is_repaired_and_sound_files_stay_byte_for_byte(bad, sound, tmp_path, capsys):
    save_shapes(tmp_path / "walk", bad, "obj")
    (tmp_path / "walk" / "0002.obj").open("a").write("# by hand\n")
    assert deformer("check", tmp_path / "walk", "--fix", tmp_path / "fixed", "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert result["memory"]["least_GB"] > 0.5 and result["fit_memory"]["least_GB"] > 0.5
    expected = 24e-6 * sound.vertices.shape[1]
    assert result["fit_memory"]["files_GB_of_1000_frames"] == round(expected, 2)
    found = {f["kind"]: f["shapes"] for f in result["findings"] if f["kind"] != "few"}
    assert found == {"mirrored": [1], "units": [3], "far": [5]}
    assert "0001.obj" in str(result["findings"])
    assert [f["kind"] for f in result["fix"]["after"]["findings"]] == ["far", "few"]
    for n in (0, 2, 4, 5, 6, 7):
        name = f"{n:04}.obj"
        assert (tmp_path / "fixed" / name).read_bytes() == (tmp_path / "walk" / name).read_bytes()
    again = load_shapes(tmp_path / "fixed").vertices
    np.testing.assert_allclose(again[[1, 3]], sound.vertices[[1, 3]], atol=1e-12)
    # Again over its own output.
    assert deformer("check", tmp_path / "walk", "--fix", tmp_path / "fixed") == 0


def test_an_npz_keeps_its_other_arrays_and_types(bad, sound, tmp_path, capsys):
    vertices = np.concatenate([bad.vertices, bad.vertices[:, :1]], axis=1)
    np.savez(
        tmp_path / "walk.npz",
        vertices=vertices.astype(np.float32),
        faces=np.where(bad.faces == 0, 170, bad.faces).astype(np.int32),
        rest=np.arange(171 * 3).reshape(171, 3),
        fps=25,
    )
    assert deformer("check", tmp_path / "walk.npz", "--fix", tmp_path / "fixed", "--json") == 0
    file = tmp_path / "fixed" / "walk.npz"
    with np.load(file) as arrays:
        assert set(arrays.files) == {"vertices", "faces", "rest", "fps"}
        assert arrays["vertices"].dtype == np.float32
        assert arrays["faces"].dtype == np.int32
        assert arrays["vertices"].shape == sound.vertices.shape
        assert arrays["rest"].shape == (170, 3)
        assert arrays["fps"] == 25


@pytest.mark.parametrize("output", ["walk", ".", "other"])
def test_an_output_that_would_lose_files_is_refused(output, bad, tmp_path, capsys):
    save_shapes(tmp_path / "walk", bad, "ply")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.txt").write_text("kept")
    before = sorted((p, p.stat().st_mtime_ns) for p in tmp_path.rglob("*"))
    assert deformer("check", tmp_path / "walk", "--fix", tmp_path / output) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert sorted((p, p.stat().st_mtime_ns) for p in tmp_path.rglob("*")) == before


def test_a_single_file_beside_its_output_is_refused(bad, tmp_path, capsys):
    save_shapes(tmp_path / "walk.npz", bad)
    assert deformer("check", tmp_path / "walk.npz", "--fix", tmp_path) == 2
    assert "contains the input" in capsys.readouterr().err


def test_what_cannot_be_used_after_repair_exits_with_1(bad, tmp_path):
    save_shapes(tmp_path / "walk.npz", bad.subset([0]))
    assert deformer("check", tmp_path / "walk.npz", "--fix", tmp_path / "fixed") == 1


def test_the_page_has_findings_and_pictures_and_needs_nothing_else(bad, tmp_path):
    save_shapes(tmp_path / "walk.npz", bad)
    page = tmp_path / "walk.html"
    fix = ("--fix", tmp_path / "fixed")
    assert deformer("check", tmp_path / "walk.npz", *fix, "--report", page) == 0
    text = page.read_text(encoding="utf-8")
    # Before: the reference, mirrored, units, far; after: the reference, far.
    assert text.count("data:image/webp;base64,") == 6
    assert "http" not in text
    assert "mirrored back" in text
    assert "vertex 90" in text


def test_a_reference_and_a_clip_may_be_named(sound, tmp_path, capsys):
    save_shapes(tmp_path / "walk", sound, "obj")
    assert deformer("check", tmp_path / "walk", "--reference", "0003", "--json") == 0
    first = json.loads(capsys.readouterr().out)
    assert deformer("check", tmp_path / "walk", "--json") == 0
    second = json.loads(capsys.readouterr().out)
    assert first["facts"]["shapes"] == second["facts"]["shapes"] == len(sound)
    assert first["facts"]["local_rotations"] != second["facts"]["local_rotations"]
    extra = tmp_path / "walk" / "0002.obj"
    assert deformer("check", tmp_path / "walk", "--reference", extra, "--json") == 0
    assert json.loads(capsys.readouterr().out)["facts"]["shapes"] == len(sound) + 1
    for options, part in (
        (("--reference", "gone"), "'gone'"),
        (("--reference", "0003", "--fix", tmp_path / "fixed"), "leave one out"),
        (("--clip", "walk"), "clip 'walk'"),
        (("--fps", "0"), "fps"),
    ):
        assert deformer("check", tmp_path / "walk", *options) == 2
        assert part in capsys.readouterr().err
