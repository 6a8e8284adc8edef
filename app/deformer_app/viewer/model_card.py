"""What is known of a model: its card, or the facts that its training left."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path

import deformer
from deformer import DeformationModel

_CARD = "README.md"
_PICTURES = re.compile(r"!\[[^\]]*\]\([^)]*\)\s*")  # their files may not be there
# Entries of a summary, and their names for people.
_FACTS = {
    "shapes": "example shapes",
    "train": "trained on",
    "test": "held out",
    "train_e_rms": "E_rms of the training shapes",
    "test_e_rms": "E_rms of the held-out shapes",
    "up": "up axis",
    "epochs": "steps",
    "seconds": "seconds of training",
}


def model_card(name: str, model: DeformationModel) -> str:
    """Return the card of a model as Markdown.

    Args:
        name: of a shipped model, or the model's folder.
        model: the model, for facts where there is no card.
    """
    if name in deformer.shipped_models():
        card = resources.files("deformer_models").joinpath(name, _CARD)
    else:
        card = Path(name, _CARD)
    if card.is_file():
        return _PICTURES.sub("", card.read_text("utf-8"))
    facts = {
        "vertices": len(model.reference.vertices),
        "faces": len(model.reference.faces),
        "components": model.components,
    }
    facts |= {title: model.summary[key] for key, title in _FACTS.items() if key in model.summary}
    rows = "\n".join(f"| {title} | {_text(value)} |" for title, value in facts.items())
    return f"# {Path(name).name}\n\n| | |\n| --- | --- |\n{rows}\n"


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
