"""`deformer rig`, as a user runs it."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import deformer
from deformer import io
from deformer.rigging import decomposition
from shapes import small_model


def test_help_has_an_example(run):
    status, out, _ = run("rig", "--help")
    assert status == 0 and "deformer rig humanoid -o rig.glb" in out and "--json" in out


def test_the_file_is_the_rig_that_the_library_makes(run_json, model_path, tmp_path):
    out = tmp_path / "rig.glb"
    result = run_json("rig", model_path, "-o", out, "--bones", 5, "--influences", 2, "--fps", 12)
    expected = deformer.rig(small_model(), 5, 2)
    assert out.read_bytes() == expected.glb(12)
    assert result["bones"] == len(expected.names) and result["asked"] == 5
    assert result["influences"] == expected.influences
    assert result["E_rms"] == pytest.approx(expected.error)
    size = small_model().reference.bounding_diagonal
    assert result["E_rms_share"] == pytest.approx(expected.error / 1000 / size)
    assert result["stray_share"] == 0 and result["frames"] == 12 and result["fps"] == 12
    assert [bone["name"] for bone in result["skeleton"]] == list(expected.names)
    assert result["skeleton"][0]["parent"] is None
    joints = [bone["joint"] for bone in result["skeleton"]]
    np.testing.assert_allclose(joints, expected.rest[:, :3, 3])
    assert result["files"] == [str(out)]


def test_the_file_is_like_the_document_unless_it_is_bare(run, tmp_path, monkeypatch):
    monkeypatch.setattr(decomposition, "_ALTERNATIONS", 2)
    model = small_model()
    lines = io.mesh_bytes(model.reference, ".obj").decode().splitlines()
    first = next(n for n, line in enumerate(lines) if line.startswith("f "))
    text = "\n".join(["o Sock", *lines[:first], "usemtl wool", *lines[first:], ""]).encode()
    (tmp_path / "sock.obj").write_bytes(text)
    document = deformer.load_document(tmp_path / "sock.obj")
    model = replace(model, document=document, summary={**model.summary, "up": "z"})
    model.save(tmp_path / "model")
    rig = deformer.rig(model, 3)
    out = tmp_path / "rig.glb"
    for options, like in (((), model), (("--bare",), None)):
        assert run("rig", tmp_path / "model", "-o", out, "--bones", 3, *options)[0] == 0
        assert out.read_bytes() == rig.glb(like=like, up="z")
        assert (b"wool" in out.read_bytes()) == (like is not None)


def test_the_summary_has_bones_error_and_stray_share(run, model_path, tmp_path, monkeypatch):
    monkeypatch.setattr(decomposition, "_ALTERNATIONS", 2)
    out = tmp_path / "rig.glb"
    status, text, err = run("rig", model_path, "-o", out, "--bones", 3)
    assert status == 0 and f"Saved {out}." in err.replace("\n", "")
    assert re.search(r"^3 bones, at most \d a vertex: E_rms \d+.* 0 % of the weights astray", text)


def test_fewer_bones_than_asked_for_are_said(run, model_path, tmp_path, monkeypatch):
    monkeypatch.setattr(decomposition, "_ALTERNATIONS", 2)
    # A tube of 120 vertices has no use for so many.
    status, text, err = run("rig", model_path, "-o", tmp_path / "rig.glb", "--bones", 90)
    bones = int(text.split()[0])
    assert status == 0 and bones < 90
    assert f"{bones} bones, 90 were asked for" in err


def test_mistakes_are_told_before_any_work(refuse, model_path, tmp_path, monkeypatch):
    def no_work(*_, **__):
        raise AssertionError("work has started")

    monkeypatch.setattr(deformer, "rig", no_work)
    assert "expected .glb" in refuse("rig", model_path, "-o", tmp_path / "rig.fbx")
    assert "model" in refuse("rig", model_path, "-o", model_path / "rig.glb")
    assert "nowhere" in refuse("rig", model_path, "-o", tmp_path / "nowhere" / "rig.glb")
    for option, value in (("--bones", 0), ("--bones", 10**9), ("--influences", 17), ("--fps", 0)):
        assert option in refuse("rig", model_path, "-o", tmp_path / "rig.glb", option, value)
    assert [path.name for path in tmp_path.iterdir()] == ["model"]
    assert json.loads((model_path / "model.json").read_text())
