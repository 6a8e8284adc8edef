"""`deformer evaluate` as a user runs it, and the report that it writes."""

import json
import multiprocessing
import re
import sys

import numpy as np
import pytest

import deformer
from bars import bending_bar
from deformer.evaluation.journal import COLUMNS, FAILURE
from deformer.evaluation.summary import summarise
from deformer_app import console
from deformer_app.cli import main as cli
from deformer_app.report import curves, paper as paper_sections, report
from deformer_app.report.parts import grid, number

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("evaluate")
    deformer.save_shapes(path / "bar.npz", bending_bar(count=24))
    return path


@pytest.fixture
def run(capfd, monkeypatch, folder):
    """Run the command in the folder; gives (status, stdout, stderr)."""
    monkeypatch.chdir(folder)

    def call(*arguments):
        texts = ["evaluate", *map(str, arguments)]
        monkeypatch.setattr(sys, "argv", ["deformer", *texts])
        capfd.readouterr()
        status = console.run(cli.app, texts)
        return status, *capfd.readouterr()

    return call


QUICK = ["--components", "3", "--counts", "5,9", "--epochs", "2", "--tests", "3"]
OPTIONS = [*QUICK, "--methods", "autoencoder,arap", "--sequence"]


@pytest.fixture
def evaluated(run, folder):
    status, out, err = run("bar.npz", "-o", "out", *OPTIONS, "--json")
    assert status == 0, err
    assert out.count("\n") == 1
    return json.loads(out), folder / "out"


def test_writes_results_and_a_report(evaluated, run):
    result, out = evaluated
    rows = json.loads((out / "results.json").read_text())
    assert result["rows"] == len(rows) > 0 and result["failures"] == 0
    assert {row["method"] for row in rows} == {"autoencoder", "arap"}
    assert all(tuple(row) == COLUMNS for row in rows)
    facts = json.loads((out / "run.json").read_text())
    assert facts["command"].startswith("deformer evaluate bar.npz -o out --components 3")
    assert {"versions", "machine", "seeds", "studies"} <= facts.keys()
    split = facts["studies"][0]["splits"][0]
    assert len(split["train"]) == 3 and len(split["test"]) == 21
    status, shown, _ = run("bar.npz", "-o", "out", *OPTIONS)
    assert status == 0 and "report.html" in shown
    assert json.loads((out / "results.json").read_text()) == rows


def test_the_report_needs_nothing_else(evaluated):
    page = (evaluated[1] / "report.html").read_text()
    # No script, style sheet, image or link but its own.
    for attribute in re.findall(r"(?:src|href)=\"([^\"]*)\"", page):
        assert attribute.startswith(("data:", "#")), attribute[:60]
    for tag in ("<script", "<link", "<iframe", "@import", "url("):
        assert tag not in page
    anchors = re.findall(r'href="#(\w+)"', page)
    assert anchors and all(f'id="{anchor}"' in page for anchor in anchors)
    assert "deformer evaluate bar.npz -o out" in page
    assert page.count("data:image/svg+xml") >= 2, "curves over counts"
    assert page.count("data:image/webp") == 2, "pictures by encoder and by control points"
    for words in ("best latent fit", "Sparse control", "Large rotations", "numpy", "cores"):
        assert words in page


def test_a_model_is_measured_on_its_own_split(run, folder):
    split = {"train": list(range(0, 24, 2)), "test": [1, 5, 9]}
    (folder / "split.json").write_text(json.dumps(split))
    shapes = deformer.load_shapes(folder / "bar.npz")
    deformer.train(shapes, 3, epochs=2, split=split).save(folder / "model")
    options = ["--counts", "9", "--methods", "arap"]
    status, _, err = run("model", "bar.npz", "-o", "of-model", *options)
    assert status == 0, err
    rows = json.loads((folder / "of-model" / "results.json").read_text())
    assert {row["method"] for row in rows} == {"model", "arap"}
    assert {row["value"] for row in rows if row["metric"] == "shapes" and row["count"] == 9} == {3}
    seen = {"train": [0, 4], "test": [2, 3]}
    (folder / "leak.json").write_text(json.dumps(seen))
    status, _, err = run("model", "bar.npz", "-o", "leak", "--split", "leak.json")
    assert (status, err.count("\n")) == (2, 1)
    assert "was trained on shape 2" in err


