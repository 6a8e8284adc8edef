"""Fit a motion to 40 noisy markers, a third of which are lost for a while."""

import sys
from pathlib import Path

import numpy as np

import deformer
from deformer_app.rendering.sheets import save_rows

NOISE = 0.01  # metres, of each coordinate


def main(picture: Path, quick: bool = False) -> tuple[float, float]:
    """Write the picture; returns E_rms of the fit, and the noise, in millimetres."""
    model = deformer.load_model("humanoid")
    keys = model.decode(model.codes[[0, 20, 60, 100, 140]])
    truth = deformer.interpolate(model, keys, 3 if quick else 11).vertices  # (F, V, 3)
    markers = deformer.farthest_points(deformer.Geodesics(model.reference), 40, seed=0)

    rng = np.random.default_rng(0)
    seen = truth[:, markers] + rng.normal(scale=NOISE, size=(len(truth), 40, 3))
    weights = np.ones(seen.shape[:2])
    weights[len(truth) // 4 : len(truth) // 2, ::3] = 0.0  # a third is out of sight
    fit = deformer.fit_sequence(model, markers, seen, weights=weights)

    shown = np.linspace(0, len(truth) - 1, 2 if quick else 7).astype(int)
    titles = {name: [f"{name}, frame {n}" for n in shown] for name in ("truth", "fit")}
    rows = {"truth": truth[shown], "fit": fit.vertices[shown]}
    errors = [deformer.vertex_errors(truth[n], fit.vertices[n]) for n in shown]
    scalars = {"fit": 1000 * np.array(errors)}
    save_rows(picture, rows, model.reference.faces, "z", titles, scalars, "distance, mm")
    return deformer.e_rms(truth, fit.vertices, "none"), 1000 * NOISE


if __name__ == "__main__":
    print("E_rms and noise, mm:", *main(Path(sys.argv[1])))
