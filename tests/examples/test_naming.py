"""Names of components: those of the region or the shape that each is most like."""

import shutil

import numpy as np
import pytest
from face.actions import action_regions, action_shapes
from face.expressions import PAIRED, SINGLE
from face.kit import EXPRESSIONS, Face
from flag.regions import flag_regions
from naming import find_vertices, name_by_region, name_by_shape
from typer.testing import CliRunner

import deformer
from deformer import Activations
from paths import DATA, ROOT
from shapes import small_model

MODELS = ROOT / "models" / "deformer_models"


@pytest.fixture(scope="module")
def example(load_example):
    return load_example("14_name_components")


def test_a_component_is_named_after_the_region_that_it_changes():
    model = small_model()
    acts = Activations(model)
    own = {f"own {k}": acts.displacement(k) for k in range(model.components)}
    expected = {k: f"own {k}" for k in range(model.components)}
    assert name_by_region(model, own) == expected
    assert name_by_region(model, dict(reversed(own.items()))) == expected


def test_of_regions_that_fit_alike_the_smaller_one_gives_the_name():
    model = small_model()
    exact = Activations(model).displacement(0)
    narrow = np.maximum(exact - 0.02 * exact.max(), 0)
    for regions in ({"exact": exact, "narrow": narrow}, {"narrow": narrow, "exact": exact}):
        assert name_by_region(model, regions)[0].startswith("narrow")


def test_equal_names_are_numbered_from_the_strongest_on():
    model = small_model()
    names = name_by_region(model, {"Tube": np.ones(len(model.reference.vertices))})
    ranked = [names[k] for k in Activations(model).order.tolist()]
    assert ranked == ["Tube", *(f"Tube {n}" for n in range(2, model.components + 1))]


def test_a_component_is_named_after_the_shape_that_it_or_its_opposite_makes():
    model = small_model()
    acts = Activations(model)
    shapes, opposites = {}, {}
    for k in range(model.components):
        change = acts.representative(k) - acts.reference
        shapes[f"own {k}"] = model.decode(acts.reference + change)
        opposites[f"own {k}"] = model.decode(acts.reference - change)
    expected = {k: f"own {k}" for k in range(model.components)}
    regions = dict.fromkeys(shapes, "elsewhere")
    assert name_by_shape(model, shapes, regions) == expected
    assert name_by_shape(model, opposites, regions) == expected


def test_a_component_that_is_like_no_shape_is_named_after_a_region():
    model = small_model()
    noise = np.random.default_rng(0).normal(size=model.reference.vertices.shape)
    shape = model.reference.vertices + 0.001 * noise
    names = name_by_shape(model, {"Noise": shape}, {"Noise": "Tube"})
    assert all(name.startswith("Tube") for name in names.values())


def test_vertices_are_found_in_what_a_set_was_made_from():
    model = small_model()
    points = np.concatenate([model.reference.vertices[::-1] + 1e-7, [[9.0, 9.0, 9.0]]])
    rows = find_vertices(model, points)
    np.testing.assert_array_equal(rows, np.arange(len(points) - 1)[::-1])
    with pytest.raises(deformer.InputError, match="give the source"):
        find_vertices(model, points[:-9])


def test_regions_of_the_flag_are_thirds_seen_from_the_pole():
    x, z = (part.ravel() for part in np.meshgrid(np.linspace(0, 1.5, 7), np.linspace(0, 1, 7)))
    regions = flag_regions(np.stack([x, np.zeros_like(x), z], axis=1))
    np.testing.assert_array_equal(regions["Pole side"] > 0, x < 0.45)
    np.testing.assert_array_equal(regions["Free side top"] > 0, (x > 0.95) & (z > 0.65))
    np.testing.assert_array_equal(regions["Top"] > 0, z > 0.65)
    whole = regions["Pole side"] + regions["Middle"] + regions["Free side"]
    np.testing.assert_array_equal(whole, regions["Whole flag"])


def test_actions_of_the_face_are_words_with_the_side_first():
    offsets = {name: np.full((1, 3), float(n)) for n, name in enumerate(EXPRESSIONS)}
    shapes = action_shapes(Face(np.zeros((1, 3)), np.empty((0, 3), int), offsets))
    smile = [offsets[f"mouthSmile_{side}"] for side in "LR"]
    np.testing.assert_array_equal(shapes["Left mouth smile"], smile[0])
    np.testing.assert_array_equal(shapes["Mouth smile"], sum(smile))
    np.testing.assert_array_equal(shapes["Mouth left"], offsets["mouthLeft"])
    assert len(shapes) == len(SINGLE) + len(PAIRED)
    regions = action_regions()
    assert list(regions) == list(shapes)
    assert regions["Left mouth smile"] == "Left mouth" and regions["Mouth left"] == "Mouth"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["flag", "humanoid", "face"])
def test_a_shipped_model_has_the_names_that_the_example_gives(example, kind):
    source = DATA / "ict-expressions.npz" if kind == "face" else None
    if source is not None and not source.exists():
        pytest.skip(f"needs {source.name}, the kit's neutral face and expressions")
    if kind == "humanoid":
        pytest.importorskip("anny", reason="needs anny: pip install 'deformer[data]'")
    model = deformer.load_model(kind)
    assert example.find_names(kind, model, source) == model.component_names


def test_only_names_of_the_model_change(example, tmp_path):
    folder = tmp_path / "flag"
    shutil.copytree(MODELS / "flag", folder)
    blank = deformer.save_names(folder, dict.fromkeys(range(20), ""))
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    app = example.typer.Typer()
    app.command()(example.main)
    done = CliRunner().invoke(app, ["flag", str(folder)])
    assert done.exit_code == 0 and "Free side top" in done.output
    named = deformer.load_model(folder)
    assert set(named.component_names) == set(range(20))
    assert named.fingerprint == blank.fingerprint
    after = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert {name for name in before if before[name] != after[name]} == {"model.json"}
    assert after.keys() == before.keys()


def test_a_missing_source_is_told_in_one_line(example):
    app = example.typer.Typer()
    app.command()(example.main)
    done = CliRunner().invoke(app, ["hand", "hand"])
    assert done.exit_code == 2 and done.output.count("\n") == 1
    assert "no source" in done.output