def test_split_files_and_several_sets(run, folder):
    split = {"train": [0, 4, 8, 12], "test": [1, 2]}
    (folder / "given.json").write_text(json.dumps(split))
    deformer.save_shapes(folder / "other.npz", bending_bar(count=24))
    options = ["--methods", "biharmonic", "--counts", "5", "--split", "given.json"]
    status, _, err = run("bar.npz", "other.npz", "-o", "two", *options)
    assert status == 0, err
    rows = json.loads((folder / "two" / "results.json").read_text())
    assert {row["dataset"] for row in rows} == {"bar", "other"}
    facts = json.loads((folder / "two" / "run.json").read_text())
    assert [study["splits"] for study in facts["studies"]] == [[split], [split]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "nowhere: does not exist"),
        (["bar.npz", "bar.npz"], "rename one"),
        (["bar.npz", "--methods", "nobody"], "methods: got 'nobody'"),
        (["bar.npz", "--components", "5,x"], "whole numbers with commas"),
        (["bar.npz", "--counts", "0"], "counts: expected"),
        (["bar.npz", "--split", "missing.json"], "missing.json: does not exist"),
        (["bar.npz", "--preset", "paper"], "expected one folder"),
        ([".", "--preset", "paper"], "holds none of scape-obj"),
        ([".", "--preset", "paper", "--clip", "0"], "--clip does not go with --preset paper"),
        ([".", "--preset", "paper", "--counts", "5"], "--counts does not go with --preset paper"),
        (["humanoid"], "expected sets of shapes"),
    ],
)
def test_a_mistake_is_one_line(run, arguments, message):
    status, out, err = run(*arguments, "-o", "mistaken")
    assert status == 2 and out == ""
    assert err.count("\n") == 1 and err.startswith("deformer: ")
    assert message in err


@pytest.mark.parametrize("where", ["--processes 1", "--processes 2", "--cluster local:1"])
def test_an_interrupted_run_says_how_to_go_on(run, folder, monkeypatch, where):
    if "cluster" in where:
        pytest.importorskip("distributed", reason="needs Dask: pip install distributed")
    calls = []

    def stop(self, key, rows):
        calls.append(key)
        raise KeyboardInterrupt

    monkeypatch.setattr("deformer.evaluation.journal.Journal.add", stop)
    status, _, err = run("bar.npz", "-o", "cut", *OPTIONS, *where.split())
    assert (status, len(calls)) == (console.INTERRUPTED, 1)
    assert "the same command goes on" in err
    assert not multiprocessing.active_children()


def test_a_foreign_directory_is_left_alone(run, folder):
    (folder / "mine").mkdir(exist_ok=True)
    (folder / "mine" / "thesis.txt").write_text("…")
    status, _, err = run("bar.npz", "-o", "mine", *OPTIONS)
    assert status == 2 and "something other than an evaluation" in err
    assert [path.name for path in (folder / "mine").iterdir()] == ["thesis.txt"]


def row(dataset, method, protocol, count, seed, metric, value):
    return dict(zip(COLUMNS, (dataset, method, protocol, count, seed, metric, value), strict=True))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("journal.jsonl", '{"my": "notes"}'),
        ("results.json", '{"mine": true}'),
        ("results.csv", "name,score"),
        ("run.json", '{"pace": 5}'),
        ("report.html", "<html><title>mine</title></html>"),
    ],
)
def test_files_that_only_have_a_runs_names_are_left_alone(run, folder, tmp_path, name, content):
    (tmp_path / "models").mkdir()
    (tmp_path / "journal.jsonl").write_text("")
    (tmp_path / name).write_text(content)
    status, _, err = run("bar.npz", "-o", tmp_path, *OPTIONS)
    assert status == 2 and f"already holds {name!r}" in err
    assert (tmp_path / name).read_text() == content


def test_tables_show_spread_and_failures():
    rows = [row("s", "a", "sparse_control", 5, seed, "E_rms", v) for seed, v in enumerate((10, 14))]
    rows += [row("s", "b", "sparse_control", 5, 0, "E_rms", 20.0)]
    rows += [row("s", "b", "sparse_control", 5, 0, "failures", 3)]
    rows += [row("s", "b", "sparse_control", 5, 0, "shapes", 35)]
    rows += [row("s", "c", "sparse_control", 5, 0, FAILURE, "why")]
    rows += [row("s", "a", "sparse_control", 9, 0, "E_rms", 1.0)]
    shown = grid(summarise(rows)["s", "sparse_control", "E_rms"], "method")
    assert shown.head == ["method", "5", "9"]
    texts = [[cell.text for cell in line] for line in shown.rows]
    assert texts[0] == ["a", "12.00 ± 2.828", "1.000"]
    assert texts[1] == ["b", "20.00 (3 of 35 shapes failed)", "–"]
    assert texts[2] == ["c", "failed", "–"]
    assert [line[1].kind for line in shown.rows] == ["best", "failed", "failed"]
    assert (number(0.04004), number(13.556), number(1234.5)) == ("0.04004", "13.56", "1234")


def test_curves_are_the_same_bytes_for_the_same_rows():
    rows = [row("s", "a", "p", count, 0, "E_rms", 100.0 / count) for count in (5, 10, 80)]
    table = summarise(rows)["s", "p", "E_rms"]
    first, again = (curves.draw(table, "title", "count", {"paper": (10, 3.0)}) for _ in range(2))
    assert first == again
    assert first.lstrip().startswith(b"<?xml")


