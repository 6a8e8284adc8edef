"""Sequences that commands write in the format of the output's suffix."""

import json

import numpy as np
import pytest

import deformer
from shapes import small_model


@pytest.fixture
def frames(tmp_path):
    """A handles file of six frames, in which a vertex rises."""
    rest = small_model().reference.vertices[40]
    rows = [
        [{"vertex": 40, "position": (rest + np.array([0, 0.02 * n, 0])).tolist()}] for n in range(6)
    ]
    (tmp_path / "frames.json").write_text(json.dumps({"frames": rows}))
    return tmp_path / "frames.json"


def test_fit_writes_a_clip_with_its_error(run_json, model_path, frames, tmp_path):
    run_json("fit", model_path, frames, "-o", tmp_path / "all.npz")
    options = ["--fps", 12, "--tolerance", 1e-4, "--name", "rise"]
    result = run_json("fit", model_path, frames, "-o", tmp_path / "walk.glb", *options)
    assert 1 <= result["morph_targets"] <= 5 and result["morph_error"] < 2e-4
    assert result["files"] == [str(tmp_path / "walk.glb")]
    goal = deformer.load_shapes(tmp_path / "all.npz").vertices
    found = deformer.load_shapes(tmp_path / "walk.glb", clip="rise", fps=12).vertices
    size = small_model().reference.bounding_diagonal
    assert np.linalg.norm(found - goal, axis=2).max() < 2e-4 * size + 1e-5


@pytest.mark.parametrize("suffix", [".mdd", ".pc2"])
def test_fit_writes_point_caches(run_json, model_path, frames, tmp_path, suffix):
    run_json("fit", model_path, frames, "-o", tmp_path / "all.npz")
    result = run_json("fit", model_path, frames, "-o", tmp_path / f"walk{suffix}")
    assert result["files"] == [str(tmp_path / f"walk{suffix}"), str(tmp_path / "walk.obj")]
    found = deformer.load_shapes(tmp_path / f"walk{suffix}")
    goal = deformer.load_shapes(tmp_path / "all.npz").vertices
    np.testing.assert_allclose(found.vertices, goal, atol=1e-5)


def test_sweeps_and_random_shapes_are_one_file(run_json, refuse, model_path, tmp_path):
    path = tmp_path / "sweep.glb"
    result = run_json("synthesize", model_path, "--sweep", "1=-1:1:9", "-o", path)
    assert result["shapes"] == 9 and result["morph_targets"] >= 1
    found = deformer.load_shapes(path, clip="sweep").vertices
    goal = deformer.Synthesis(small_model()).sweep(1, np.linspace(-1, 1, 9))
    size = deformer.Mesh(goal[0], small_model().reference.faces).bounding_diagonal
    assert np.linalg.norm(found - goal, axis=2).max() < (result["morph_error"] + 1e-5) * size
    run_json("synthesize", model_path, "--random", 3, "-o", tmp_path / "crowd.npz")
    assert len(deformer.load_shapes(tmp_path / "crowd.npz")) == 3
    message = refuse(
        "synthesize", model_path, "--sweep", "1=0:1:3", "--sweep", "2=0:1:3", "-o", path
    )
    assert "one file for 2 sequences" in message


def test_an_interpolation_is_one_file(run_json, refuse, model_path, tmp_path):
    path = tmp_path / "way.npz"
    result = run_json("interpolate", model_path, "reference", 2, "-o", path, "--steps", 5)
    assert list(result["spaces"]) == ["latent"] and result["files"] == [str(path)]
    assert len(deformer.load_shapes(path)) == 5
    two = ["--spaces", "latent,linear", "-o", path]
    assert "one file for 2 sequences" in refuse("interpolate", model_path, "reference", 2, *two)


def test_components_become_shape_keys(run_json, run, refuse, model_path, tmp_path):
    path = tmp_path / "keys.glb"
    options = ["--top", 2, "--tolerance", 0.01]
    result = run_json("components", model_path, "--glb", path, *options)
    order = deformer.Activations(small_model()).order[:2].tolist()
    assert [c["index"] for c in result["components"]] == order
    assert result["keys"] == len(deformer.load_shapes(path)) - 1
    assert all(c["error"] <= 0.01 for c in result["components"])
    status, out, _ = run("components", model_path, "--glb", path, "--top", 1)
    assert status == 0 and "largest error" in out
    assert "-o DIRECTORY" in refuse("components", model_path)
    assert "expected .glb" in refuse("components", model_path, "--glb", tmp_path / "keys.fbx")
