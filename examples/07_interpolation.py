"""Interpolation in latent codes, in features and in vertices: which one shortens limbs?"""

import sys
from pathlib import Path

import numpy as np

import deformer
from deformer_app.rendering.sheets import save_rows

KEYS = [205, 60]  # training shapes of the shipped figure


def main(picture: Path, quick: bool = False) -> dict[str, float]:
    """Write the picture; returns the 5 % quantile of edge lengths relative to the keys'."""
    model = deformer.load_model("humanoid")
    codes = model.codes[[model.split["train"].index(n) for n in KEYS]]
    keys = model.decode(codes)

    spaces = ("latent", "features", "linear")
    paths = {space: deformer.interpolate(model, keys, 3 if quick else 7, space) for space in spaces}

    rows = {space: path.vertices for space, path in paths.items()}
    titles = {space: [f"{space}, {t:.2f}" for t in path.times] for space, path in paths.items()}
    save_rows(picture, rows, model.reference.faces, "z", titles)
    return {
        space: float(np.quantile(path.edge_ratios(), 0.05, axis=1).min())
        for space, path in paths.items()
    }


if __name__ == "__main__":
    print(main(Path(sys.argv[1])))