def test_the_papers_numbers_stand_beside_ours():
    rows = [
        row("scape", "autoencoder-paper", "reconstruction/encoder", 50, 0, "E_rms", 21.0),
        row("scape", "autoencoder-paper", "sensitivity(0.4,0.4)/encoder", 50, 0, "E_rms", 22.0),
        row("horse", "autoencoder-paper", "reconstruction/encoder", 50, 0, "E_rms", 11.0),
        row("horse", "splocs", "reconstruction/encoder", 50, 0, "E_rms", 9.0),
        row("scape", "arap", "sparse_control", 5, 0, "E_rms", 99.0),
        row("scape", "arap", "sparse_control", 10, 0, "E_rms", 49.0),
    ]
    parts = {
        part.title.split("”")[0]: part for part in paper_sections.section(summarise(rows)).parts
    }
    more = parts["Table “moreevaluation"].tables[0]
    paper, here = ([cell.text for cell in line] for line in more.rows)
    assert paper[0] == "Horse, E_rms, the paper" and here[0] == "horse, E_rms, here"
    assert paper[1:6] == ["12.96", "29.61", "18.06", "7.368", "20.20"]
    assert here[1:6] == ["11.00", "–", "–", "9.000", "–"]
    lambdas = parts["Table “diff_lambda"].tables[0]
    stated, measured, _ = ([cell.text for cell in line] for line in lambdas.rows)
    assert lambdas.head[1:3] == ["(0.5, 0.5)", "(0.4, 0.4)"]
    assert stated[1:3] == ["13.56", "14.18"] and measured[1:3] == ["21.00", "22.00"]
    assert parts["Figure “gerror"].figures and parts["Figure “sparse_control"].figures


def test_protocols_have_words():
    assert report.describe("noise(0.01)/reconstruction/encoder") == (
        "noise 1 %, reconstruction, encoder pass"
    )
    assert report.describe("noisy_control(0.005)/sparse_control") == (
        "noisy control 0.5 %, sparse control"
    )
    assert report.describe("sensitivity(0.4,0.6)/fit") == "sensitivity (0.4, 0.6), best latent fit"


def test_a_machine_that_cannot_draw_still_gets_its_numbers(evaluated, monkeypatch, tmp_path):
    def refuse(*_):
        raise deformer.InputError("pictures: off-screen rendering needs EGL; install it")

    monkeypatch.setattr(report.examples, "sheet", refuse)
    rows = json.loads((evaluated[1] / "results.json").read_text())
    facts = json.loads((evaluated[1] / "run.json").read_text())
    report.write(tmp_path, rows, facts, {"bar": "y"})
    page = (tmp_path / "report.html").read_text()
    assert "No pictures: pictures: off-screen rendering needs EGL" in page
    assert "Sparse control" in page


def test_pictures_show_the_error_where_it_is(tmp_path):
    """A method that is right is dark all over; one that is wrong at the top is bright there."""
    import io

    from PIL import Image

    from deformer_app.report import shape_rows as examples

    shapes = bending_bar(2)
    wrong = shapes.vertices[0] + [0, 0, 0.3] * (shapes.vertices[0][:, 1:2] > 0.7)
    for name, vertices in [
        ("truth", shapes.vertices[0]),
        ("good-fit", shapes.vertices[0]),
        ("bad-fit", wrong),
    ]:
        deformer.save_mesh(tmp_path / f"{name}.ply", deformer.Mesh(vertices, shapes.faces))
    assert examples.sheet(tmp_path, "encoder", ["good", "bad"], "y") is None
    image = examples.sheet(tmp_path, "fit", ["missing", "good", "bad"], "y")
    assert image is not None
    pixels = np.asarray(Image.open(io.BytesIO(image))).astype(int)
    middle = len(pixels) // 2
    # Above are the true shape and both estimates, each in a column of its own.
    drawn = (np.abs(pixels[: middle // 2] - pixels[0, 0]).max(axis=2) > 60).any(axis=0)
    borders = np.flatnonzero(np.diff(drawn.astype(int)))
    assert len(borders) == 6
    lower = pixels[middle:]
    yellow = (lower[..., 0] - lower[..., 2] > 90) & (lower[..., 1] > 120)
    good, bad = yellow[:, borders[2] : borders[3]], yellow[:, borders[4] : borders[5]]
    assert good.sum() == 0
    assert bad.sum() > 50
    assert np.flatnonzero(bad.any(axis=1)).mean() < 0.5 * len(lower), "at the top"


def test_a_layout_file_gives_the_control_points(run, folder):
    (folder / "layout.json").write_text(
        json.dumps({"handles": [{"vertex": v, "position": [0, 0, 0]} for v in (3, 40, 77)]})
    )
    options = ["--methods", "arap,pca", "--layout", "layout.json", "--tests", "3", "--json"]
    status, _, err = run("bar.npz", "-o", "laid", *options)
    assert status == 0, err
    rows = json.loads((folder / "laid" / "results.json").read_text())
    measured = {
        (row["method"], row["protocol"], row["count"]) for row in rows if row["metric"] == "E_rms"
    }
    for method in ("arap", "pca"):
        assert (method, "layout/sparse_control", 3) in measured
        assert (method, "sparse_control", 3) in measured
    assert "laid out" in (folder / "laid" / "report.html").read_text(encoding="utf-8")
    (folder / "beside.json").write_text(
        json.dumps({"handles": [{"vertex": 3, "position": [0, 0, 0], "offset": 0.1}]})
    )
    status, _, err = run("bar.npz", "-o", "no", "--layout", "beside.json")
    assert status == 2 and "without offset" in err
