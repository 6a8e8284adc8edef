"""Every public function, with each of its arguments replaced by what is none: InputError, or fine.

`test_wrong_arguments.py` says which values are refused, and what is told of them.
"""

import inspect

import numpy as np
import pytest

import deformer
from deformer import InputError, io
from deformer.workspace import LEAST_MEMORY
from shapes import sequence, small_model

JUNK = [
    None,
    "abc",
    "a\0b",
    "\ud800",
    b"abc",
    -1,
    1.5,
    True,
    10**400,
    np.nan,
    [],
    {},
    {"a": "b"},
    ["a", "b"],
    [None],
    [[1], [1, 2]],
    object(),
    np.zeros((7, 7)),
    np.array(["a", "b"]),
    np.array(None),
    np.ma.masked_array([1.0, 2.0, 3.0], [0, 1, 0]),
]
# Classes that hold results, types, and packages: nobody calls them with values of their own.
RESULTS = {
    *("Layout", "Rig", "SavedShapes", "ComponentKeys", "ComponentRegion"),
    *("Component", "Finding", "Pose", "Repair", "Report", "SequenceFit", "ShapePath", "Symmetry"),
    *("BODIES", "Body"),
    *(
        "SequenceMemory",
        "TrainingMemory",
        "TrainingProgress",
        "Uncertainty",
        "DeformationModel",
        "BlendSpace",
        "InputError",
    ),
    *("baselines", "evaluation", "io"),
}
# Functions without arguments, or of `io` with callbacks and tested in tests/io.
OTHERS = {
    *("SEQUENCE_SUFFIXES", "compiling", "assist_training"),
    *(
        "shipped_models",
        "io.MESH_SUFFIXES",
        "io.LARGEST",
        "io.JsonValue",
        "io.HandleFile",
    ),
    *("io.HandleBody", "io.HandlePrior", "io.HandleStart"),
    *(
        "io.HandleTarget",
        "io.save_copy",
        "io.save_shape_files",
        "io.atomic_directory",
        "io.check_directory",
    ),
    *("io.begins_with", "io.digest", "io.SHAPE_SUFFIXES", "io.save_shape_files"),
    # Parts of files, and what reading gives.
    *("io.GlbBuilder", "io.glb_of", "io.VERTICES", "io.INDICES"),
    *("io.GltfAsset", "io.GltfScene", "io.VertexRange"),
    *("io.clip_extras", "io.is_upright_node", "io.scene_up", "io.upright_node"),
    *("io.UsdMesh", "io.UsdScene", "io.open_usd"),
    *("io.read_rows", "io.write_rows"),  # of arrays of the program's own
    *("io.HandleTracks", "io.handle_tracks"),  # of frames that load_handles gives
    *("io.PlyElement", "io.PlyProperty", "io.ply_header", "io.ply_row"),
}


def load_shapes_into_a_file(path):
    return deformer.load_shapes(path, workspace=deformer.Workspace(LEAST_MEMORY))


