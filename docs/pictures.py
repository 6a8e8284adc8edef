"""Draw drag.gif, humanoid.png, flag.png, face.png, hand.png and layout.png, of README and docs.

python docs/pictures.py docs
python docs/pictures.py docs --models models/deformer_models    # and each model's picture.png

The examples draw the gallery and flag-components.png, first_minute.py draws viewer.png, and
draw_method.py and draw_architecture.py the figures of understand/.
"""

import argparse
import shutil
import tempfile
from pathlib import Path

import numpy as np

import deformer
from deformer_app.cli import demo
from deformer_app.rendering.camera import aim
from deformer_app.rendering.framing import trimmed
from deformer_app.rendering.layout_picture import draw_layout
from deformer_app.rendering.offscreen import HandleGlyphs, contact_sheet, render, save_picture
from deformer_app.rendering.sheets import save_sheet
from deformer_app.viewer.edit import NOISE

COLUMNS, ROWS = 61, 41  # vertices of the flag
# Where its lower and upper free corners and the middle between them are pulled to, in metres.
PULLS = {
    "swung back": [[1.05, 0.95, -0.05], [1.05, 0.95, 0.85], [1.1, 0.95, 0.4]],
    "a corner pulled over": [[1.3, -0.25, 0.0], [0.95, -0.5, 0.65], [1.3, -0.35, 0.45]],
    "sagging": [[0.95, -0.45, -0.45], [1.2, -0.15, 0.5], [1.1, -0.3, 0.0]],
}

# Vertices of the face near corners of the mouth (right, left), chin, left brow, lids, and top; and
# where expressions pull them, in centimetres from rest.
CORNERS, CHIN, BROWS, LID = (1775, 1873), 312, (640, 1333), 1336
EXPRESSIONS = {
    "smile": dict(zip(CORNERS, [[-0.75, 1.0, -0.9], [0.75, 1.0, -0.9]], strict=True)),
    "an open mouth": {CHIN: [0.0, -2.2, -2.0]},
    "surprise": {
        CHIN: [0.0, -1.2, -1.1],
        **dict(zip(BROWS, [[-0.2, 0.7, -0.2], [0.2, 0.7, -0.2]], strict=True)),
    },
    "one corner": {CORNERS[1]: [0.75, 1.0, -0.9]},
}
# Vertices at the tips of the thumb and the fingers; and where poses pull them, in metres from rest.
THUMB, INDEX, MIDDLE, RING, LITTLE = 1178, 755, 867, 1353, 1553
GESTURES = {
    "one finger": {INDEX: [0.005, -0.036, -0.107]},
    "thumb and middle finger": {THUMB: [-0.072, -0.028, 0.009], MIDDLE: [0.014, -0.082, -0.098]},
    "fist": {
        INDEX: [0.003, -0.058, -0.104],
        MIDDLE: [0.017, -0.065, -0.120],
        RING: [0.036, -0.053, -0.106],
        LITTLE: [0.038, -0.035, -0.090],
    },
    "spread": {LITTLE: [-0.015, -0.016, -0.009], INDEX: [0.022, 0.009, -0.001]},
}
PORTRAIT = (512, 384)
FRAME = 20  # of the flag's training shapes, the one of its picture
# Azimuth and elevation of each model's picture in degrees, and the margin around it.
VIEWS = {"face": (20, 0), "flag": (-30, 10), "hand": (-20, 8), "humanoid": (25, 5)}


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


def draw_face(path: Path) -> None:
    """The neutral face, and soft handles that are pulled."""
    model = deformer.load_model("face")
    rest = model.reference.vertices
    shown = [(rest, None), *(_pulled(model, pulls) for pulls in EXPRESSIONS.values())]
    draw(path, model, shown, (330, 400), azimuth=20, titles=["reference", *EXPRESSIONS], up="y")


def draw_hand(path: Path) -> None:
    """The hand at rest, and soft handles at its tips that are pulled."""
    model = deformer.load_model("hand")
    shown = [(model.reference.vertices, None)]
    shown += [_pulled(model, pulls) for pulls in GESTURES.values()]
    draw(path, model, shown, (330, 360), azimuth=-30, titles=["reference", *GESTURES])


def _pulled(model, pulls):
    """The shape whose soft handles are pulled by displacements, and its glyphs."""
    handles = list(pulls)
    targets = model.reference.vertices[handles] + np.array(list(pulls.values()))
    solver = deformer.HandleSolver(model, noise=NOISE)
    solver.set_handles(handles, targets)
    shape = solver.solve().vertices
    return shape, HandleGlyphs(shape[handles], targets)


def draw_portrait(name: str, path: Path) -> None:
    """The reference of a shipped model, of the flag a frame, without background."""
    model = deformer.load_model(name)
    shape = model.decode(model.codes[FRAME]) if name == "flag" else model.reference.vertices
    azimuth, elevation = VIEWS[name]
    camera = aim(
        shape,
        up=model.summary["up"],
        azimuth=azimuth,
        elevation=elevation,
        aspect=PORTRAIT[0] / PORTRAIT[1],
    )
    # What is drawn over black and over white tells colour and opacity.
    black, white = (
        render(
            deformer.Mesh(shape, model.reference.faces), camera, PORTRAIT, background=colour
        ).astype(float)
        for colour in ("black", "white")
    )
    opacity = 1 - (white - black).mean(axis=2, keepdims=True) / 255
    colour = black / np.maximum(opacity, 1 / 255)
    picture = np.concatenate([colour, 255 * opacity], axis=2).clip(0, 255).round().astype(np.uint8)
    save_picture(path, picture)


def draw(path, model, shown, size, azimuth, titles=None, up="z"):
    """Shapes and their handles in a row, all from one camera."""
    shapes = np.stack([vertices for vertices, _ in shown])
    camera = aim(shapes, up=up, azimuth=azimuth, aspect=size[0] / size[1])
    tiles = [
        render(deformer.Mesh(vertices, model.reference.faces), camera, size, glyphs)
        for vertices, glyphs in shown
    ]
    save_sheet(path, contact_sheet(trimmed(tiles), len(tiles), titles))


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("into", type=Path)
    options.add_argument("--models", type=Path, help="the folder of the shipped models")
    into, models = vars(options.parse_args()).values()
    draw_humanoid(into / "humanoid.png", into / "drag.gif")
    draw_flag(into / "flag.png")
    draw_face(into / "face.png")
    draw_hand(into / "hand.png")
    humanoid = deformer.load_model("humanoid")
    layout = deformer.layout(humanoid, 20, symmetric=True)
    save_sheet(into / "layout.png", draw_layout(humanoid, layout))
    if models is not None:
        for name in VIEWS:
            draw_portrait(name, models / name / "picture.png")
