"""Truths of the saved model: nothing is lost, nothing damaged is loaded, fits get better."""

import json
import shutil
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from deformer import e_rms, load_model, save_mesh, shipped_models, train
from deformer.acap.features import FeatureExtractor
from deformer.errors import InputError
from deformer.geometry.mesh import Mesh, MeshSequence, one_rings
from deformer.geometry.rotations import align
from deformer.network.autoencoder import MeshAutoencoder
from deformer.network.config import ModelConfig
from model_files import sign
from settings import QUICK_ADAM
from shapes import random_rotation, sequence, small_model, tube

QUICK = ModelConfig(name="quick", components=3, training=replace(QUICK_ADAM, encoder="projection"))


@cache
def by_gradients():
    """The small model, but trained by Adam, so that its network has an encoder of its own."""
    training = replace(QUICK_ADAM, epochs=600, mixed_shapes=24, encoder="projection")
    return train(sequence(), 6, config=ModelConfig(training=training), device="cpu")


@pytest.fixture
def saved(tmp_path):
    """A folder with the small model."""
    small_model().save(tmp_path / "model")
    return tmp_path / "model"


def change_json(folder, change, checked=False):
    """Apply `change` to a saved model's description; its checksum is renewed, unless `checked`."""
    path = folder / "model.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    change(data)
    if not checked:
        sign(folder, data)
    path.write_text(json.dumps(data), encoding="utf-8")


def refused(path, *words):
    """Loading is refused in one line that has the words."""
    with pytest.raises(InputError) as caught:
        load_model(path)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert str(word) in message, message


def test_loading_gives_back_the_same_model(saved):
    model, again = small_model(), load_model(saved)
    np.testing.assert_array_equal(again.reference.vertices, model.reference.vertices)
    np.testing.assert_array_equal(again.reference.faces, model.reference.faces)
    assert again.config == model.config and again.scaler == model.scaler
    assert again.split == model.split and again.summary == model.summary
    np.testing.assert_array_equal(again.codes, model.codes)
    np.testing.assert_array_equal(again.latent_mean, model.latent_mean)
    np.testing.assert_array_equal(again.latent_covariance, model.latent_covariance)
    np.testing.assert_array_equal(again.decode(model.codes), model.decode(model.codes))
    shapes = sequence().vertices
    np.testing.assert_array_equal(again.encode(shapes), model.encode(shapes))


def test_saving_again_writes_the_same_bytes(saved, tmp_path):
    load_model(saved).save(tmp_path / "again")
    for path in saved.iterdir():
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes(), path.name


def test_no_file_holds_code(saved):
    """Nothing that runs when it is read: JSON, PLY, and tensors behind a JSON header."""
    assert {path.name for path in saved.iterdir()} == {
        "model.json",
        "reference.ply",
        "weights.safetensors",
    }
    json.loads((saved / "model.json").read_text(encoding="utf-8"))
    raw = (saved / "weights.safetensors").read_bytes()
    header = json.loads(raw[8 : 8 + int.from_bytes(raw[:8], "little")])
    assert "codes" in header and "latent_covariance" in header


def test_a_model_replaces_a_model_but_nothing_else(saved, tmp_path):
    small_model().save(saved)
    load_model(saved)
    (saved / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"notes\.txt"):
        small_model().save(saved)
    assert (saved / "notes.txt").read_text() == "mine"
    with pytest.raises(InputError, match="does not exist"):
        small_model().save(tmp_path / "no" / "where")


