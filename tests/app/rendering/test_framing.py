"""Pictures keep their scale and lose what is empty."""

import numpy as np
from PIL import ImageColor

from deformer import Mesh
from deformer_app.rendering.framing import trimmed, with_bar
from deformer_app.rendering.offscreen import Layer
from deformer_app.rendering.palette import BACKGROUND

EMPTY = np.array(ImageColor.getrgb(BACKGROUND), np.uint8)


def picture(top, bottom, left, right):
    """A black rectangle on the background."""
    drawn = np.tile(EMPTY, (60, 80, 1))
    drawn[top:bottom, left:right] = 0
    return drawn


def content(image):
    """Rows and columns from the first to behind the last that is black."""
    rows, columns = np.nonzero((image == 0).all(axis=2))
    return rows.min(), rows.max() + 1, columns.min(), columns.max() + 1


def test_cells_are_as_large_as_the_largest_content_and_its_margin():
    first, second = trimmed([picture(20, 40, 5, 15), picture(10, 30, 50, 76)], margin=3)
    # Rows 10 to 40 of both; the widest is 26 pixels wide.
    assert first.shape == second.shape == (30 + 6, 26 + 6, 3)
    assert content(second) == (3, 23, 3, 29)
    # On the same floor, in the middle of its cell, in its own size.
    assert content(first) == (13, 33, 11, 21)


def test_an_empty_picture_stays_empty_and_others_are_cut():
    drawn, empty = trimmed([picture(20, 40, 5, 15), picture(0, 0, 0, 0)], margin=0)
    assert drawn.shape == empty.shape == (20, 10, 3)
    assert (drawn == 0).all() and (empty == EMPTY).all()
    nothing = [picture(0, 0, 0, 0)]
    assert (trimmed(nothing)[0] == nothing[0]).all()


def test_the_bar_stands_beside_the_sheet_and_covers_nothing():
    sheet = picture(0, 60, 0, 80)
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    found = with_bar(sheet, Layer(mesh, scalars=[0.0, 1.0, 2.0], title="error"))
    assert (found[:, :80] == sheet).all()
    assert found.shape[0] == 60 and found.shape[1] > 80
    assert (found[:, 80:] != EMPTY).any()
