"""Sheets of rows of shapes: plain, or coloured on one scale with one bar."""

import numpy as np
from PIL import Image

from bars import bending_bar
from deformer_app.rendering.sheets import draw, save_rows

SIZE = (60, 60)


def saturation(picture):
    """Largest difference between the channels of a pixel."""
    return int(np.ptp(picture.astype(int), axis=2).max())


def test_rows_without_scalars_stay_plain_and_others_share_a_scale():
    shapes = bending_bar(count=2)
    rows = {
        "truth": shapes.vertices[:1],
        "small": shapes.vertices[:1],
        "large": shapes.vertices[:1],
    }
    values = np.ones(len(shapes.vertices[0]))
    scalars = {"small": 0.1 * values[None], "large": values[None]}
    drawn = draw(rows, shapes.faces, "y", size=SIZE, scalars=scalars)
    truth, small, large = (drawn[name][0] for name in rows)
    assert saturation(truth) < 60 < saturation(small) < saturation(large)


def test_a_coloured_sheet_has_one_bar_on_its_right(tmp_path):
    shapes = bending_bar(count=2)
    rows, titles = {"a": shapes.vertices}, {"a": ["one", "two"]}
    plain, coloured = tmp_path / "plain.png", tmp_path / "coloured.png"
    save_rows(plain, rows, shapes.faces, "y", titles)
    scalars = {"a": np.ones(shapes.vertices.shape[:2])}
    save_rows(coloured, rows, shapes.faces, "y", titles, scalars, "distance, mm")
    before, after = Image.open(plain), Image.open(coloured)
    # Of a faint edge the colour decides whether its last row counts.
    assert abs(after.height - before.height) <= 1 and after.width > before.width
    assert saturation(np.asarray(after.convert("RGB"))[:, before.width :]) > 100  # the ramp
