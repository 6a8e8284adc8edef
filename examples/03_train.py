"""Train a model on 40 tubes, and reconstruct unseen tubes."""

import sys
from pathlib import Path

import numpy as np
import tube

import deformer
from deformer_app.rendering.sheets import save_rows


def main(picture: Path, quick: bool = False) -> float:
    """Write the picture; returns E_rms on the unseen shapes over the diagonal, in thousandths."""
    size = {"around": 8, "rings": 15} if quick else {}
    examples = tube.shapes(40, seed=0, **size)
    unseen = tube.shapes(7, seed=1, **size).vertices[1:]

    model = deformer.train(examples, components=8, epochs=20 if quick else None, device="cpu")
    model.save(picture.with_suffix(""))
    model = deformer.load_model(picture.with_suffix(""))
    found = model.decode(model.encode(unseen))

    found += (unseen - found).mean(axis=1, keepdims=True)
    titles = {name: [f"{name} {n}" for n in range(1, 7)] for name in ("unseen", "reproduced")}
    rows = {"unseen": unseen, "reproduced": found}
    errors = [deformer.vertex_errors(x, p) for x, p in zip(unseen, found, strict=True)]
    diagonal = model.reference.bounding_diagonal
    scalars = {"reproduced": 100 * np.array(errors) / diagonal}
    save_rows(picture, rows, examples.faces, "y", titles, scalars, "distance, % of the diagonal")
    return deformer.e_rms(unseen, found) / diagonal


if __name__ == "__main__":
    print("E_rms, thousandths of the diagonal:", main(Path(sys.argv[1])))