@pytest.mark.parametrize("name", ["weights.safetensors", "reference.ply"])
def test_altered_files_are_refused(saved, name):
    path = saved / name
    raw = bytearray(path.read_bytes())
    raw[-10] ^= 1
    path.write_bytes(bytes(raw))
    refused(saved, path, "altered")
    path.write_bytes(bytes(raw[: len(raw) // 2]))
    refused(saved, path)


@pytest.mark.parametrize("name", ["model.json", "weights.safetensors", "reference.ply"])
def test_missing_files_are_named(saved, name):
    (saved / name).unlink()
    refused(saved, saved / name, "missing")


def test_another_format_version_is_refused(saved):
    change_json(saved, lambda data: data.update(format=999))
    refused(saved, saved / "model.json", "999")


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", "3", '"model"'])
def test_descriptions_that_are_none_are_refused(saved, content):
    (saved / "model.json").write_text(content)
    refused(saved, saved / "model.json")


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data.pop("sha256"),
        lambda data: data.pop("config"),
        lambda data: data.pop("scaler"),
        lambda data: data.pop("connectivity"),
        lambda data: data["config"].update(unheard_of=1),
        lambda data: data["config"]["training"].update(method="magic"),
        lambda data: data.pop("rigid_prior"),
        lambda data: data.pop("handle_noise"),
        lambda data: data.pop("component_names"),
        lambda data: data["scaler"].update(r=[1.0]),
    ],
    ids=[
        "no sha256",
        "no config",
        "no scaler",
        "no connectivity",
        "config",
        "method",
        "no rigid prior",
        "no handle noise",
        "no component names",
        "scaler",
    ],
)
def test_incomplete_descriptions_are_refused(saved, change):
    change_json(saved, change)
    refused(saved, saved / "model.json")


def test_a_description_that_does_not_fit_the_weights_is_refused(saved):
    change_json(saved, lambda data: data["config"].update(components=7))
    refused(saved, saved / "model.json")


def test_an_altered_description_is_refused(saved):
    change_json(saved, lambda data: data["scaler"].update(r=[-9.0, 9.0]), checked=True)
    refused(saved, saved / "model.json", "altered")


def test_a_reference_of_other_connectivity_is_refused(saved):
    """Even when its checksum is right."""
    mesh = small_model().reference
    path = saved / "reference.ply"
    save_mesh(path, Mesh(mesh.vertices, mesh.faces[::-1]))
    change_json(saved, lambda data: None)
    refused(saved, path, "connectivity")


def test_unknown_names_are_refused(tmp_path):
    refused("no-such-model", "no-such-model", "no such model", *shipped_models())
    refused(tmp_path / "nothing", tmp_path / "nothing")
    (tmp_path / "file").write_text("")
    refused(tmp_path / "file", tmp_path / "file")


def test_shipped_models_load_by_name():
    for name in shipped_models():
        model = load_model(name)
        assert np.isfinite(model.decode(model.latent_mean)).all()


def test_single_shapes_and_batches_agree():
    model, shapes = small_model(), sequence().vertices
    codes = model.encode(shapes)
    assert codes.shape == (12, 6) and codes.dtype == np.float64
    np.testing.assert_allclose(model.encode(shapes[3]), codes[3], atol=1e-4)
    decoded = model.decode(codes)
    assert decoded.shape == shapes.shape
    np.testing.assert_allclose(model.decode(codes[3]), decoded[3], atol=1e-12)
    fitted = model.fit(shapes[2:4])
    assert fitted.shape == (2, 6)
    np.testing.assert_allclose(
        model.decode(model.fit(shapes[3])), model.decode(fitted[1]), atol=1e-3
    )


def test_decoded_shapes_stand_where_examples_do():
    """And on the reference where that is not known."""
    model, shapes = small_model(), sequence()
    centre = model.reference.vertices.mean(axis=0)
    stands = shapes.vertices.mean(axis=1)
    decoded = model.decode(model.codes).mean(axis=1)
    np.testing.assert_allclose(decoded, centre + model.centroid_offset(model.codes), atol=1e-9)
    assert np.abs(decoded - stands).max() < 0.2 * np.ptp(stands, axis=0).max()
    still = replace(model, rigid_prior=None).decode(model.codes).mean(axis=1)
    np.testing.assert_allclose(still, np.tile(centre, (12, 1)), atol=1e-9)


def test_training_codes_are_the_encoded_shapes_and_prior_their_statistics():
    model = small_model()
    np.testing.assert_allclose(model.codes, model.encode(sequence().vertices), atol=1e-4)
    # Features go through the network's scaling, in single precision, before they are encoded.
    np.testing.assert_allclose(model.latent_mean, model.codes.mean(axis=0), atol=1e-4)
    assert np.linalg.eigvalsh(model.latent_covariance)[0] > 0


@pytest.mark.slow
def test_encoding_goes_through_scaled_features():
    """By the network where the configuration says so."""
    model, shapes = by_gradients(), sequence().vertices
    q = FeatureExtractor(model.reference).extract(shapes[4])
    plain = replace(model, config=model.config.with_training(encoder="network"))
    x = torch.tensor(model.scaler.scale(q)[:, None], dtype=torch.float32)
    rings = one_rings(model.reference.faces, len(model.reference.vertices))
    with torch.no_grad():
        code = MeshAutoencoder.from_weights(model.weights, *rings).encode(x)[0].numpy()
    np.testing.assert_allclose(plain.encode(shapes[4]), code, atol=1e-4)


def test_projection_finds_the_code_of_a_decoded_shape():
    model = by_gradients()
    assert model.config.projects
    z = model.latent_mean + 0.5 * (model.codes[1] - model.latent_mean)
    np.testing.assert_allclose(model.encode(model.decode(z)), z, atol=0.02 * np.abs(z).max())


def test_projection_is_closer_than_the_network():
    model, shapes = by_gradients(), sequence().vertices
    plain = replace(model, config=model.config.with_training(encoder="network"))
    by_network = e_rms(shapes, model.decode(plain.encode(shapes)))
    assert e_rms(shapes, model.decode(model.encode(shapes))) < by_network


def test_the_model_knows_its_shapes():
    """A code of six numbers holds the poses of a family of two within a few per cent."""
    model, shapes = small_model(), sequence().vertices
    error = e_rms(shapes, model.decode(model.encode(shapes)))
    assert error == pytest.approx(model.summary["train_e_rms"], rel=1e-3)
    assert error < 0.04 * 1000 * model.reference.bounding_diagonal


def test_fitting_improves_on_encoding():
    model = small_model()
    unseen = sequence(24).vertices[1::2]
    encoded = model.encode(unseen)
    fitted = model.fit(unseen)
    for shape, before, after in zip(unseen, encoded, fitted, strict=True):
        assert e_rms(shape, model.decode(after)) < e_rms(shape, model.decode(before))
    better = e_rms(unseen, model.decode(fitted))
    assert better < 0.8 * e_rms(unseen, model.decode(encoded))


def test_no_code_near_a_fit_is_better():
    model, shape = small_model(), sequence(24).vertices[5]
    z = model.fit(shape)
    best = e_rms(shape, model.decode(z))
    rng = np.random.default_rng(0)
    factor = np.linalg.cholesky(model.latent_covariance)
    for size in (1e-2, 0.1, 0.5):
        for _ in range(10):
            other = model.decode(z + size * factor @ rng.normal(size=6))
            # But for the faint pull to the prior and where the iterations stop.
            assert e_rms(shape, other) > 0.995 * best


def test_fitting_recovers_what_was_decoded():
    """From any translation: the fit does not see it."""
    model = small_model()
    z = 0.5 * (model.codes[3] + model.codes[4])
    shape = model.decode(z)
    again = model.decode(model.fit(shape + np.array([5.0, -4, 3])))
    np.testing.assert_allclose(again, shape, atol=2e-3 * model.reference.bounding_diagonal)


def test_wrong_arguments_are_refused():
    model = small_model()
    for function in (model.encode, model.fit):
        with pytest.raises(InputError, match=r"\(120, 3\).*\(7, 3\)"):
            function(np.zeros((7, 3)))
        with pytest.raises(InputError, match="finite"):
            function(np.full((120, 3), np.nan))
    for z in (np.zeros(5), np.zeros((2, 7)), np.zeros((1, 2, 6)), 0.0):
        with pytest.raises(InputError, match="6"):
            model.decode(z)


def test_the_split_is_kept_and_only_its_training_shapes_are_seen(tmp_path):
    shapes = sequence(10)
    split = {"train": [2, 4, 5, 7], "test": [0, 9]}
    model = train(shapes, config=QUICK, split=split, device="cpu")
    assert model.split == split and model.codes.shape == (4, 3)
    # Shape 0 is not to be looked at: the first training shape is the reference.
    np.testing.assert_array_equal(model.reference.vertices, shapes.vertices[2])
    assert model.summary["reference"] == 2 and model.summary["test_e_rms"] > 0
    model.save(tmp_path / "m")
    assert load_model(tmp_path / "m").split == split
    # Other test shapes, the same network.
    disturbed = shapes.vertices.copy()
    disturbed[[0, 1, 3, 6, 8, 9]] += 1000 * np.random.default_rng(0).normal(size=(6, 120, 3))
    other = train(MeshSequence(disturbed, shapes.faces), config=QUICK, split=split, device="cpu")
    np.testing.assert_array_equal(other.codes, model.codes)


def test_the_reference_is_shape_0_or_the_one_asked_for():
    shapes = sequence(6)
    everything = train(shapes, config=QUICK, device="cpu")
    np.testing.assert_array_equal(everything.reference.vertices, shapes.vertices[0])
    assert everything.split == {"train": list(range(6)), "test": []}
    split = {"train": [3, 0, 2], "test": []}
    model = train(shapes, config=QUICK, split=split, device="cpu")
    np.testing.assert_array_equal(model.reference.vertices, shapes.vertices[0])
    model = train(shapes, config=QUICK, reference=4, device="cpu")
    np.testing.assert_array_equal(model.reference.vertices, shapes.vertices[4])


def test_a_split_may_leave_out_its_test_part():
    model = train(sequence(4), config=QUICK, split={"train": [1, 3]}, device="cpu")
    assert model.split == {"train": [1, 3], "test": []}


def test_options_override_the_configuration():
    model = train(sequence(4), 5, config=QUICK, epochs=3, align_shapes=True, device="cpu")
    assert (model.components, model.config.training.epochs, model.config.align) == (5, 3, True)
    assert model.summary["epochs"] == 3 and not model.summary["interrupted"]


def test_progress_counts_features_and_then_epochs():
    seen = []
    train(sequence(4), config=QUICK, device="cpu", on_progress=seen.append)
    features = [(p.done, p.total) for p in seen if p.stage == "features"]
    # Those of the mirror images, too, once it is known that they help.
    assert features == [(n, 4 if n <= 4 else 8) for n in range(1, 9)]
    expected = [("training", n, 5) for n in range(1, 6)]
    assert [(p.stage, p.done, p.total) for p in seen[len(features) :]] == expected


def test_an_interrupted_training_is_a_model_that_says_so(tmp_path):
    def stop(progress):
        if progress.stage == "training" and progress.done == 3:
            raise KeyboardInterrupt

    shapes = sequence(4)
    options = {"config": QUICK, "device": "cpu", "checkpoint": tmp_path / "run"}
    model = train(shapes, **options, on_progress=stop)
    assert model.summary["interrupted"] is True and model.summary["epochs"] == 3
    model.save(tmp_path / "model")
    assert np.isfinite(load_model(tmp_path / "model").decode(model.codes)).all()
    resumed = train(shapes, **options, resume=True)
    whole = train(shapes, config=QUICK, device="cpu")
    assert resumed.summary["interrupted"] is False
    np.testing.assert_array_equal(resumed.codes, whole.codes)
    np.testing.assert_array_equal(resumed.decode(whole.codes), whole.decode(whole.codes))


def test_aligned_training_does_not_see_rigid_motions():
    shapes = sequence(6)
    rng = np.random.default_rng(1)
    moved = np.array([v @ random_rotation(rng).T + rng.normal(size=3) for v in shapes.vertices])
    # Alignment is against the first shape, which stays.
    moved[0] = shapes.vertices[0]
    still = train(shapes, config=QUICK, align_shapes=True, device="cpu")
    carried = train(
        MeshSequence(moved, shapes.faces), config=QUICK, align_shapes=True, device="cpu"
    )
    np.testing.assert_allclose(carried.codes, still.codes, atol=1e-3)
    np.testing.assert_allclose(still.encode(moved), still.encode(shapes.vertices), atol=1e-4)


def test_align_is_the_best_rigid_motion():
    shapes = sequence(5).vertices
    found = align(shapes, shapes[0])
    assert e_rms(np.tile(shapes[0], (5, 1, 1)), found, "none") == pytest.approx(
        e_rms(np.tile(shapes[0], (5, 1, 1)), shapes, "rigid")
    )
    edge = np.linalg.norm(shapes[:, 0] - shapes[:, 50], axis=1)
    np.testing.assert_allclose(np.linalg.norm(found[:, 0] - found[:, 50], axis=1), edge)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"split": {"train": [1], "test": []}}, "at least 2 training shapes, got 1"),
        ({"split": {"train": [1, 9], "test": []}}, "shape 9 does not exist"),
        ({"reference": 4}, "shape 4 does not exist"),
        ({"config": "papers"}, "papers"),
        ({"components": 0}, "components"),
        ({"device": "tpu"}, "tpu"),
        ({"resume": True}, "checkpoint"),
        pytest.param(
            {"split": {"train": [0, 1], "test": [9]}, "epochs": 1},
            "shape 9 does not exist",
            id="found before training",
        ),
    ],
)
def test_wrong_options_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        train(sequence(4), **{"device": "cpu", "components": 2, **options})


