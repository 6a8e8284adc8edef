"""The code of the manual runs, page by page, as it stands: on the model that one of them trains."""

import shutil

import pytest

import deformer
from deformer_app import console
from deformer_app.cli import main as cli
from pages import DOCS, OUTSIDE, blocks, run as run_page
from paths import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]
# The README has a test of its own.
TRAINING = DOCS / "start" / "train.md"
RUN = [page for page in sorted(DOCS.rglob("*.md")) + OUTSIDE[1:] if blocks(page)]
RUN.remove(TRAINING)  # the fixture runs it
EPOCHS = "3"  # in place of the default number, which takes longer


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """The folder in which the page "Train on your own meshes" has been run."""
    folder = tmp_path_factory.mktemp("manual")

    def command(*words):
        few = ("--epochs", EPOCHS) if words[0] == "train" else ()
        return console.run(cli.app, [*words, *few]), "", ""

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run_page(TRAINING, command, folder)
    return folder


def test_the_page_of_training_ends_with_a_pose(trained):
    pose = deformer.load_mesh(trained / "pose.obj").vertices
    assert abs(pose[0] - [0.0, 0.125, 0.0]).max() < 1e-6  # the pin
    assert pose[190] == pytest.approx([1.5, 0.8, 0.0], abs=0.3)


@pytest.mark.parametrize("page", RUN, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_code_runs(page, trained, tmp_path, monkeypatch, run):
    for name in ("walk", "walk-model"):
        shutil.copytree(trained / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    run_page(page, run, tmp_path)
