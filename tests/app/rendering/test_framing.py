"""Pictures keep their scale and lose what is empty."""

import numpy as np
from PIL import ImageColor

from deformer import Mesh
from deformer_app.rendering.framing import trimmed, with_bar
from deformer_app.rendering.offscreen import Layer, contact_sheet
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


def test_what_stands_on_a_floor_is_cut_alike():
    first, second = trimmed([picture(20, 40, 5, 15), picture(12, 40, 50, 76)], margin=3)
    assert first.shape == (28 + 6, 10 + 6, 3) and second.shape == (28 + 6, 26 + 6, 3)
    assert content(second) == (3, 31, 3, 29)
    assert content(first) == (11, 31, 3, 13)  # on the same floor, in its own size


def test_what_hangs_at_different_heights_is_cut_by_itself():
    low, high = trimmed([picture(40, 60, 5, 15), picture(10, 20, 50, 76)], margin=3)
    assert low.shape == (20 + 6, 10 + 6, 3) and high.shape == (20 + 6, 26 + 6, 3)
    assert content(low) == (3, 23, 3, 13)
    assert content(high) == (8, 18, 3, 29)  # in the middle of its cell


def test_rows_have_a_height_and_columns_a_width_of_their_own():
    pictures = [picture(0, 10, 0, 20), picture(0, 8, 0, 6), picture(20, 55, 0, 30)]
    first, second, third = trimmed(pictures, 2, margin=0)
    assert first.shape == (10, 30, 3) and second.shape == (10, 6, 3)
    assert third.shape == (35, 30, 3)
    assert content(first) == (0, 10, 5, 25)
    sheet = contact_sheet([first, second, third], 2, gap=1)
    assert sheet.shape == (10 + 35 + 3, 30 + 6 + 3, 3)
    assert (sheet[1:11, 6:26] == 0).all() and (sheet[12:47, 1:31] == 0).all()


def test_an_empty_picture_stays_empty_and_others_are_cut():
    drawn, empty = trimmed([picture(20, 40, 5, 15), picture(0, 0, 0, 0)], 1, margin=0)
    assert drawn.shape == (20, 10, 3) and empty.shape[1:] == (10, 3)
    assert (drawn == 0).all() and (empty == EMPTY).all()
    drawn, empty = trimmed([picture(20, 40, 5, 15), picture(0, 0, 0, 0)], margin=0)
    assert drawn.shape == (20, 10, 3) and empty.shape[0] == 20
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
    longer = with_bar(sheet, Layer(mesh, scalars=[0.0, 1.0, 2.0], title="a much longer title"))
    assert longer.shape[1] > found.shape[1] and (longer[:, :80] == sheet).all()
