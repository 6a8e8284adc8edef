"""Numbers typed while the manipulator moves."""

import numpy as np
import pytest
import pyvista as pv

from deformer_app.rendering.offscreen import off_screen
from deformer_app.rendering.palette import LIGHT
from deformer_app.viewer.cursor_label import CursorLabel
from deformer_app.viewer.typed_numbers import TypedNumbers


@pytest.mark.parametrize(
    ("keys", "value"),
    [("1 2 period 5", 12.5), ("period 5", 0.5), ("minus 3", -3.0), ("3 minus", -3.0),
     ("minus 3 minus", 3.0), ("1 2 BackSpace", 1.0), ("KP_4 KP_Decimal KP_2", 4.2),
     ("1 period 2 period 3", 1.23), ("minus", 0.0), ("period", 0.0), ("7 comma 5", 7.5)],
)  # fmt: skip
def test_keys_are_a_number(keys, value):
    typed = TypedNumbers(1)
    assert not typed.begun
    assert all(typed.take(key) for key in keys.split())
    assert typed.begun and typed.values == [value]


def test_what_is_deleted_has_not_been_typed():
    typed = TypedNumbers(1)
    for key in ("4", "2", "BackSpace", "BackSpace", "BackSpace"):
        assert typed.take(key)
    assert not typed.begun


def test_tab_goes_to_the_next_number():
    typed = TypedNumbers(2)
    for key in ("1", "Tab", "minus", "2"):
        typed.take(key)
    assert typed.values == [1.0, -2.0]
    typed.take("Tab")
    typed.take("5")
    assert typed.values == [15.0, -2.0] and typed.texts[1] == "-2"


@pytest.mark.parametrize("key", ["a", "Escape", "F1", "Delete", "Return", "e", "plus"])
def test_other_keys_are_left(key):
    typed = TypedNumbers(1)
    typed.take("4")
    assert not typed.take(key) and typed.values == [4.0]


def test_the_label_beside_the_cursor_shows_where_the_next_key_goes():
    numbers = TypedNumbers(2)
    numbers.take("5")
    with off_screen():
        plotter = pv.Plotter(off_screen=True, window_size=[300, 60])
        plotter.set_background("white")
        label = CursorLabel(plotter.renderer)
        label.set_theme(LIGHT)
        seen = []
        for texts in (["5", "0"], numbers.texts):
            label.show((10.0, 30.0), "   ".join(texts), (300, 60), 1.0)
            plotter.render()
            brightness = np.asarray(plotter.screenshot(return_img=True)).mean(axis=2)
            seen.append(int((brightness < 128).sum()))  # letters, without their background
        plotter.close()
    assert seen[1] > seen[0] > 0
