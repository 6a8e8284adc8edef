"""What is imported, and what is not: each in a process of its own."""

import json
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

# Packages that take long to import, each needed by a part of the program alone.
HEAVY = {
    "torch", "numba", "scipy", "trimesh", "igl", "potpourri3d", "natsort", "typer", "rich",
    "matplotlib", "pyvista", "pyvistaqt", "vtkmodules", "PySide6", "PIL", "jinja2", "filelock",
    "dask", "distributed",
}  # fmt: skip
COMMAND = "import sys; sys.argv[1:] = {arguments}; from deformer_app.entry import main\n"
COMMAND += "try: main()\nexcept SystemExit as end: assert not end.code"
SOLVE = """
import deformer
model = deformer.load_model("humanoid")
solver = deformer.HandleSolver(model)
solver.set_handles([17, 900], model.reference.vertices[[17, 900]] + 0.1, hard=True)
solver.solve()
"""
SEQUENCE = """
import deformer, numpy
model = deformer.load_model("humanoid")
targets = numpy.repeat(model.reference.vertices[[17, 900]][None], 3, axis=0)
deformer.fit_sequence(model, [17, 900], targets)
"""


def heavy_modules_after(code):
    """Which of `HEAVY` a process has imported that runs `code`."""
    report = "\nimport json, sys\nprint(json.dumps([n.split('.')[0] for n in sys.modules]))"
    done = subprocess.run([sys.executable, "-c", code + report], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stdout.splitlines()[-1])) & HEAVY


def command(*arguments):
    return COMMAND.format(arguments=list(map(str, arguments)))


def test_the_library_alone_imports_nothing():
    assert heavy_modules_after("import deformer") == set()


def test_a_model_is_read_without_what_computes():
    code = "import deformer; deformer.load_model('humanoid').fingerprint"
    assert heavy_modules_after(code) == {"scipy"}


@pytest.mark.parametrize("arguments", [("info", "humanoid"), ("info", "flag", "--json")], ids=str)
def test_information_about_a_model_needs_no_compiler(arguments):
    assert heavy_modules_after(command(*arguments)) == {"scipy", "typer", "rich"}


@pytest.mark.parametrize("code", [SOLVE, SEQUENCE], ids=["handles", "sequence"])
def test_fits_need_no_torch_and_nothing_of_the_application(code):
    assert heavy_modules_after(code) <= {"scipy", "numba", "potpourri3d"}


def test_the_command_that_fits_needs_no_more(tmp_path):
    handles = tmp_path / "handles.json"
    handles.write_text('{"handles": [{"vertex": 17, "position": [0.1, 0.5, 0.2]}]}')
    found = heavy_modules_after(command("fit", "humanoid", handles, "-o", tmp_path / "pose.ply"))
    assert found <= {"scipy", "numba", "potpourri3d", "typer", "rich"}


def test_the_editor_needs_no_torch():
    pytest.importorskip("pyvistaqt")
    assert "torch" not in heavy_modules_after("import deformer_app.viewer.qt.window")


@pytest.mark.parametrize("missing", ["typer", "rich"])
def test_a_command_without_its_packages_says_what_to_install(missing):
    block = f"import sys; sys.modules[{missing!r}] = None\n"
    code = f"{block}sys.argv[1:] = ['info']; from deformer_app.entry import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    expected = f'deformer: the command line needs {missing}; pip install "deformer[app]"\n'
    assert (done.returncode, done.stderr) == (2, expected)
