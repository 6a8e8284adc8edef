"""`deformer fit` of several handles files: a result for each."""

import json
import os
import signal

import numpy as np
import pytest

import deformer
from deformer.parallel import InProcess
from deformer_app import console
from shapes import small_model


@pytest.fixture
def takes(tmp_path):
    """Two sequences of different lengths, and a pose."""
    rest = small_model().reference.vertices

    def handles(n, vertex=40):
        return [{"vertex": vertex, "position": (rest[vertex] + [0, 0.02 * n, 0]).tolist()}]

    contents = {
        "rise": {"frames": [handles(n) for n in range(4)]},
        "fall": {"frames": [handles(-n, 25) for n in range(3)]},
        "pose": {"handles": handles(2)},
    }
    for name, content in contents.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    return [tmp_path / f"{name}.json" for name in contents]


def vertices(path):
    return deformer.load_shapes(path).vertices


def test_each_file_has_the_result_that_it_has_alone(run_json, model_path, takes, tmp_path):
    options = ["--format", "npz", "--smoothness", 2]
    result = run_json("fit", model_path, *takes[:2], "-o", tmp_path / "out", *options)
    assert result["output"] == str(tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["fall.npz", "rise.npz"]
    for fit, take in zip(result["fits"], takes, strict=False):
        alone = run_json("fit", model_path, take, "-o", tmp_path / "alone.npz", "--smoothness", 2)
        assert fit["handles"] == str(take)
        assert fit["output"] == str(tmp_path / "out" / f"{take.stem}.npz")
        np.testing.assert_allclose(vertices(fit["output"]), vertices(tmp_path / "alone.npz"))
        assert len(fit["frames"]) == len(alone["frames"])
        assert fit["residual_rms"] == pytest.approx(alone["residual_rms"])


def test_poses_and_sequences_are_glb_without_a_format(run, model_path, takes, tmp_path):
    status, out, err = run("fit", model_path, *takes, "-o", tmp_path / "out")
    assert status == 0, err
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "fall.glb",
        "pose.glb",
        "rise.glb",
    ]
    assert len(vertices(tmp_path / "out" / "fall.glb")) >= 2
    assert all(name in out for name in ("rise.json", "fall.glb", "residual"))


def test_a_cluster_gives_the_same(run_json, model_path, takes, tmp_path):
    pytest.importorskip("distributed", reason="needs Dask: pip install distributed")
    here = run_json("fit", model_path, *takes[:2], "-o", tmp_path / "here", "--format", "npz")
    options = ["--format", "npz", "--cluster", "local:1"]
    there = run_json("fit", model_path, *takes[:2], "-o", tmp_path / "there", *options)
    for one, other in zip(here["fits"], there["fits"], strict=True):
        np.testing.assert_allclose(vertices(one["output"]), vertices(other["output"]), atol=1e-6)
        assert one["residual_rms"] == pytest.approx(other["residual_rms"], rel=1e-6)


def test_mistakes_come_before_any_fit(refuse, model_path, takes, tmp_path):
    out = tmp_path / "out"
    (tmp_path / "more").mkdir()
    twin = tmp_path / "more" / "rise.json"
    twin.write_text(takes[0].read_text())
    broken = tmp_path / "broken.json"
    broken.write_text('{"handles": [{"vertex": 10000, "position": [0, 0, 0]}]}')
    for given, options, message in [
        ([takes[0], twin], [], "its result would have the name"),
        ([takes[0], broken], [], "broken.json: handles[0].vertex"),
        (takes, ["--format", "npz"], "expected one of .obj"),
        (takes[:2], ["--format", "ply"], "expected one of .npz"),
    ]:
        assert message in refuse("fit", model_path, *given, "-o", out, *options)
        assert not out.exists()
    assert "name a directory" in refuse("fit", model_path, *takes, "-o", tmp_path / "all.glb")


@pytest.mark.parametrize("option", [("--memory", "1GB"), ("--cache", ".")])
def test_a_limit_of_memory_that_would_not_count_is_refused(
    option, refuse, model_path, takes, tmp_path
):
    for given in (takes[:2], [takes[0], "--cluster", "local:1"]):
        out = tmp_path / "out"
        message = refuse("fit", model_path, *given, "-o", out, *option)
        assert option[0] in message and "leave it out" in message
        assert not out.exists()


def test_a_fit_that_fails_leaves_the_others(refuse, model_path, takes, tmp_path, monkeypatch):
    from deformer_app.cli import fit

    true = fit.sequence

    def sequence(model, handles, **options):
        if len(handles.frames) == 4:
            raise deformer.InputError("it diverged")
        return true(model, handles, **options)

    monkeypatch.setattr(fit, "sequence", sequence)
    message = refuse("fit", model_path, *takes, "-o", tmp_path / "out")
    assert "rise.json: it diverged" in message and "2 of 3 results are in" in message
    assert {path.stem for path in (tmp_path / "out").iterdir()} == {"fall", "pose"}


def test_what_is_fitted_stays_when_the_rest_is_interrupted(
    run, model_path, takes, tmp_path, monkeypatch
):
    true, calls = InProcess.as_completed, []

    def as_completed(self):
        for event in true(self):
            if calls:
                os.kill(os.getpid(), signal.SIGINT)
            calls.append(event)
            yield event

    monkeypatch.setattr(InProcess, "as_completed", as_completed)
    # A shell has what it runs in the background ignore Ctrl-C.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        status, _, err = run("fit", model_path, *takes, "-o", tmp_path / "out")
    finally:
        signal.signal(signal.SIGINT, before)
    assert status == console.INTERRUPTED
    assert "Interrupted: 1 of 3 results are in" in err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["rise.glb"]


def test_a_format_beside_the_name_of_one_result_is_refused(refuse, model_path, takes, tmp_path):
    out = tmp_path / "out.glb"
    message = refuse("fit", model_path, takes[0], "-o", out, "--format", "npz")
    assert "--format: got it with one file" in message and not out.exists()
