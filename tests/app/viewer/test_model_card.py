"""What the viewer tells of a model."""

import deformer
from deformer_app.viewer.model_card import model_card
from shapes import small_model


def test_a_shipped_model_has_its_card_without_pictures():
    card = model_card("humanoid", deformer.load_model("humanoid"))
    assert card.startswith("# humanoid") and "3,400 vertices" in card and "![" not in card


def test_another_model_has_the_facts_of_its_training(tmp_path):
    model = small_model()
    card = model_card(str(tmp_path / "tube"), model)
    assert card.startswith("# tube")
    assert f"| vertices | {len(model.reference.vertices)} |" in card
    (tmp_path / "README.md").write_text("# A card of its own")
    assert model_card(str(tmp_path), model) == "# A card of its own"