@pytest.fixture(scope="module")
def calls(tmp_path_factory):
    """Name → function and arguments with which it works."""
    folder = tmp_path_factory.mktemp("files")
    model, shapes = small_model(), sequence(3)
    mesh, V = model.reference, model.reference.vertices
    model.save(folder / "model")
    io.save_mesh(folder / "a.ply", mesh)
    io.save_mesh(folder / "a.glb", mesh)
    io.save_shapes(folder / "s.npz", shapes)
    io.write_json(folder / "h.json", {"handles": [{"vertex": 3, "position": [0, 0, 0]}]})
    io.write_json(folder / "split.json", {"train": [0, 1], "test": [2]})
    io.write_tensors(folder / "t.safetensors", {"a": np.zeros(3)}, {"a": "{}"})
    solver = deformer.HandleSolver(model)
    solver.set_handles([17], V[[17]])
    solver.solve()
    obj = io.mesh_bytes(mesh, ".obj")
    document = deformer.Document(".obj", obj, "a", len(V), mesh.faces)
    code, frames = model.codes[0], np.zeros((2, 1, 3))
    synthesis = deformer.Synthesis(model)
    rig = deformer.rig(model, 2)
    features = deformer.extract_features(shapes)
    stored = load_shapes_into_a_file(folder / "s.npz")

    def entered(manager):
        def call(*arguments):
            with manager(*arguments) as path:
                if path is not None:
                    path.touch()

        return call

    found = {
        "Activations": (model,),
        "Document": (".obj", obj, "a", len(V), mesh.faces, {}),
        "AdamSettings": {},
        "ComponentAnalysis": (model, 1),
        "FaceStrain": (mesh,),
        "FactorisationSettings": {},
        "Familiarity": (model,),
        "FeatureExtractor": (mesh,),
        "Floor": (0.0, (0.0, 1.0, 0.0)),
        "FeatureScaler": (0.0, 1.0, 0.0, 1.0),
        "Geodesics": (mesh, 4),
        "Handle": (3, [0.0, 0, 0], 1.0, "soft", [1.0, 0, 0, 0], 1.0),
        "HandleSolver": {"model": model},
        "Mesh": (V, mesh.faces),
        "MeshSequence": (shapes.vertices, shapes.faces, ("a", "b", "c")),
        "ModelConfig": {},
        "PoissonSystem": (mesh,),
        "StoredShapes": (stored.vertices, shapes.faces, ("a", "b", "c")),
        "training_memory": (3, 10, 5),
        "Workspace": (LEAST_MEMORY, folder),
        "SurfacePoint": ((1, 2), (0.5, 0.5), 0.0),
        "Synthesis": (model, code),
        "check_blend_space": ("latent",),
        "check_checkpoint": (folder / "checkpoint",),
        "check_mesh_output": (folder / "o.ply",),
        "check_model_folder": (folder / "new",),
        "check_shapes_output": (folder / "o.npz",),
        "check_resumable": {"checkpoint": folder / "checkpoint"},
        "component_keys": (model, [0], 0.1),
        "component_regions": (model, deformer.Activations(model), 0.4),
        "draw_codes": (model, 2, 0, 1.0),
        "e_rms": (shapes.vertices, shapes.vertices, "none"),
        "examine": (shapes, None),
        "extract_features": (shapes, 0),
        "farthest_points": (deformer.Geodesics(mesh), 3, 0),
        "find_symmetry": (mesh,),
        "fit_sequence": {"model": model, "vertices": [3], "targets": frames},
        "fit_sequence_parts": {"model": model, "vertices": [3], "targets": frames},
        "remove_windows": (folder / "windows",),
        "sequence_memory": (10, 5, 3),
        "check_shapes_size": (folder / "o.npz", 2, 10),
        "has_checkpoint": (folder / "checkpoint",),
        "layout": (model, 3),
        "interpolate_rotations": (np.eye(3), np.eye(3), 0.5),
        "interpolate_codes": (model.codes[:2], 0.5),
        "interpolate": (model, V + np.zeros((2, 1, 1)), 3, "linear"),
        "mirrored_pose": (model, V, deformer.find_symmetry(mesh), mesh),
        "load_document": (folder / "a.ply",),
        "load_mesh": (folder / "a.ply",),
        "local_rotations": (model, [3], V),
        "posed_shape": (model, model.codes[0], np.zeros(3), np.zeros(3)),
        "poses_to_rest": (solver,),
        "solve_to_rest": (solver,),
        "surface_gaps": (model, solver.solve(), [3]),
        "load_model": (folder / "model",),
        "load_shapes": {"path": folder / "s.npz", "fps": 24.0, "clip": None, "workspace": None},
        "log_to_rotation": (np.zeros((2, 3)),),
        "reconstruct": (shapes, features, 0),
        "remove_checkpoint": (folder / "checkpoint",),
        "repair_shapes": (shapes, None),
        "rig": {"model": model, "bones": 2},
        "save_mesh": {"path": folder / "o.ply", "mesh": mesh, "like": document},
        "save_names": (folder / "model", {0: "nod"}),
        "save_shapes": {"path": folder / "o.glb", "shapes": shapes, "like": document},
        "spread": (V, 3),
        "symmetry_about": (mesh, [0.0, 0, 0], [1.0, 0, 0]),
        "target_noise": (model, 0.01),
        "train": {
            "shapes": shapes,
            "document": None,
            "components": 2,
            "epochs": 1,
            "on_progress": None,
        },
        "transfer": (model, model, code),
        "transfer_code": (model, model, code),
        "uncertainty": (solver,),
        "axis_warning": (model, [3], [[0.0, 0, 0]]),
        "unit_warning": (model, [3], [[0.0, 0, 0]]),
        "vertex_errors": (shapes.vertices, shapes.vertices, "none"),
        "vertex_normals": (V, mesh.faces),
    }
    table = {name: (getattr(deformer, name), given) for name, given in found.items()}
    table |= {
        "SurfacePoint.on_face": (deformer.SurfacePoint.on_face, (mesh.faces, 0, [1.0, 0, 0], 0.0)),
        "MeshSequence.subset": (shapes.subset, ([0],)),
        "MeshSequence.mesh": (shapes.mesh, (0,)),
        "Document.write": (document.write, (V, ".ply")),
        "DeformationModel.distances": (model.distances, (3,)),
        "DeformationModel.encode": (model.encode, (V,)),
        "DeformationModel.decode": (model.decode, (code,)),
        "DeformationModel.fit": (model.fit, (V, 1)),
        "DeformationModel.save": (model.save, (folder / "again",)),
        "DeformationModel.component": (model.component, (1,)),
        "DeformationModel.label": (model.label, (1,)),
        "DeformationModel.with_component_names": (model.with_component_names, ({0: "nod"},)),
        "HandleSolver.set_handles": (
            solver.set_handles,
            {"vertices": [3], "targets": [[0.0, 0, 0]], "orientations": [[1.0, 0, 0, 0]]},
        ),
        "HandleSolver.drag": (solver.drag, (17, [0.0, 0, 0], [1.0, 0, 0, 0])),
        "HandleSolver.set_floor": (solver.set_floor, (deformer.Floor(-1.0),)),
        "Floor.at": (deformer.Floor.at, (model, 0.5)),
        "Floor.under": (deformer.Floor.under, (model,)),
        "Floor.depths": (deformer.Floor(0.0).depths, (V,)),
        "Floor.above": (deformer.Floor(0.0).above, (V,)),
        "HandleSolver.set_prior": (solver.set_prior, {}),
        "HandleSolver.restore": (solver.restore, (code, [0.0, 0, 0], [0.0, 0, 0])),
        "HandleSolver.solve_to_convergence": (solver.solve_to_convergence, (3,)),
        "Rig.pose": (rig.pose, (rig.rest,)),
        "Rig.local": (rig.local, (rig.rest,)),
        "Rig.fit": (rig.fit, (V,)),
        "Rig.glb": (rig.glb, (24.0, document)),
        "Rig.save": (rig.save, (folder / "rig.glb", 24.0, document)),
        "Synthesis.code": (synthesis.code, ({0: 1.0},)),
        "Synthesis.shape": (synthesis.shape, ({0: 1.0}, "latent")),
        "Synthesis.sweep": (synthesis.sweep, (0, [0.0, 1.0], {}, "latent")),
        "Familiarity.percentile": (deformer.Familiarity(model).percentile, (code,)),
        "io.atomic_path": (entered(io.atomic_path), (folder / "w.txt",)),
        "io.check_copy": (io.check_copy, (folder / "s.npz", folder / "copy")),
        "io.copied_path": (
            lambda a, b: io.copied_path(a, b, 3),
            (folder / "s.npz", folder / "copy"),
        ),
        "io.check_output_file": (io.check_output_file, (folder / "w.json",)),
        "io.check_shapes_output": (io.check_shapes_output, (folder / "w.npz",)),
        "io.kind_of": (io.kind_of, (folder / "h.json",)),
        "io.wrong_kind": (io.wrong_kind, (folder / "h.json", "split")),
        "io.expecting": (entered(io.expecting), (folder / "h.json", "handles")),
        "io.load_handles": (
            io.load_handles,
            (folder / "h.json", len(V), mesh.faces, model.components, None),
        ),
        "io.load_split": (io.load_split, (folder / "split.json", 3)),
        "io.locked": (entered(io.locked), (folder / "w", 0.0)),
        "io.mesh_bytes": (io.mesh_bytes, (mesh, ".obj")),
        "io.parse_value": (io.parse_value, ("{}",)),
        "io.read_bytes": (io.read_bytes, (folder / "h.json",)),
        "io.packed_gltf": (io.packed_gltf, (folder / "a.glb",)),
        "io.read_gltf": (io.read_gltf, (folder / "a.glb",)),
        "io.folded_name": (io.folded_name, ("e.ply",)),
        "io.read_json": (io.read_json, (folder / "h.json",)),
        "io.read_metadata": (io.read_metadata, (folder / "t.safetensors",)),
        "io.read_tensors": (io.read_tensors, (folder / "t.safetensors",)),
        "io.read_value": (io.read_value, (folder / "h.json",)),
        "io.usd_library": (io.usd_library, ("a.usda",)),
        "io.shape_files": (io.shape_files, (folder / "s.npz",)),
        "io.with_reference": (io.with_reference, (shapes, 1)),
        "io.write_json": (io.write_json, (folder / "w.json", {})),
        "io.write_npz": (io.write_npz, (folder / "w.npz", {"a": np.zeros(3)})),
        "io.write_tensors": (io.write_tensors, (folder / "t", {"a": np.zeros(3)}, {"a": "b"})),
    }
    copied = (folder / "s.npz", folder / "copy")
    table["io.copied_path"] = (lambda source, to: io.copied_path(source, to, 3), copied)
    table["io.parse_value"] = (lambda text: io.parse_value(text, "a.json"), ("{}",))
    table["io.read_metadata"] = (lambda path: io.read_metadata(path, "a"), (folder / "t",))
    for name in ("load_mesh", "load_shapes"):
        table[f"io.{name}"] = table[name]
    table["io.save_shapes"] = (io.save_shapes, (folder / "o.npz", shapes, "ply"))
    table["io.save_mesh"] = (io.save_mesh, (folder / "o.ply", mesh))
    return table


