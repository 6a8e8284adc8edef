"""Models whose files were edited, and their checksums with them: every damage is refused."""

import json

import numpy as np
import pytest

from deformer import InputError, load_model
from model_files import change_description, change_tensors
from shapes import small_model


@pytest.fixture
def saved(tmp_path):
    """A folder with the small model."""
    small_model().save(tmp_path / "model")
    return tmp_path / "model"


def refusal(folder, name):
    """The one line with which loading is refused; it names the file."""
    with pytest.raises(InputError) as caught:
        load_model(folder)
    message = str(caught.value)
    assert message.startswith(str(folder / name)) and len(message.splitlines()) == 1
    found = message.removeprefix(str(folder / name))
    assert "altered" not in found and len(found) < 400
    return found


def put(data, path, value):
    for key in path[:-1]:
        data = data[key]
    data[path[-1]] = value


def test_files_that_are_changed_and_signed_are_loaded(saved):
    """The tests below fail for their damage, and not for a checksum."""
    change_description(saved, lambda data: data["component_names"].update({"1": "nod"}))
    change_tensors(saved, lambda arrays: arrays["codes"].__imul__(0.5))
    model = load_model(saved)
    assert model.component_names == {1: "nod"}
    np.testing.assert_array_equal(model.codes, 0.5 * small_model().codes)


NUMBERS = [
    ("format",),
    ("vertices",),
    ("faces",),
    ("scaler", "r", 0),
    ("scaler", "s", 1),
    ("split", "train", 3),
    ("rigid_prior", "rotation"),
    ("rigid_prior", "translation"),
    ("handle_noise",),
    ("handle_misfits", 1),
    ("config", "components"),
    ("config", "d_min"),
    ("config", "training", "epochs"),
    ("config", "training", "sparsity"),
]


@pytest.mark.parametrize("path", NUMBERS, ids=".".join("{}" for _ in "x").format)
@pytest.mark.parametrize(
    "value",
    ["1", True, [], {}, -1, 10**400, pytest.param("1e300", id="1e300")],
)
def test_damaged_numbers_are_refused(saved, path, value):
    if value == "1e300":
        value = 1e300
    change_description(saved, lambda data: put(data, path, value))
    if path == ("scaler", "r", 0) and value == -1:
        load_model(saved)  # a number like any other
    else:
        refusal(saved, "model.json")


def test_a_model_without_a_misfit_has_none(saved):
    change_description(saved, lambda data: data.pop("handle_misfits"))
    assert load_model(saved).handle_misfits == (0.0, 0.0)
    change_description(saved, lambda data: put(data, ("handle_misfits",), [0.25, 0.5]))
    assert load_model(saved).handle_misfits == (0.25, 0.5)


def test_numbers_that_json_does_not_know_are_named(saved):
    text = (saved / "model.json").read_text()
    data = json.loads(text)
    noise = f'"handle_noise": {data["handle_noise"]}'
    for bad in ("NaN", "Infinity", "1e400"):
        (saved / "model.json").write_text(text.replace(noise, f'"handle_noise": {bad}'))
        assert "handle_noise: expected a finite number" in refusal(saved, "model.json")


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("config",), []),
        (("config", "training"), None),
        (("config", "training", "method"), ["adam"]),
        (("config", "align"), 1),
        (("config", "name"), 1),
        (("config", "more"), 1),
        (("scaler", "r"), [1.0, -1.0]),
        (("scaler", "r"), [1.0]),
        (("split",), None),
        (("split", "train"), [0]),
        (("split", "test"), [-1]),
        (("split", "more"), []),
        (("summary",), []),
        (("component_names",), ["nod"]),
        (("component_names", "01"), "nod"),
        (("component_names", "nod"), "nod"),
        (("component_names", "99"), "nod"),
        (("component_names", "1"), 5),
        (("component_names", "1"), "two\nlines"),
        (("component_names", "1"), "x" * 1000),
        (("rigid_prior", "rotation"), 0),
        (("rigid_prior", "more"), 0),
        (("connectivity",), 0),
        (("more",), 0),
    ],
)
def test_damaged_descriptions_are_refused(saved, path, value):
    change_description(saved, lambda data: put(data, path, value))
    refusal(saved, "model.json")


@pytest.mark.parametrize("name", ["model.json", "weights.safetensors", "reference.ply"])
def test_no_file_goes_without_a_checksum(saved, name):
    change_description(saved, lambda data: data["sha256"].pop(name))
    assert name in refusal(saved, "model.json")


