"""Numbers typed while the manipulator moves."""

import pytest

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
