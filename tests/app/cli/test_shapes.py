"""Commands about components and new shapes, as a user runs them."""

import csv
import json

import numpy as np
import pytest
from PIL import Image

import deformer
from shapes import sequence, small_model


@pytest.mark.parametrize("command", ["components", "name", "synthesize", "interpolate", "encode"])
def test_help_has_an_example(run, command):
    status, out, _ = run(command, "--help")
    assert status == 0 and f"deformer {command}" in out and "--json" in out


@pytest.mark.slow
def test_components_writes_what_it_says(run_json, run, model_path, tmp_path):
    folder = tmp_path / "components"
    deformer.save_names(model_path, {1: "nod"})
    result = run_json("components", model_path, "-o", folder, "--top", 2, "--turntable", 2)
    rows = list(csv.DictReader((folder / "components.csv").open(encoding="utf-8")))
    order = deformer.Activations(small_model()).order[:2].tolist()
    assert [int(row["index"]) for row in rows] == order
    assert [c["index"] for c in result["components"]] == order
    record = json.loads((folder / "components.json").read_text())
    assert record["components"] == result["components"]
    for k in order:
        mesh = deformer.load_mesh(folder / f"component-{k:02d}.ply")
        z = deformer.Activations(small_model()).representative(k)
        np.testing.assert_allclose(mesh.vertices, small_model().decode(z), atol=1e-6)
        assert Image.open(folder / f"component-{k:02d}.gif").n_frames == 2
        heat = np.asarray(Image.open(folder / f"component-{k:02d}.png").convert("RGB"))
        assert heat.std() > 5
    # Both shapes and one bar: wider than one shape with its bar.
    widths = [Image.open(folder / f"{n}.png").width for n in ("sheet", f"component-{order[0]:02d}")]
    assert widths[0] > widths[1]
    status, out, _ = run("components", model_path, "-o", folder, "--turntable", 0)
    assert status == 0 and "1 nod" in out


def test_names_are_kept_and_used(run_json, refuse, model_path, tmp_path):
    found = run_json("name", model_path, "3=left arm up", "1=nod")
    assert found["names"] == {"1": "nod", "3": "left arm up"}
    assert run_json("info", model_path)["names"] == found["names"]
    by_name = run_json(
        "synthesize", model_path, "--weights", "left arm up=0.5", "-o", tmp_path / "a.ply"
    )
    by_index = run_json("synthesize", model_path, "--weights", "3=0.5", "-o", tmp_path / "b.ply")
    assert by_name["z"] == by_index["z"]
    assert run_json("name", model_path, "nod=")["names"] == {"3": "left arm up"}
    assert run_json("name", model_path, "0=bow", "-o", tmp_path / "copy")["names"]["0"] == "bow"
    assert "0" not in run_json("info", model_path)["names"]
    assert "expected COMPONENT=NAME" in refuse("name", model_path, "3")
    assert "no name" in refuse("name", model_path, "3=4")


def test_weights_make_a_mesh(run_json, model_path, tmp_path):
    out = tmp_path / "pose.obj"
    result = run_json("synthesize", model_path, "--weights", "2=0.8,4=-1.2", "-o", out)
    expected = deformer.Synthesis(small_model()).shape({2: 0.8, 4: -1.2})
    np.testing.assert_allclose(deformer.load_mesh(out).vertices, expected, atol=1e-5)
    started = run_json("synthesize", model_path, "--weights", "2=0", "--from", "5", "-o", out)
    np.testing.assert_allclose(started["z"], small_model().codes[5])
    code = tmp_path / "code.json"
    code.write_text(json.dumps({"z": result["z"]}))
    again = run_json("synthesize", model_path, "--weights", "2=0", "--from", code, "-o", out)
    np.testing.assert_allclose(again["z"], result["z"])
    straight = run_json(
        "synthesize", model_path, "--weights", "2=2", "--spaces", "linear", "-o", tmp_path / "l.ply"
    )
    assert straight["space"] == "linear"
    expected = deformer.Synthesis(small_model()).shape({2: 2.0}, "linear")
    found = deformer.load_mesh(tmp_path / "l.ply").vertices
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_onto_another_model(run_json, model_path, tmp_path):
    """Carried over to itself, a deformation is what it was."""
    out = tmp_path / "pose.ply"
    run_json("synthesize", model_path, "--weights", "2=1", "--onto", model_path, "-o", out)
    expected = deformer.Synthesis(small_model()).shape({2: 1.0})
    np.testing.assert_allclose(deformer.load_mesh(out).vertices, expected, atol=1e-5)