@pytest.mark.parametrize("value", [{}, None, [], "", 0, {"a": 1}])
def test_checksums_cannot_be_left_out(saved, value):
    change_description(saved, lambda data: put(data, ("sha256",), value))
    assert "sha256" in refusal(saved, "model.json")


def tensor_names():
    model = small_model()
    assert model.rigid_prior is not None and model.bend_limits is not None
    names = [f"network.{name}" for name in model.weights.arrays]
    names += [f"rigid_prior_{name}" for name in model.rigid_prior.arrays]
    names += [f"bend_limits_{name}" for name in model.bend_limits.arrays]
    return [*names, "codes", "latent_mean", "latent_covariance"]


@pytest.mark.parametrize(
    "damage", ["nan", "inf", "huge", "half", "integers", "row", "axis", "gone"]
)
def test_every_damaged_array_is_refused(saved, damage):
    raw = (saved / "weights.safetensors").read_bytes()
    for name in tensor_names():

        def change(arrays, name=name):
            array = arrays[name]
            if damage in ("nan", "inf", "huge"):
                array.flat[-1] = {"nan": np.nan, "inf": -np.inf, "huge": 1e30}[damage]
            elif damage == "half":
                arrays[name] = array.astype(np.float16)
            elif damage == "integers":
                arrays[name] = array.astype(np.int64)
            elif damage == "row":
                arrays[name] = array[:-1].copy()
            elif damage == "axis":
                arrays[name] = array[..., None].copy()
            else:
                del arrays[name]

        (saved / "weights.safetensors").write_bytes(raw)
        change_tensors(saved, change)
        if damage == "row" and name == "codes":
            assert "split.train" in refusal(saved, "model.json")
        else:
            refusal(saved, "weights.safetensors")


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("latent_covariance", np.zeros_like, "positive definite"),
        ("latent_covariance", np.negative, "positive definite"),
        ("latent_covariance", lambda S: S + np.triu(np.ones_like(S), 1), "symmetric"),
        ("codes", lambda codes: codes[:0], "at least one"),
        ("bend_limits_slack", np.zeros_like, "slack"),
        ("bend_limits_low", lambda low: low + 100.0, "low"),
    ],
)
def test_statistics_that_are_none_are_refused(saved, name, change, words):
    change_tensors(saved, lambda arrays: arrays.update({name: change(arrays[name]).copy()}))
    file = "model.json" if name == "codes" else "weights.safetensors"
    if name == "codes":
        change_description(saved, lambda data: data["split"].update(train=[]))
        file = "weights.safetensors"
    assert words in refusal(saved, file)


def test_unknown_arrays_are_refused(saved):
    for name in ("more", "network.more", "network.convs.0.more", "rigid_prior_more"):
        kind = np.float32 if "network" in name else np.float64
        more = {name: np.zeros(3, dtype=kind)}
        change_tensors(saved, lambda arrays, more=more: arrays.update(more))
        assert "unknown" in refusal(saved, "weights.safetensors")
        change_tensors(saved, lambda arrays, name=name: arrays.pop(name))
    load_model(saved)


@pytest.mark.parametrize(
    "header",
    [
        {"codes": {"dtype": "F64", "shape": [10**12, 10**6], "data_offsets": [0, 8]}},
        {"codes": {"dtype": "F64", "shape": [2**62, 4], "data_offsets": [0, 8]}},
        {"codes": {"dtype": "F64", "shape": [-1], "data_offsets": [0, 8]}},
        {"codes": {"dtype": "BF16", "shape": [4], "data_offsets": [0, 8]}},
        {"codes": {"dtype": "F64", "shape": [1], "data_offsets": [8, 16]}},
        {"codes": 3},
        [],
    ],
)
def test_headers_that_lie_are_refused(saved, header):
    text = json.dumps(header).encode()
    raw = len(text).to_bytes(8, "little") + text + bytes(8)
    (saved / "weights.safetensors").write_bytes(raw)
    change_description(saved, lambda data: None)
    refusal(saved, "weights.safetensors")


@pytest.mark.parametrize("length", [0, 10**6 + 1, 2**63, 2**64 - 1])
def test_lengths_of_headers_are_bounded(saved, length):
    raw = (saved / "weights.safetensors").read_bytes()
    (saved / "weights.safetensors").write_bytes(length.to_bytes(8, "little") + raw[8:])
    change_description(saved, lambda data: None)
    refusal(saved, "weights.safetensors")


@pytest.mark.parametrize("content", [b"", bytes(100), b"{" * 100, b"[" * 10**5, b"\xff\xfe{\x00"])
def test_descriptions_that_are_no_json_are_refused(saved, content):
    (saved / "model.json").write_bytes(content)
    refusal(saved, "model.json")
