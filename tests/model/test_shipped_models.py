"""Models that come with the package: what their cards say, and what a drag of them gives."""

import re

import numpy as np
import pytest
from PIL import Image

import deformer
from paths import ROOT

MODELS = ROOT / "models" / "deformer_models"
NAMES = sorted(path.parent.name for path in MODELS.glob("*/model.json"))
# Made of the data of others, whose licence asks for its text.
LICENSED = {"face": "USC Institute for Creative Technologies", "hand": "Amazon"}
# Vertices that are pulled, and how far, in the model's units.
SMILE = {1775: (-0.7, 1.0, -0.9), 1873: (0.7, 1.0, -0.9)}
NOISE = 0.007  # of positions, in bounding diagonals, as in the viewer


def load(name):
    return deformer.load_model(name)


def card(name):
    """The text of a model's card, in one line."""
    return " ".join((MODELS / name / "README.md").read_text(encoding="utf-8").split())


def pulled(model, offsets):
    handles = list(offsets)
    targets = model.reference.vertices[handles] + np.array([*offsets.values()])
    solver = deformer.HandleSolver(model, noise=NOISE)
    solver.set_handles(handles, targets)
    return solver.solve().vertices, targets


def stretches(model, shapes):
    """Largest and smallest stretch (N, F, 2) of the faces, against the reference."""
    strain = deformer.FaceStrain(model.reference)
    return np.stack([strain.principal(vertices) for vertices in shapes])


def assert_bounded(model, shape):
    """No face is stretched or squashed much more than in the shapes that the model learned from."""
    examples = stretches(model, model.decode(model.codes))
    found = stretches(model, shape[None])
    high, low = np.quantile(examples[..., 0], 1 - 1e-4), np.quantile(examples[..., 1], 1e-4)
    assert np.quantile(found[..., 0], 0.999) < high * 1.3
    assert np.quantile(found[..., 1], 0.001) > low / 1.3


@pytest.mark.parametrize("name", NAMES)
def test_a_card_says_what_the_model_is(name):
    model, text = load(name), card(name)
    for count in (len(model.reference.vertices), len(model.reference.faces)):
        assert f"{count:,}" in text
    assert f"{model.config.components} latent components" in text
    assert f"--components {model.config.components}" in text
    assert f"deformer train {name}.npz -o {name}" in text
    assert re.search(r"python examples/\d\d_make_\w+\.py .*--seed 0", text)
    assert (ROOT / re.search(r"examples/\d\d_make_\w+\.py", text)[0]).is_file()
    test, train = model.summary["test_e_rms"], model.summary["train_e_rms"]
    assert f"{test:.1f} (encoder pass, as placed; {train:.1f} on the training" in text
    up = model.summary["up"]
    assert f"{up} up" in text
    assert up == "y" or f"--up {up}" in text
    files = ("model.json", "reference.ply", "weights.safetensors")
    size = sum((MODELS / name / file).stat().st_size for file in files)
    assert f"{size / 1e6:.1f} MB: float32" in text


@pytest.mark.parametrize("name", NAMES)
def test_all_components_of_a_shipped_model_have_names(name):
    model = load(name)
    assert set(model.component_names) == set(range(model.components))
    assert "examples/14_name_components.py" in card(name)


@pytest.mark.parametrize("name", ["face", "humanoid"])
def test_sides_in_names_are_the_own_ones_of_the_body(name):
    """Face and body have their left at +x."""
    model = load(name)
    activations = deformer.Activations(model)
    x = model.reference.vertices[:, 0]
    sides = {"Left": 1, "Right": -1}
    sided = {k: n.split()[0] for k, n in model.component_names.items() if n.split()[0] in sides}
    assert set(sided.values()) == set(sides)
    for k, side in sided.items():
        assert sides[side] * (activations.displacement(k) @ x) > 0, model.label(k)


@pytest.mark.parametrize("name", LICENSED)
def test_the_licence_of_the_data_is_shipped(name):
    text = (MODELS / name / "LICENSE").read_text(encoding="utf-8")
    holder = re.search(r"Copyright \(c\) \d{4} (.*)", text)
    assert holder[1] == LICENSED[name] and holder[0] in card(name)
    assert "Permission is hereby granted" in text and "WITHOUT WARRANTY OF ANY KIND" in text


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_without_background_is_shipped(name):
    picture = Image.open(MODELS / name / "picture.png")
    assert (picture.size, picture.mode) == ((512, 384), "RGBA")
    opacity = np.asarray(picture)[..., 3]
    assert opacity[0].max() == opacity[-1].max() == 0
    assert 0.05 < (opacity == 255).mean() < 0.8


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_model_is_known_by_its_name(name, run_json):
    found = run_json("info", name)
    assert found["vertices"] == len(load(name).reference.vertices)


def test_pulled_corners_of_the_mouth_make_a_smile():
    model = load("face")
    rest = model.reference.vertices
    shape, targets = pulled(model, SMILE)
    corners = list(SMILE)
    assert np.linalg.norm(shape[corners] - targets, axis=1).max() < 0.5
    assert_bounded(model, shape)
    moved = np.linalg.norm(shape - rest, axis=1)
    # The skull and the neck stay, the cheeks follow.
    assert np.quantile(moved[(rest[:, 2] < 0) | (rest[:, 1] > 9)], 0.95) < 0.15
    beside = np.linalg.norm(rest - rest[corners[0]], axis=1)
    cheek = (beside > 1.0) & (beside < 2.5) & (rest[:, 1] > rest[corners[0], 1])
    assert (shape - rest)[cheek, 1].mean() > 0.2
    # Both sides alike.
    symmetry = deformer.find_symmetry(model.reference)
    other = symmetry.mirror(shape)[symmetry.opposite]
    assert np.abs(other - shape).max() < 0.1


def test_a_pulled_chin_opens_the_mouth():
    model = load("face")
    rest = model.reference.vertices
    shape, _ = pulled(model, {312: (0.0, -2.2, -2.0)})
    assert_bounded(model, shape)
    upper, lower = 0, 1931  # of the lips, in the middle and beside it
    gap = np.linalg.norm(shape[upper] - shape[lower]) - np.linalg.norm(rest[upper] - rest[lower])
    assert gap > 0.8
    assert np.quantile(np.linalg.norm(shape - rest, axis=1)[rest[:, 1] > 5], 0.95) < 0.15


def test_a_pulled_fingertip_bends_the_finger_without_collapse():
    model = load("hand")
    rest = model.reference.vertices
    tip, thumb = 755, 1178
    shape, targets = pulled(model, {tip: (0.005, -0.036, -0.107)})
    assert np.linalg.norm(shape[tip] - targets[0]) < 0.01
    assert_bounded(model, shape)
    # The palm stays, the thumb hardly moves, and the volume is that of the hand at rest.
    palm = (rest[:, 2] > 0.02) & (rest[:, 2] < 0.07) & (np.abs(rest[:, 0]) < 0.03)
    assert np.quantile(np.linalg.norm(shape - rest, axis=1)[palm], 0.9) < 0.01
    assert np.linalg.norm(shape[thumb] - rest[thumb]) < 0.04
    corners, posed = rest[model.reference.faces], shape[model.reference.faces]
    assert np.linalg.det(posed).sum() == pytest.approx(np.linalg.det(corners).sum(), rel=0.05)


def test_a_handle_far_out_of_reach_leaves_the_hand_a_hand():
    model = load("hand")
    shape, _ = pulled(model, {755: (0.1, -0.3, 0.1)})
    assert_bounded(model, shape)