NAMES = [name for name in dir(deformer) if not name.startswith("_")]
NAMES += [f"io.{name}" for name in dir(io) if not name.startswith("_")]


def test_every_public_function_is_tried(calls):
    public = {name for name in NAMES if not inspect.ismodule(getattr(deformer, name, None))}
    submodules = {
        name
        for name in public
        if name.startswith("io.") and inspect.ismodule(getattr(io, name[3:]))
    }
    assert public - submodules - set(calls) - RESULTS - OTHERS == set()


def attempts(function, given):
    """Calls with one argument replaced: positional ones of a tuple, named ones of a dict."""
    if isinstance(given, tuple):
        for n in range(len(given)):
            for value in JUNK:
                yield (*given[:n], value, *given[n + 1 :]), {}, n, value
        return
    for name, parameter in inspect.signature(function).parameters.items():
        if name not in ("on_progress", "progress") and parameter.kind is not parameter.VAR_KEYWORD:
            for value in JUNK:
                yield (), {**given, name: value}, name, value


def mistakes(function, given):
    """What came of arguments that are wrong, but for lines that tell so."""
    for arguments, named, where, value in attempts(function, given):
        if where == "checkpoint" and isinstance(value, str) and value == "abc":
            continue  # a folder like any other, to be made in the working directory
        try:
            function(*arguments, **named)
        except InputError as error:
            text = str(error)
            if "\n" in text or len(text) > 400 or "NoneType" in text:
                yield where, value, text
        except Exception as error:
            yield where, value, repr(error)


def names_of_calls():
    methods = ["SurfacePoint.on_face", "MeshSequence.subset", "MeshSequence.mesh"]
    methods += [f"DeformationModel.{n}" for n in ("encode", "decode", "fit", "save", "component")]
    methods += [f"DeformationModel.{n}" for n in ("label", "with_component_names")]
    methods += [f"HandleSolver.{n}" for n in ("set_handles", "drag", "set_prior", "restore")]
    methods += ["HandleSolver.solve_to_convergence", "Familiarity.percentile", "Document.write"]
    methods += [f"Synthesis.{n}" for n in ("code", "shape", "sweep")]
    methods += [f"Rig.{n}" for n in ("pose", "local", "fit", "glb", "save")]
    return sorted({*NAMES, *methods} - RESULTS - OTHERS)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", names_of_calls())
def test_arguments_that_are_none_end_in_one_line(calls, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if name not in calls:
        pytest.skip("a package")
    assert list(mistakes(*calls[name])) == []
