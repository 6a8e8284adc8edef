"""Pictures of one scale cut to what they show, and one colour bar beside a sheet of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from deformer_app.rendering.offscreen import Layer, Picture, bar_width, draw_bar
from deformer_app.rendering.palette import BACKGROUND

# Difference of a colour from the background, of 255, that counts as something drawn.
_SEEN = 8
# Least share of the height of a row that its tallest content has where all stand on one floor.
_ON_A_FLOOR = 0.7


def trimmed(
    pictures: Sequence[Picture],
    columns: int | None = None,
    margin: int = 8,
    background: str = BACKGROUND,
) -> list[Picture]:
    """Pictures that were drawn with one camera, cut to what the cells of a sheet need.

    All keep their scale. Pictures of a row get one height, those of a column one width. What stands
    on a floor goes on standing on one: a row is cut alike, unless its contents are at so different
    heights that little of it would be filled; then each picture is cut around its own.

    Args:
        pictures: (height, width, 3) uint8, all of one size, in reading order.
        columns: pictures a row of the sheet; by default all are in one row.
        margin: pixels that are left around the content.
        background: colour of what counts as empty.
    """
    empty = np.array(ImageColor.getrgb(background), dtype=np.int16)
    boxes = [_content(np.abs(image.astype(np.int16) - empty).max(axis=2)) for image in pictures]
    if not any(bottom for _, bottom, _, _ in boxes):
        return list(pictures)
    columns = max(1, min(columns or len(pictures), len(pictures)))
    found = []
    for first in range(0, len(pictures), columns):
        row = boxes[first : first + columns]
        height = max(bottom - top for top, bottom, _, _ in row)
        filled = [(top, bottom) for top, bottom, _, _ in row if bottom]
        low, high = (max(b for _, b in filled), min(t for t, _ in filled)) if filled else (0, 0)
        alike = height >= _ON_A_FLOOR * (low - high)
        for n, (top, bottom, left, right) in enumerate(row, first):
            if alike and bottom:
                top, bottom = high, low
            width = max(1, *(box[3] - box[2] for box in boxes[n % columns :: columns]))
            tall = low - high if alike else height
            cell = np.empty((tall + 2 * margin, width + 2 * margin, 3), np.uint8)
            cell[:] = empty.astype(np.uint8)
            y = margin + (tall - (bottom - top)) // 2
            x = margin + (width - (right - left)) // 2
            cell[y : y + bottom - top, x : x + right - left] = pictures[n][top:bottom, left:right]
            found.append(cell)
    return found


def _content(difference: NDArray) -> tuple[int, int, int, int]:
    """Top, bottom, left and right of what is drawn, ends excluded; zeros if nothing is."""
    seen = difference > _SEEN
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if len(rows) == 0:
        return 0, 0, 0, 0
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1


def with_bar(sheet: Picture, layer: Layer, background: str = BACKGROUND) -> Picture:
    """A sheet with the colour bar of a layer in a strip on its right.

    Args:
        sheet: (height, width, 3) uint8.
        layer: with `scalars`, `limits` and `title`, which all pictures of the sheet share.
        background: colour of the strip.
    """
    line = max(15, len(sheet) // 60)  # about as large as the titles of a sheet
    strip = np.empty((len(sheet), bar_width(layer, line), 3), np.uint8)
    strip[:] = ImageColor.getrgb(background)
    return draw_bar(np.concatenate([sheet, strip], axis=1), layer, line)
