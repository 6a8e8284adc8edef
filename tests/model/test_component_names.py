"""Names of components: kept with the model, never mistaken for anything else."""

import pytest

from deformer import InputError, load_model, save_names
from shapes import small_model


@pytest.fixture
def saved(tmp_path):
    small_model().save(tmp_path / "model")
    return tmp_path / "model"


def test_names_come_back_and_everything_else_stays(saved):
    before = {path.name: path.read_bytes() for path in saved.iterdir()}
    (saved / "README.md").write_text("my notes")
    save_names(saved, {3: " left arm up ", 1: "nod"})
    again = load_model(saved)
    assert again.component_names == {1: "nod", 3: "left arm up"}
    assert again.fingerprint == small_model().fingerprint
    assert (saved / "README.md").read_text() == "my notes"
    assert (saved / "weights.safetensors").read_bytes() == before["weights.safetensors"]
    # As if it had been saved with its names, and as it was once they are gone.
    again.save(saved.parent / "copy")
    assert (saved.parent / "copy" / "model.json").read_bytes() == (
        saved / "model.json"
    ).read_bytes()
    save_names(saved, {1: "", 3: ""})
    assert (saved / "model.json").read_bytes() == before["model.json"]


def test_names_are_under_the_checksum(saved):
    save_names(saved, {0: "nod"})
    path = saved / "model.json"
    path.write_text(path.read_text().replace("nod", "bow"))
    with pytest.raises(InputError, match="altered"):
        load_model(saved)


def test_components_are_found_by_index_and_by_name():
    model = small_model().with_component_names({2: "left arm up"})
    for key in (2, "2", " 2", "left arm up", " left arm up "):
        assert model.component(key) == 2
    assert model.label(2) == "left arm up" and model.label(0) == "component 0"
    assert model.with_component_names({2: "", 0: "nod"}).component_names == {0: "nod"}
    with pytest.raises(InputError, match=r"'arm': no such name.*'left arm up'"):
        model.component("arm")
    with pytest.raises(InputError, match="component 6 does not exist"):
        model.component("6")


def test_a_copy_with_other_names_shares_what_was_computed():
    model = small_model()
    poisson, decoder = model.poisson, model.decoder
    assert model.closed is model  # it has no seams
    named = model.with_component_names({0: "nod"})
    assert named.poisson is poisson and named.decoder is decoder
    assert named.closed is named and named.fingerprint == model.fingerprint


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ({0: "7"}, "'7' is no name"),
        ({0: "-7"}, "is no name"),
        ({0: "a=b"}, "is no name"),
        ({0: "a, b"}, "is no name"),
        ({6: "a"}, "component 6 does not exist"),
        ({0: "a", 1: "a "}, "given twice"),
    ],
)
def test_what_is_no_name_is_refused(names, words):
    with pytest.raises(InputError, match=words):
        small_model().with_component_names(names)


def test_shipped_models_keep_their_names(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="shipped model keeps its names"):
        save_names("humanoid", {0: "nod"})
