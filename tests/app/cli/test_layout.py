"""`deformer layout`, as a user runs it."""

import json

import numpy as np
import pytest
from PIL import Image

import deformer
from deformer import io
from shapes import small_model


def test_help_has_an_example(run):
    status, out, _ = run("layout", "--help")
    assert status == 0 and "deformer layout humanoid --count 20" in out and "--json" in out


def test_the_file_has_the_handles_where_they_are_on_the_reference(run_json, model_path, tmp_path):
    out = tmp_path / "layout.json"
    result = run_json("layout", model_path, "--count", "2,5", "--fixed", 7, "-o", out)
    expected = deformer.layout(small_model(), [2, 5], fixed=[7])
    vertices = expected.vertices.tolist()
    assert [handle["vertex"] for handle in result["handles"]] == vertices and vertices[0] == 7
    assert [entry["count"] for entry in result["expected"]] == [2, 5]
    for entry in result["expected"]:
        assert entry["E_rms"] == pytest.approx(1000 * entry["deviation"] / 3**0.5)
    (frame,) = io.load_handles(out, 120).frames
    assert [handle.vertex for handle in frame] == vertices
    places = [handle.position for handle in frame]
    np.testing.assert_allclose(places, small_model().reference.vertices[vertices])
    # A fit to its own reference meets the handles there.
    fitted = run_json("fit", model_path, out, "--hard", "-o", tmp_path / "pose.ply")
    assert fitted["max_residual"] < 1e-6


def test_the_table_names_every_handle_and_its_pair(run, model_path):
    status, out, _ = run("layout", model_path, "--count", 4, "--symmetric")
    found = deformer.layout(small_model(), 4, symmetric=True)
    assert status == 0
    rows = [line.split() for line in out.splitlines()]
    for a, b in found.vertices[found.pairs]:
        assert any(str(a) in row and str(b) in row for row in rows)


def test_the_picture_shows_handles_and_what_stays_uncertain(run_json, model_path, tmp_path):
    picture = tmp_path / "layout.png"
    run_json("layout", model_path, "--count", 3, "--picture", picture)
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    assert pixels.shape[1] > 2 * 700
    ball = np.abs(pixels - [232, 100, 27]).sum(axis=2) < 90
    assert ball.sum() > 100
    assert pixels.std() > 10


def test_excluded_vertices_are_spans_or_a_file(run_json, model_path, tmp_path):
    banned = tmp_path / "banned.json"
    banned.write_text(json.dumps({"vertices": list(range(3, 120))}))
    spans = run_json("layout", model_path, "--count", 2, "--exclude", "3-100, 101,102-119")
    listed = run_json("layout", model_path, "--count", 2, "--exclude", banned)
    assert spans["handles"] == listed["handles"]
    assert all(handle["vertex"] < 3 for handle in spans["handles"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--count", "x"], "whole numbers"),
        (["--count", "0"], "numbers of 1"),
        (["--count", "200"], "at most 120"),
        (["--count", "3", "--fixed", "1-3"], "whole numbers"),
        (["--count", "3", "--exclude", "9-3"], "numbers of 0"),
        (["--count", "3", "--exclude", "400"], "vertex 400 does not exist"),
        (["--count", "3", "--exclude", "none.json"], "none.json"),
        (["--count", "3", "--noise", "nan"], "noise"),
        (["--count", "3", "--picture", "a.gif"], "expected one of .png"),
        (["--count", "3", "-o", "nowhere/l.json"], "nowhere"),
    ],
)
def test_mistakes_are_one_line(refuse, model_path, options, words):
    assert words in refuse("layout", model_path, *options)
