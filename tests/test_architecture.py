"""The plan of the code, read from its imports without running it."""

import ast
import importlib
import inspect
import re
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LIBRARY = ROOT / "deformer"
APPLICATION = ROOT / "app" / "deformer_app"

# A package imports only from packages before it. All may use the modules beside the packages.
LOOSE_MODULES = ("errors", "checks", "compilation", "compilation_state", "workspace")
LIBRARY_PACKAGES = (
    "geometry", "io", "documents", "animation", "preflight", "linalg", "parallel", "acap",
    "network", "model", "analysis", "rigging", "editing", "training", "baselines", "evaluation",
)  # fmt: skip
APPLICATION_PACKAGES = ("rendering", "report", "viewer", "cli")
# Packages of the library that the application may use beside the names of `deformer` itself.
OPEN_TO_THE_APPLICATION = {"io", "evaluation", "parallel"}

SCREEN = {"pyvista", "vtk", "vtkmodules", "matplotlib", "deformer_app", "pyvistaqt"}
QT = {"qtpy"} | {f"{name}{version}" for name in ("PySide", "PyQt") for version in (2, 5, 6)}
NUMERICS = {"torch", "scipy", "numba", "igl", "potpourri3d"}


@dataclass(frozen=True)
class Import:
    """`from module import name` (name is None for `import module`) in a line of a file."""

    module: str
    name: str | None
    line: int


def modules(folder):
    return sorted(folder.rglob("*.py"))


def imported(path):
    """What a module imports, anywhere in it."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [Import(alias.name, None, node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}:{node.lineno}: relative import"
            assert node.module is not None
            found += [Import(node.module, alias.name, node.lineno) for alias in node.names]
    return found


def exports(package):
    """Names in the `__init__.pyi` of a package: what others may import from it."""
    names = set()
    for node in ast.parse((package / "__init__.pyi").read_text(encoding="utf-8")).body:
        assert isinstance(node, ast.ImportFrom), f"{package.name}: {ast.unparse(node)}"
        for alias in node.names:
            assert alias.asname == alias.name, f"{package.name}: {alias.name} needs `as`"
            names.add(alias.name)
    return names


EXPORTS = {name: exports(LIBRARY / name) for name in LIBRARY_PACKAGES}
PUBLIC = exports(LIBRARY)


def faults_in_library(path, package):
    """Imports of a library module in `package` that the plan does not allow, as text."""
    faults = []
    for entry in imported(path):
        root, *parts = entry.module.split(".")
        if root in SCREEN | QT:
            faults.append(f"line {entry.line}: the library knows no {entry.module}")
        if root != "deformer" or (len(parts) == 1 and parts[0] in LOOSE_MODULES):
            continue
        if not parts:
            faults.append(f"line {entry.line}: imports from the whole library")
        elif parts[0] == package:
            continue
        elif LIBRARY_PACKAGES.index(parts[0]) > LIBRARY_PACKAGES.index(package):
            faults.append(f"line {entry.line}: {parts[0]} lies above {package}")
        elif len(parts) > 1 or entry.name not in EXPORTS[parts[0]]:
            faults.append(f"line {entry.line}: {entry.module} does not export {entry.name}")
    return faults


def faults_in_application(path, package):
    """The same of a module of the application; `package` is None outside of any."""
    faults = []
    for entry in imported(path):
        root, *parts = entry.module.split(".")
        if root in NUMERICS or entry.module.startswith("numpy.linalg"):
            faults.append(f"line {entry.line}: numerics, {entry.module}")
        if root in QT | {"pyvistaqt"} and path.parent.name != "qt":
            faults.append(f"line {entry.line}: only viewer/qt knows {entry.module}")
        if root == "deformer":
            allowed = PUBLIC | {None} | OPEN_TO_THE_APPLICATION
            if parts:
                allowed = EXPORTS[parts[0]] if parts[0] in OPEN_TO_THE_APPLICATION else set()
            if len(parts) > 1 or entry.name not in allowed:
                faults.append(f"line {entry.line}: {entry.module}.{entry.name} is not public")
        if root == "deformer_app":
            target = parts[0] if parts else entry.name
            if target in APPLICATION_PACKAGES and package in APPLICATION_PACKAGES:
                above = APPLICATION_PACKAGES.index(target) > APPLICATION_PACKAGES.index(package)
                if above:
                    faults.append(f"line {entry.line}: {target} lies above {package}")
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and node.attr in ("linalg", "fft"):
            faults.append(f"line {node.lineno}: numerics, {node.attr}")
    return faults


def package_of(path, root):
    inside = path.relative_to(root).parts
    return inside[0] if len(inside) > 1 else None


def name_of(path):
    return path.relative_to(ROOT).as_posix()


def test_every_package_has_its_place():
    for root, packages in ((LIBRARY, LIBRARY_PACKAGES), (APPLICATION, APPLICATION_PACKAGES)):
        found = {path.parent.name for path in root.glob("*/__init__.py")}
        assert found == set(packages)
    loose = {path.name for path in LIBRARY.glob("*.py")}
    assert loose == {"__init__.py", "__main__.py", *(f"{name}.py" for name in LOOSE_MODULES)}


@pytest.mark.parametrize(
    "path", [path for path in modules(LIBRARY) if path.parent != LIBRARY], ids=name_of
)
def test_library_imports_from_packages_below_what_they_export(path):
    assert not faults_in_library(path, package_of(path, LIBRARY))


@pytest.mark.parametrize("path", modules(APPLICATION), ids=name_of)
def test_application_stands_on_public_names(path):
    assert not faults_in_application(path, package_of(path, APPLICATION))


def test_no_module_takes_part_in_a_cycle():
    """Within packages, too; imports inside functions and for type checkers do not count."""
    graph = {}
    for path in modules(LIBRARY) + modules(APPLICATION):
        base = ROOT if path.is_relative_to(LIBRARY) else APPLICATION.parent
        own = ".".join(path.relative_to(base).with_suffix("").parts)
        tree = ast.parse(path.read_text(encoding="utf-8"))
        graph[own] = {
            target
            for node in tree.body
            if isinstance(node, ast.ImportFrom) and node.module is not None
            for target in (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))
        }
    done = set()

    def visit(module, trail):
        assert module not in trail, " → ".join([*trail[trail.index(module) :], module])
        if module not in done:
            for target in sorted(graph[module] & graph.keys()):
                visit(target, [*trail, module])
            done.add(module)

    for module in graph:
        visit(module, [])


@pytest.mark.parametrize("path", modules(LIBRARY) + modules(APPLICATION), ids=name_of)
def test_every_module_says_what_it_is_for(path):
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))), path


@pytest.mark.parametrize("package", [None, *LIBRARY_PACKAGES])
def test_exports_are_there_and_no_submodule_hides_one(package):
    """An export with the name of a submodule would be the one or the other, by who came first."""
    folder = LIBRARY / package if package else LIBRARY
    module = importlib.import_module(f"deformer.{package}" if package else "deformer")
    names = EXPORTS[package] if package else PUBLIC
    assert set(module.__all__) == names
    for name in names:
        assert getattr(module, name) is not None
    inside = {path.stem for path in folder.glob("*.py")} | {p.name for p in folder.glob("*/")}
    hidden = {name for name in names & inside if not inspect.ismodule(getattr(module, name))}
    assert not hidden, "an export has the name of a submodule"


def test_the_map_shows_what_is_there():
    """CONTRIBUTING's table of packages, from the top down, and every file that it names."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \|[^|]*\| `(\w+\.py)` \|$", text, re.MULTILINE)
    assert tuple(package for package, _ in reversed(rows)) == LIBRARY_PACKAGES
    named = {f"{package}/{file}" for package, file in rows}
    named |= set(re.findall(r"`([\w/]+/\w+\.py)`", text))
    for name in sorted(named):
        assert any((root / name).is_file() for root in (ROOT, LIBRARY, APPLICATION)), name


