"""Weights of components and names of their regions."""

import numpy as np
import pytest

from deformer import Activations, InputError, Synthesis, load_model
from deformer_app.viewer.changes import ComponentsNamed, MistakeMade
from deformer_app.viewer.component_names import rename_component
from deformer_app.viewer.component_scale import ComponentScale
from deformer_app.viewer.handle_names import opposite_name
from deformer_app.viewer.region_names import region_names
from deformer_app.viewer.session import Session
from deformer_app.viewer.settings import Settings
from off_screen_editor import texts
from shapes import small_model
from waiting import wait_for


def test_weights_are_those_of_synthesis():
    model = small_model()
    acts, synthesis = Activations(model), Synthesis(model)
    for k in range(model.components):
        scale = ComponentScale.of(acts, k)
        for weight in (0.0, 0.3, 1.0, -2.0):
            assert scale.activation(weight) == pytest.approx(synthesis.code({k: weight})[k])
            assert scale.weight(scale.activation(weight)) == pytest.approx(weight, abs=1e-12)
        ends = [scale.activation(w) for w in (scale.low, scale.high)]
        assert min(ends) == pytest.approx(min(acts.low[k], acts.reference[k]))
        assert max(ends) == pytest.approx(max(acts.high[k], acts.reference[k]))
        assert scale.reach == max(-scale.low, scale.high) >= 1.0


def test_a_component_that_no_example_moves_has_a_scale():
    acts = Activations(small_model())
    for values in (acts.low, acts.high, acts.extreme):
        values[0] = acts.reference[0]
    scale = ComponentScale.of(acts, 0)
    assert (scale.low, scale.high, scale.reach, scale.unit) == (0.0, 0.0, 1.0, 1.0)


def test_regions_are_named_by_their_place_and_no_name_is_given_twice():
    box = np.array([[-1.0, 0, -1], [1, 4, 1]])
    centres = [[0.0, 2, 0], [0.9, 3.5, 0], [-0.9, 3.5, 0], [0, 0.2, 0], [0, 0.3, 0]]
    names = region_names(centres, box, "y")
    assert names == ["Middle", "Top left", "Top right", "Bottom 2", "Bottom"]
    # Of a long body the front and the back tell more than its flat sides.
    long = np.array([[-1.0, 0, -4], [1, 3, 4]])
    assert region_names([[0, 1.5, 3], [0, 1.5, -3]], long, "y") == ["Front", "Back"]
    upright = box[:, [0, 2, 1]] * [1, -1, 1]
    assert region_names([[0.9, 0, 3.5]], upright, "z") == ["Top left"]


def figure():
    """Points of a figure with y up, that looks along z: a trunk, stretched arms, two legs."""
    height = np.linspace(0.0, 1.0, 21)[:, None, None] * [0.0, 0.9, 0.0]
    trunk = height + [[0.2, 1.0, z] for z in (-0.1, 0.1)]
    leg = height + [[x, 0.0, z] for x in (0.02, 0.22) for z in (-0.1, 0.3)]
    arm = np.linspace(0.2, 1.0, 21)[:, None] * [1.0, 0.0, 0.0] + [0.0, 1.5, 0.0]
    half = np.concatenate([trunk.reshape(-1, 3), leg.reshape(-1, 3), arm])
    return np.concatenate([half, half * [-1, 1, 1]])


def test_feet_are_left_and_right_though_the_arms_are_wide():
    feet = [[0.12, 0.1, 0.1], [-0.12, 0.1, 0.1]]
    assert region_names([*feet, [0.0, 0.5, 0.0]], figure(), "y") == [
        "Bottom left", "Bottom right", "Bottom",
    ]  # fmt: skip
    assert [region_names([foot], figure(), "y")[0] for foot in feet] == [
        "Bottom left", "Bottom right",
    ]  # fmt: skip


def test_mirrored_places_have_mirrored_names():
    random, shape = np.random.default_rng(0), figure()
    for centre in shape[random.integers(len(shape), size=60)] * random.uniform(0.3, 1, (60, 1)):
        name, mirrored = region_names([centre, centre * [-1, 1, 1]], shape, "y")
        assert opposite_name(mirrored) in (name, "")
        if abs(centre[0]) > 0.1:
            assert {"left", "right"} & set(name.lower().split())


