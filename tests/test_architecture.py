"""The layers of the code, read from its imports without running it."""

import ast
from pathlib import Path

import pytest

import deformer

ROOT = Path(__file__).parent.parent
LIBRARY = ROOT / "deformer"
APPLICATION = ROOT / "app" / "deformer_app"

# A module imports only from modules before it in this list: the one place to add a new one.
ORDER = [
    "errors", "parallel", "interrupts", "mesh", "laplacian",
    "_atomic", "_json_files", "_parsing", "_obj", "_off", "_ply", "_stl", "_glb", "io", "doctor",
    "geodesics", "sampling", "rotations", "metrics", "symmetry", "strain",
    "rotation_field", "dissection", "cholesky", "denoising", "features", "differentials",
    "poisson", "mirroring",
    "device", "config", "autoencoder", "decoder", "losses", "localised", "checkpoints", "training_loop", "training",
    "factoring", "latent", "placement", "limits", "naming", "model", "storage",
    "activations", "components", "synthesis", "interpolation",
    "lanes", "packed", "surface", "landmarks", "handle_positions", "objective", "basis", "poses", "handles",
    "calibration", "learning", "uncertainty",
    "frames", "torch_frames", "roughness", "sequence", "baselines", "evaluation",
]  # fmt: skip
RANK = {name: index for index, name in enumerate(ORDER)}

SCREEN = {"pyvista", "vtk", "vtkmodules", "matplotlib", "deformer_app", "pyvistaqt", "qtpy"}
SCREEN |= {f"{name}{version}" for name in ("PySide", "PyQt") for version in (2, 5, 6)}
NUMERICS = {"torch", "scipy", "numba", "igl", "potpourri3d"}


def modules(folder):
    return sorted(folder.rglob("*.py"))


def imported(path):
    """Dotted names that a module imports, anywhere in it, each with its line."""
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [(alias.name, node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}:{node.lineno}: relative import"
            names += [(f"{node.module}.{alias.name}", node.lineno) for alias in node.names]
    return names


def imported_layers(path):
    """Library modules that a module imports, each with its line; `__init__` is the package."""
    found = []
    for name, line in imported(path):
        package, _, rest = name.partition(".")
        module = rest.split(".")[0]
        if package == "deformer":
            found.append((module if module in RANK else "__init__", line))
    return found


def library_modules():
    return [path for path in modules(LIBRARY) if path.name != "__init__.py"]


def place(path):
    """Name in ORDER of a module; a package within the library has one place."""
    return path.relative_to(LIBRARY).parts[0].removesuffix(".py")


def test_every_library_module_has_a_place():
    unlisted = {place(path) for path in library_modules()} - RANK.keys()
    assert not unlisted, f"add {unlisted} to ORDER where they belong"


@pytest.mark.parametrize("path", library_modules(), ids=place)
def test_library_imports_only_from_above(path):
    own = place(path)
    for name, line in imported_layers(path):
        inside = name == own and path.parent != LIBRARY
        assert name != "__init__", f"{path.name}:{line} imports from the whole package"
        assert inside or RANK[name] < RANK[own], f"{path.name}:{line} imports {name} from below"


@pytest.mark.parametrize("path", modules(LIBRARY), ids=lambda path: path.stem)
def test_library_knows_no_screen(path):
    for name, line in imported(path):
        assert name.split(".")[0] not in SCREEN, f"{path.name}:{line} imports {name}"


@pytest.mark.parametrize("path", modules(APPLICATION), ids=lambda path: path.stem)
def test_application_holds_no_numerics(path):
    for name, line in imported(path):
        place = f"{path.name}:{line}"
        assert name.split(".")[0] not in NUMERICS, f"{place} imports {name}"
        assert not name.startswith("numpy.linalg"), f"{place} imports {name}"
        assert not name.startswith("deformer._"), f"{place} imports the private {name}"
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and node.attr in ("linalg", "fft"):
            raise AssertionError(f"{path.name}:{node.lineno} uses {node.attr}")


@pytest.mark.parametrize(
    "path", modules(LIBRARY) + modules(APPLICATION) + modules(ROOT / "models"), ids=str
)
def test_every_module_says_what_it_is_for(path):
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))), path


def test_public_api_is_explicit():
    tree = ast.parse((LIBRARY / "__init__.py").read_text(encoding="utf-8"))
    star = [node.lineno for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
            if any(alias.name == "*" for alias in node.names)]  # fmt: skip
    assert not star, f"star import in line {star}"
    names = deformer.__all__
    assert len(names) == len(set(names))
    assert all(hasattr(deformer, name) for name in names)
    contract = {
        "InputError", "Mesh", "MeshSequence", "DeformationModel", "HandleSolver", "Pose",
        "load_shapes", "load_mesh", "save_mesh", "save_shapes", "load_model", "shipped_models",
        "extract_features", "reconstruct", "train",
    }  # fmt: skip
    assert contract <= set(names), sorted(contract - set(names))


def test_layers_are_found_in_every_form_of_import(tmp_path):
    """The checks above rest on this: no form of an import may slip through."""
    lines = [
        "import deformer.io",
        "from deformer import mesh",
        "from deformer.acap.poisson import X",
        "def f():",
        "    from deformer.model.model import load_model",
        "    import deformer",
        "    from deformer import Mesh",
        "    import vtk",
    ]
    file = tmp_path / "module.py"
    file.write_text("\n".join(lines))
    whole = ("__init__", 6), ("__init__", 7)
    assert imported_layers(file) == [("io", 1), ("mesh", 2), ("poisson", 3), ("model", 5), *whole]
    assert ("vtk", 8) in imported(file)
