"""The code of the manual runs, page by page, as it stands: on the model that one of them trains."""

import json
import shutil

import pytest
import typer
from typer.core import TyperGroup

import deformer
from deformer_app import console
from deformer_app.cli import main as cli
from pages import DOCS, OUTSIDE, PAGES, blocks, run as run_page, untried_commands
from paths import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]
# The README has a test of its own.
TRAINING = DOCS / "start" / "train.md"
RUN = [page for page in sorted(DOCS.rglob("*.md")) + OUTSIDE[1:] if blocks(page)]
RUN.remove(TRAINING)  # the fixture runs it
UNTRIED = [words for page in PAGES for words in untried_commands(page)]
MADE = ("walk", "walk-model", "handles.json")  # by the page of training, for the others


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """The folder in which the page "Train on your own meshes" has been run."""
    folder = tmp_path_factory.mktemp("manual")

    def command(*words):
        return console.run(cli.app, list(words)), "", ""

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run_page(TRAINING, command, folder)
    return folder


def test_the_page_of_training_ends_with_a_pose(trained):
    pose = deformer.load_mesh(trained / "pose.obj").vertices
    assert abs(pose[0] - [0.0, 0.125, 0.0]).max() < 1e-6  # the pin
    assert pose[190] == pytest.approx([1.5, 0.8, 0.0], abs=0.3)


def bring(page, folder):
    """The files of their own that readers of a page have."""
    shapes = deformer.load_shapes(folder / "walk")
    if page.name in ("files.md", "programs.md"):
        deformer.save_shapes(folder / "face.glb", shapes, fps=24)
    if page.name == "files.md":
        deformer.save_shapes(folder / "walk.glb", shapes, fps=24)  # its clip has this name
        (folder / "walk.glb").rename(folder / "dance.glb")
        deformer.save_shapes(folder / "scans", shapes, format="obj")
        deformer.save_mesh(folder / "tpose.obj", shapes.mesh(0))
    if page.name == "large-sets.md":
        handle = json.loads((folder / "handles.json").read_text())["handles"]
        (folder / "frames.json").write_text(json.dumps({"frames": [handle, handle]}))


@pytest.mark.parametrize("page", RUN, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_code_runs(page, trained, tmp_path, monkeypatch, run):
    for name in MADE:
        copy = shutil.copytree if (trained / name).is_dir() else shutil.copyfile
        copy(trained / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    if "how-to" in page.parts:
        bring(page, tmp_path)
    run_page(page, run, tmp_path)


@pytest.mark.parametrize("words", UNTRIED, ids=" ".join)
def test_names_and_options_of_other_commands_are_right(words):
    """Of those that do not run here: they need data, a display, other machines or minutes."""
    program = typer.main.get_command(cli.app)
    assert isinstance(program, TyperGroup)
    if words == ["--version"]:
        return
    with program.make_context("deformer", words, resilient_parsing=True) as context:
        command = program.get_command(context, words[0])
        assert command is not None
        command.make_context(words[0], words[1:], parent=context).close()
