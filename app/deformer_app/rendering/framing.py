"""Pictures of one scale cut to what they show, and one colour bar beside a sheet of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import ImageColor

from deformer_app.rendering.offscreen import Layer, Picture, draw_bar
from deformer_app.rendering.palette import BACKGROUND

# Difference of a colour from the background, of 255, that counts as something drawn.
_SEEN = 8
# Width of the strip beside a sheet for its colour bar, over the height of the sheet's bar.
_STRIP = 0.2


def trimmed(
    pictures: Sequence[Picture], margin: int = 8, background: str = BACKGROUND
) -> list[Picture]:
    """Pictures that were drawn with one camera, without the border that none of them needs.

    All keep their scale and get one size. Rows are cut alike, so that what stands on a floor goes
    on standing on one; columns are cut around each picture's own content.

    Args:
        pictures: (height, width, 3) uint8, all of one size.
        margin: pixels that are left around the content.
        background: colour of what counts as empty.
    """
    empty = np.array(ImageColor.getrgb(background), dtype=np.int16)
    seen = [(np.abs(picture.astype(np.int16) - empty) > _SEEN).any(axis=2) for picture in pictures]
    rows = np.flatnonzero(np.any(seen, axis=(0, 2)))
    if len(rows) == 0:
        return list(pictures)
    columns = [np.flatnonzero(mask.any(axis=0)) for mask in seen]
    spans = [(int(c[0]), int(c[-1]) + 1) if len(c) else (0, 0) for c in columns]
    width = max(right - left for left, right in spans)
    found = []
    for picture, (left, right) in zip(pictures, spans, strict=True):
        content = picture[rows[0] : rows[-1] + 1, left:right]
        cell = np.empty((len(content) + 2 * margin, width + 2 * margin, 3), np.uint8)
        cell[:] = empty.astype(np.uint8)
        start = margin + (width - (right - left)) // 2
        cell[margin : -margin or None, start : start + right - left] = content
        found.append(cell)
    return found


def with_bar(sheet: Picture, layer: Layer, background: str = BACKGROUND) -> Picture:
    """A sheet with the colour bar of a layer in a strip on its right.

    Args:
        sheet: (height, width, 3) uint8.
        layer: with `scalars`, `limits` and `title`, which all pictures of the sheet share.
        background: colour of the strip.
    """
    height = len(sheet)
    strip = np.empty((height, max(100, round(_STRIP * height)), 3), np.uint8)
    strip[:] = ImageColor.getrgb(background)
    return draw_bar(np.concatenate([sheet, strip], axis=1), layer)
