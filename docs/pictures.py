"""Draw drag.gif, humanoid.png, flag.png and layout.png, of README, model cards and docs.

python docs/pictures.py docs

The examples draw the gallery and flag-components.png; viewer.png is a picture of the screen.
"""

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

import deformer
from deformer_app.cli import demo
from deformer_app.rendering.camera import aim
from deformer_app.rendering.layout_picture import draw_layout
from deformer_app.rendering.offscreen import HandleGlyphs, contact_sheet, render
from deformer_app.rendering.sheets import save_sheet
from deformer_app.viewer.edit import NOISE

COLUMNS, ROWS = 61, 41  # vertices of the flag
# Where its lower and upper free corners and the middle between them are pulled to, in metres.
PULLS = {
    "swung back": [[1.05, 0.95, -0.05], [1.05, 0.95, 0.85], [1.1, 0.95, 0.4]],
    "a corner pulled over": [[1.3, -0.25, 0.0], [0.95, -0.5, 0.65], [1.3, -0.35, 0.45]],
    "sagging": [[0.95, -0.45, -0.45], [1.2, -0.15, 0.5], [1.1, -0.3, 0.0]],
}


def draw_humanoid(sheet: Path, animation: Path) -> None:
    """The sheet and the animation of `deformer demo`."""
    with tempfile.TemporaryDirectory() as folder:
        demo.run("humanoid", Path(folder), lambda done, total: None)
        shutil.copyfile(Path(folder) / "sheet.png", sheet)
        shutil.copyfile(Path(folder) / "drag.gif", animation)


def draw_flag(path: Path) -> None:
    """The flat flag, and exact handles at its free edge."""
    model = deformer.load_model("flag")
    grid = np.arange(COLUMNS * ROWS).reshape(COLUMNS, ROWS)
    handles = [*grid[0, [0, -1]], *grid[-1, [0, -1, ROWS // 2]]]
    pinned = [True, True, False, False, False]
    rest = model.reference.vertices
    solver = deformer.HandleSolver(model, noise=NOISE)
    solver.set_handles(handles, rest[handles])  # the flag hangs as at rest before it is pulled
    shown = [(rest, HandleGlyphs(rest[handles], pinned=pinned))]
    for pulled in PULLS.values():
        targets = np.concatenate([rest[handles[:2]], pulled])
        solver.set_handles(handles, targets, hard=True)
        shape = solver.solve().vertices
        shown.append((shape, HandleGlyphs(shape[handles], targets, pinned)))
    draw(path, model, shown, (420, 350), azimuth=-30, titles=["reference", *PULLS])


def draw(path, model, shown, size, azimuth, titles=None):
    """Shapes and their handles in a row, all from one camera."""
    shapes = np.stack([vertices for vertices, _ in shown])
    camera = aim(shapes, up="z", azimuth=azimuth, aspect=size[0] / size[1])
    tiles = [
        render(deformer.Mesh(vertices, model.reference.faces), camera, size, glyphs)
        for vertices, glyphs in shown
    ]
    save_sheet(path, contact_sheet(tiles, len(tiles), titles, gap=4))


if __name__ == "__main__":
    into = Path(sys.argv[1])
    draw_humanoid(into / "humanoid.png", into / "drag.gif")
    draw_flag(into / "flag.png")
    humanoid = deformer.load_model("humanoid")
    layout = deformer.layout(humanoid, 20, symmetric=True)
    save_sheet(into / "layout.png", draw_layout(humanoid, layout))
