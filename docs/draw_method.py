"""Draw energy.png and exact.png of understand/, with the shipped figure.

python docs/draw_method.py docs/understand
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import DeformationModel, HandleSolver, Mesh
from deformer_app.rendering.camera import aim
from deformer_app.rendering.framing import trimmed
from deformer_app.rendering.offscreen import HandleGlyphs, contact_sheet, render
from deformer_app.rendering.sheets import save_sheet

SIZE = (360, 460)
NOISES = (0.002, 0.02, 0.06, 0.2)
FIRM = 0.3  # noise of a prior that hardly follows, so that much is left to the exact handles


def draw(path: Path, model: DeformationModel, shown: list, titles: list[str]) -> None:
    """Shapes, each with its handles or None, in a row with one camera."""
    shapes = np.stack([vertices for vertices, _ in shown])
    camera = aim(shapes, up="z", aspect=SIZE[0] / SIZE[1], azimuth=25, margin=0.02)
    tiles = [
        render(Mesh(vertices, model.reference.faces), camera, SIZE, handles)
        for vertices, handles in shown
    ]
    save_sheet(path, contact_sheet(trimmed(tiles), len(tiles), titles))


def targets(model: DeformationModel) -> tuple[list[int], NDArray]:
    """A hand that is pulled up and forward, and both feet."""
    rest = model.reference.vertices
    x, _, z = rest.T
    handles = [int(i) for i in (x.argmax(), (z - 0.3 * x).argmin(), (z + 0.3 * x).argmin())]
    return handles, rest[handles] + [[-0.1, -0.45, 1.0], [0, 0, 0], [0, 0, 0]]


def draw_energy(path: Path, model: DeformationModel) -> None:
    """One pull with several noises: from following the handle to staying like the examples."""
    handles, goals = targets(model)
    shown, titles = [], []
    for noise in NOISES:
        solver = HandleSolver(model, noise=noise, freedom="stays")
        solver.set_handles(handles, goals)
        pose = solver.solve()
        glyphs = HandleGlyphs(pose.vertices[handles], goals, [False, True, True])
        shown.append((pose.vertices, glyphs))
        titles.append(f"noise {noise:g}: {pose.residual[0] * 100:.0f} cm off")
    draw(path, model, shown, titles)


def draw_exact(path: Path, model: DeformationModel) -> None:
    """The decoded shape, and two ways to bring its handles to their targets."""
    handles, goals = targets(model)
    shown, titles = [], []
    for title, relaxation, hard in (
        ("decoded", 60, False),
        ("displaced", 0, True),
        ("as rigid as possible", 60, True),
    ):
        solver = HandleSolver(model, noise=FIRM, freedom="stays", relaxation=relaxation)
        solver.set_handles(handles, goals, hard=hard)
        pose = solver.solve()
        glyphs = HandleGlyphs(pose.vertices[handles], goals, [False, True, True])
        shown.append((pose.vertices, glyphs))
        titles.append(title)
    draw(path, model, shown, titles)


def main() -> None:
    """Draw all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    model = deformer.load_model("humanoid")
    draw_energy(folder / "energy.png", model)
    draw_exact(folder / "exact.png", model)


if __name__ == "__main__":
    main()
