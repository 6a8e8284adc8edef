"""Synthesis: shapes from the weights of several components, and their linear counterparts."""

import sys
from pathlib import Path

import numpy as np

import deformer
from deformer_app.rendering.sheets import save_rows


def main(picture: Path, quick: bool = False) -> None:
    """Write the picture."""
    names = ("Right lower leg", "Left upper arm", "Left forearm")
    model = deformer.load_model("humanoid")
    synthesis = deformer.Synthesis(model)
    steps = np.linspace(0, 1.5, 2 if quick else 7)

    rows = {
        space: np.stack([synthesis.shape(dict.fromkeys(names, w), space) for w in steps])
        for space in ("latent", "linear")
    }
    titles = {space: [f"{space}, weights {w:.2f}" for w in steps] for space in rows}
    save_rows(picture, rows, model.reference.faces, "z", titles)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