@pytest.mark.slow
def test_sweeps_make_sheet_animation_and_sequence(run_json, model_path, tmp_path):
    folder = tmp_path / "sweeps"
    result = run_json(
        "synthesize", model_path, "--sweep", "2=-1:1:3", "--sweep", "4=0:1:3", "--weights",
        "5=0.5", "--spaces", "latent,linear", "-o", folder,
    )  # fmt: skip
    assert result["rows"] == ["component 2, latent", "component 2, linear",
                              "component 4, latent", "component 4, linear"]  # fmt: skip
    assert all(sorted(folder.glob(pattern)) for pattern in ("sheet.png", "sweep-3.gif"))
    swept = deformer.load_shapes(folder / "sweep-0.npz").vertices
    expected = deformer.Synthesis(small_model()).sweep(2, [-1, 0, 1], {5: 0.5})
    np.testing.assert_allclose(swept, expected, atol=1e-6)
    assert Image.open(folder / "sweep-0.gif").n_frames == 4  # there and back


def test_random_shapes_are_near_the_examples(run_json, model_path, tmp_path):
    folder = tmp_path / "crowd"
    result = run_json("synthesize", model_path, "--random", 3, "--bound", 0.5, "-o", folder)
    familiarity = deformer.Familiarity(small_model())
    assert max(familiarity.nearest(z)[1] for z in result["codes"]) <= 0.5 + 1e-9
    assert result["off_data"] == [familiarity.percentile(z) for z in result["codes"]]
    shapes = deformer.load_shapes(folder / "shapes.npz").vertices
    np.testing.assert_allclose(shapes, small_model().decode(np.array(result["codes"])), atol=1e-6)


@pytest.mark.slow
def test_interpolation_of_three_ways(run_json, model_path, tmp_path):
    mesh = tmp_path / "key.ply"
    deformer.save_mesh(mesh, sequence().mesh(3))
    folder = tmp_path / "path"
    result = run_json("interpolate", model_path, "9", mesh, "reference", "-o", folder, "--steps", 3)
    assert list(result["spaces"]) == ["latent", "features", "linear"]
    ratios = [
        result["spaces"][space]["shortest_total"] for space in ("latent", "features", "linear")
    ]
    assert min(ratios[:2]) > ratios[2]
    path = deformer.load_shapes(folder / "linear.npz").vertices
    assert len(path) == 5
    np.testing.assert_allclose(path[2], sequence().vertices[3], atol=1e-5)
    assert (folder / "sheet.png").is_file() and (folder / "path.gif").is_file()


def test_encode_says_how_well_a_shape_is_reproduced(run_json, refuse, model_path, tmp_path):
    mesh, code = tmp_path / "unseen.ply", tmp_path / "code.json"
    unseen = 0.5 * (sequence().vertices[2] + sequence().vertices[3])
    deformer.save_mesh(mesh, deformer.Mesh(unseen, sequence().faces))
    found = run_json("encode", model_path, mesh, "-o", code)
    decoded = small_model().decode(np.array(found["z"]))
    assert found["e_rms"] == pytest.approx(deformer.e_rms(unseen, decoded), rel=1e-3)
    assert found["e_rms"] <= found["e_rms_of_encoder"]
    assert json.loads(code.read_text())["z"] == found["z"]
    quick = run_json("encode", model_path, mesh, "--quick", "-o", tmp_path / "found.ply")
    assert quick["e_rms"] == pytest.approx(found["e_rms_of_encoder"], rel=1e-6)
    again = deformer.load_mesh(tmp_path / "found.ply").vertices
    assert deformer.e_rms(unseen, again, "none") == pytest.approx(quick["e_rms"], rel=1e-3)
    deformer.save_mesh(mesh, deformer.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    assert "connectivity" in refuse("encode", model_path, mesh)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-o", "a.ply"], "none of --weights"),
        (["--weights", "2", "-o", "a.ply"], "'2', expected COMPONENT=NUMBER"),
        (["--weights", "2=x", "-o", "a.ply"], "'2=x', expected COMPONENT=NUMBER"),
        (["--weights", "2=1,2=2", "-o", "a.ply"], "given twice"),
        (["--weights", "9=1", "-o", "a.ply"], "component 9 does not exist"),
        (["--weights", "2=1", "-o", "a"], "suffix"),
        (["--weights", "2=1", "--random", "3", "-o", "a"], "--random goes without"),
        (["--sweep", "2=1:2", "-o", "a"], "FIRST:LAST:COUNT"),
        (["--sweep", "2=0:1:3", "-o", "a.ply"], "names one mesh file"),
        (["--weights", "2=1", "--spaces", "curved", "-o", "a.ply"], "'curved'"),
        (["--weights", "2=1", "--spaces", "latent,linear", "-o", "a.ply"], "in one space"),
        (["--weights", "2=1", "--from", "77", "-o", "a.ply"], "shape 77"),
        (["--weights", "2=1", "--from", "no.ply", "-o", "a.ply"], "no.ply"),
    ],
)
def test_mistakes_of_synthesize(refuse, model_path, monkeypatch, tmp_path, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert words in refuse("synthesize", model_path, *arguments)


def test_interpolate_needs_two(refuse, model_path, tmp_path):
    assert "two or more" in refuse("interpolate", model_path, "3", "-o", tmp_path / "x")