def test_places_of_one_name_are_told_apart_by_sides_then_numbered_in_order():
    box = np.array([[-1.0, 0, -1], [1, 4, 1]])
    near = [[-0.2, 3.5, 0], [0.2, 3.5, 0]]
    assert region_names(near, box, "y") == ["Top right", "Top left"]
    # "Top left" is the name of another one: numbers from left to right.
    assert region_names([*near, [0.9, 3.5, 0]], box, "y") == ["Top 2", "Top", "Top left"]
    row = [[x, 2.0, 0.0] for x in (0.02, 0.06, 0.04)]
    assert region_names(row, box, "y") == ["Middle 3", "Middle", "Middle 2"]


def test_a_raised_arm_is_on_its_side():
    arm = np.linspace(2.0, 3.0, 21)[:, None] * [0.0, 1.0, 0.0] + [[0.1, 0.0, 0.0]]
    shape = np.concatenate([figure(), arm, np.add(arm, [0.1, 0.0, 0.0])])
    for x in (0.1, 0.15, 0.2):
        assert region_names([[x, 2.8, 0.0]], shape, "y") == ["Top left"]


def test_a_name_is_stored_with_the_session_and_with_the_model(editor, heard, tmp_path):
    small_model().save(tmp_path / "tube")
    editor.open_model(tmp_path / "tube")
    heard.clear()
    rename_component(editor, 2, "nod")
    assert editor.model.label(2) == "nod"
    assert any(isinstance(change, ComponentsNamed) for change in heard)
    assert load_model(tmp_path / "tube").component_names == {2: "nod"}
    assert editor.session.changed
    editor.save_session(tmp_path / "s.json")
    assert not editor.session.changed
    with pytest.raises(InputError, match="'nod' is given twice"):
        rename_component(editor, 3, "nod")
    assert editor.model.component_names == {2: "nod"}
    # The session has the name where the model has it no more.
    small_model().save(tmp_path / "tube")
    editor.open_session(tmp_path / "s.json")
    assert editor.model.component_names == {2: "nod"}
    rename_component(editor, 2, "")
    assert load_model(tmp_path / "tube").component_names == {}
    editor.save_session(tmp_path / "s.json")
    assert Session.load(tmp_path / "s.json").component_names == {2: ""}


def test_a_name_of_the_session_is_kept_if_the_model_has_it_for_another_by_now(
    editor, heard, tmp_path
):
    small_model().save(tmp_path / "tube")
    editor.open_model(tmp_path / "tube")
    editor.name_components({2: "Head", 4: "nod"})
    editor.save_session(tmp_path / "s.json")
    small_model().with_component_names({1: "Head", 2: "Leg", 3: "Arm"}).save(tmp_path / "tube")
    heard.clear()
    editor.open_session(tmp_path / "s.json")
    assert editor.model.component_names == {2: "Head", 3: "Arm", 4: "nod"}
    assert editor.session.component_names == {2: "Head", 4: "nod"}
    assert not texts(heard, MistakeMade) and not editor.session.changed


def test_a_renamed_component_is_called_so_beside_its_colours(editor):
    k = 1
    editor.picture.change_look(colour=f"component:{k}")
    wait_for(lambda: not editor.busy, editor.tick)
    editor.name_components({k: "nod"})
    wait_for(lambda: not editor.busy, editor.tick)
    assert editor.answer.paint.title == "nod"


def test_a_model_that_cannot_be_written_leaves_the_name_to_the_session(editor, heard, monkeypatch):
    import deformer
    from deformer_app.viewer.changes import NoticeGiven

    def fails(path, names):
        raise InputError(f"{path}: read only")

    monkeypatch.setattr(deformer, "save_names", fails)
    rename_component(editor, 2, "nod")
    assert editor.session.component_names == {2: "nod"}
    assert any("read only" in text for text in texts(heard, NoticeGiven))


def test_favourite_components_are_remembered_by_model(tmp_path):
    Settings(tmp_path).note_favourites("ab", [3, 1])
    again = Settings(tmp_path)
    assert again.favourites("ab") == [3, 1] and again.favourites("cd") == []
    again.note_favourites("cd", [0])
    again.note_favourites("ab", [])
    assert again.favourites("ab") == [] and again.favourites("cd") == [0]


@pytest.mark.parametrize("damage", ['{"pinned": 3}', '{"pinned": {"ab": "x"}}', "nonsense"])
def test_damaged_settings_have_no_favourites(tmp_path, damage):
    (tmp_path / "settings.json").write_text(damage)
    assert Settings(tmp_path).favourites("ab") == []