def test_a_model_moves_with_its_folder(saved, tmp_path):
    shutil.move(saved, tmp_path / "elsewhere")
    load_model(tmp_path / "elsewhere")


def test_scale_does_not_matter():
    """The same shapes in another unit give the same codes, and shapes in that unit."""
    shapes = sequence(5)
    large = MeshSequence(1024 * shapes.vertices, shapes.faces)
    one, other = (train(s, config=QUICK, device="cpu") for s in (shapes, large))
    np.testing.assert_allclose(other.codes, one.codes, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(
        other.decode(one.codes), 1024 * one.decode(one.codes), rtol=1e-2, atol=1
    )


def test_reference_shape_matters_for_a_tube_of_another_mesh():
    with pytest.raises(InputError):
        small_model().encode(tube(8, 16).vertices)


def test_a_printed_model_is_a_line():
    model = load_model("humanoid")
    assert repr(model) == "DeformationModel(3400 vertices, 40 components, 200 training shapes)"


@pytest.mark.parametrize("size", [1e160, 1e300])
def test_shapes_whose_lengths_overflow_have_no_code(size):
    model = small_model()
    for method in (model.encode, model.fit):
        with pytest.raises(InputError, match=r"^vertices: .*within ±1e\+60; repair the shape"):
            method(model.reference.vertices * size)
