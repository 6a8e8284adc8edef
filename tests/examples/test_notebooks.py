"""The notebooks run, at reduced size, and have the outputs of a whole run."""

import pytest

import deformer
from paths import ROOT
from scripts import module_of

FOLDER = ROOT / "examples" / "notebooks"
SMALL = {"around": 8, "rings": 15}
SHORT = deformer.ModelConfig(components=4).with_training(epochs=3, sparsity=2.0)
# Values for the cell of parameters of each notebook.
REDUCED = {
    "1_scans_to_a_pose": {"COUNT": 12, "SIZE": SMALL, "CONFIG": SHORT},
    "2_compare_methods": {"COUNT": 12, "SIZE": SMALL, "CONFIG": SHORT, "POINTS": (4, 8)},
    "3_components_and_synthesis": {"TOP": 3, "STEPS": 3, "PIXELS": (60, 80)},
}


@pytest.fixture(scope="module")
def notebooks():
    return module_of(ROOT / "tools" / "notebooks.py")


@pytest.fixture(scope="module")
def train():
    """Training as of `deformer`, but once for all: notebooks learn from the same tubes."""
    whole, trained = deformer.train, []

    def once(shapes, **options):
        if not trained:
            trained.append(whole(shapes, **options))
        return trained[0]

    return once


def test_every_notebook_is_run():
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == set(REDUCED)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", sorted(REDUCED))
def test_notebook_runs(notebooks, train, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(deformer, "train", train)
    notebook = notebooks.load(FOLDER / f"{name}.ipynb")
    names = notebooks.run(notebook, REDUCED[name])
    for key, value in REDUCED[name].items():
        assert names[key] is value, f"{key} is no parameter of {name}"
    shown = [output for cell in notebook["cells"] for output in cell.get("outputs", ())]
    assert any("image/png" in output.get("data", {}) for output in shown)
    if name.startswith("2"):
        errors = names["errors"]
        assert errors["Deformer", 8] < errors["arap", 8]


@pytest.mark.parametrize("name", sorted(REDUCED))
def test_notebook_has_its_outputs(notebooks, name):
    cells = notebooks.load(FOLDER / f"{name}.ipynb")["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    assert "image/png" in str([cell["outputs"] for cell in code])


def test_outputs_are_what_a_cell_prints_and_its_last_value(notebooks):
    source = ["print('a')\n", "x = N + 1\n", "x"]
    cells = [
        {"cell_type": "code", "metadata": {"tags": ["parameters"]}, "source": ["N = 1"]},
        {"cell_type": "markdown", "metadata": {}, "source": ["text"]},
        {"cell_type": "code", "metadata": {}, "source": source},
    ]
    assert notebooks.run({"cells": cells}, {"N": 41})["x"] == 42
    assert cells[0]["outputs"] == []
    printed, value = cells[2]["outputs"]
    assert printed["text"] == ["a\n"] and value["data"]["text/plain"] == ["42"]
