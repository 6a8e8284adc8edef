"""Compare methods: an unseen tube recovered from six vertices, with each method's errors."""

import sys
from pathlib import Path

import numpy as np
import tube

import deformer
from deformer import vertex_errors
from deformer.baselines import METHODS
from deformer_app.rendering.camera import aim
from deformer_app.rendering.framing import trimmed, with_bar
from deformer_app.rendering.offscreen import Layer, contact_sheet, render
from deformer_app.rendering.palette import HEAT
from deformer_app.rendering.sheets import save_sheet


def main(picture: Path, quick: bool = False) -> dict[str, float]:
    """Write the picture; returns E_rms over the bounding diagonal, in thousandths, by method."""
    size = {"around": 8, "rings": 15} if quick else {}
    examples, unseen = tube.shapes(40, seed=0, **size), tube.shapes(9, seed=1, **size).vertices[1:]
    base = examples.mesh(0)
    known = deformer.farthest_points(deformer.Geodesics(base), 6, seed=0)

    model = deformer.train(examples, components=8, epochs=20 if quick else None, device="cpu")
    solver = deformer.HandleSolver(model)
    methods = {name: METHODS[name]().fit(examples, 8) for name in ("pca", "splocs", "arap")}
    found: dict[str, list] = {name: [] for name in ("Deformer", *methods)}
    for shape in unseen:
        solver.set_handles(known, shape[known], hard=True)
        found["Deformer"].append(solver.solve().vertices)
        for name, method in methods.items():
            found[name].append(method.fit_handles(known, shape[known]))

    shown = int(np.argmax(np.abs(unseen - base.vertices).sum(axis=(1, 2))))
    errors = {name: vertex_errors(unseen[shown], np.asarray(p[shown])) for name, p in found.items()}
    limit = float(max(e.max() for e in errors.values()))
    pixels = (160, 120) if quick else (420, 360)
    camera = aim(unseen[shown], up="y", aspect=pixels[0] / pixels[1], margin=0.02)
    layers = [Layer(deformer.Mesh(unseen[shown], base.faces))] + [
        Layer(deformer.Mesh(p[shown], base.faces), scalars=errors[name], limits=(0.0, limit),
              title="distance", colormap=HEAT, bar=False)
        for name, p in found.items()
    ]  # fmt: skip
    titles = ["unseen shape", "Deformer", *(name.upper() for name in methods)]
    sheet = contact_sheet(trimmed([render(x, camera, pixels) for x in layers]), 5, titles)
    save_sheet(picture, with_bar(sheet, layers[-1]))
    diagonal = base.bounding_diagonal
    return {name: deformer.e_rms(unseen, p, "none") / diagonal for name, p in found.items()}


if __name__ == "__main__":
    print(main(Path(sys.argv[1])))
