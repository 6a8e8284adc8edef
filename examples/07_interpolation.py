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

    ways = ("latent", "features", "linear")
    paths = {way: deformer.interpolate(model, keys, 3 if quick else 7, way) for way in ways}

    rows = {way: path.vertices for way, path in paths.items()}
    titles = {way: [f"{way}, {t:.2f}" for t in path.times] for way, path in paths.items()}
    save_rows(picture, rows, model.reference.faces, "z", titles)
    return {
        way: float(np.quantile(path.edge_ratios(), 0.05, axis=1).min())
        for way, path in paths.items()
    }


if __name__ == "__main__":
    print(main(Path(sys.argv[1])))
