"""Fit to handles: one hand is pulled up, both feet stay, the prior moves the rest."""

import sys
from pathlib import Path

import numpy as np

import deformer
from deformer_app.rendering.camera import aim
from deformer_app.rendering.framing import trimmed
from deformer_app.rendering.offscreen import HandleGlyphs, contact_sheet, render
from deformer_app.rendering.sheets import save_sheet

TITLES = ["handles", "close to them", "exactly on them"]


def main(picture: Path, quick: bool = False) -> float:
    """Write the picture; returns the soft handles' largest distance, in metres."""
    model = deformer.load_model("humanoid")  # z up, its left at +x
    body = model.reference
    x, _, z = body.vertices.T
    handles = [int(i) for i in (x.argmax(), (z - 0.3 * x).argmin(), (z + 0.3 * x).argmin())]
    targets = body.vertices[handles] + [[-0.15, -0.2, 0.75], [0, 0, 0], [0, 0, 0]]

    # A larger noise than the model's, because these targets are rough guesses and not markers; with
    # freedom the body may move anywhere, and not only where the examples are.
    solver = deformer.HandleSolver(model, noise=0.007, freedom=1.0)
    poses = []
    for hard in (False, True):
        solver.set_handles(handles, targets, hard=hard)
        poses.append(solver.solve())

    shapes = [body.vertices, *(pose.vertices for pose in poses)]
    size = (120, 150) if quick else (420, 520)
    camera = aim(np.stack([*shapes]), up="z", aspect=size[0] / size[1], margin=0.1)
    glyphs = [HandleGlyphs(p[handles], targets, [False, True, True]) for p in shapes]
    drawn = [
        render(deformer.Mesh(p, body.faces), camera, size, glyph)
        for p, glyph in zip(shapes, glyphs, strict=True)
    ]
    save_sheet(picture, contact_sheet(trimmed(drawn), 3, TITLES))
    return float(poses[0].residual.max())


if __name__ == "__main__":
    print("largest distance from handle to target, metres:", main(Path(sys.argv[1])))