def test_the_contract_is_public():
    contract = {
        "InputError", "Mesh", "MeshSequence", "DeformationModel", "HandleSolver", "Pose",
        "load_shapes", "load_mesh", "save_mesh", "save_shapes", "load_model", "shipped_models",
        "extract_features", "reconstruct", "train",
    }  # fmt: skip
    assert contract <= PUBLIC, sorted(contract - PUBLIC)


def test_faults_are_found_in_every_form_of_import(tmp_path):
    """The checks above rest on this: no form of an import may slip through."""
    lines = [
        "import deformer.io",
        "from deformer import mesh",
        "from deformer.training import train",
        "from deformer.geometry.mesh import Mesh",
        "def f():",
        "    import deformer",
        "    from deformer.geometry import no_such_name",
        "    import vtk",
        "from deformer.geometry import Mesh",
        "from deformer.errors import InputError",
        "from deformer.acap.features import FeatureExtractor",
    ]
    file = tmp_path / "module.py"
    file.write_text("\n".join(lines))
    found = [fault.split(":")[0] for fault in faults_in_library(file, "acap")]
    assert sorted(found) == sorted(f"line {n}" for n in (1, 2, 3, 4, 6, 7, 8))
    lines = [
        "from deformer import Mesh, io",
        "from deformer.io import write_json",
        "import deformer",
        "from deformer import exp_",
        "from deformer.geometry import Mesh",
        "import scipy.sparse",
        "from deformer_app.cli import main",
        "from qtpy import QtCore",
        "x = numpy.linalg.norm(y)",
    ]
    file.write_text("\n".join(lines))
    found = [fault.split(":")[0] for fault in faults_in_application(file, "viewer")]
    assert sorted(found) == sorted(f"line {n}" for n in (4, 5, 6, 7, 8, 9))
