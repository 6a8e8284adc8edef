"""Checks return what was asked for, and name everything else in one short line."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from deformer import InputError
from deformer.checks import (
    check_memory,
    checked_array,
    checked_choice,
    checked_flag,
    checked_indices,
    checked_integer,
    checked_number,
    checked_path,
    checked_text,
    rounded,
    shortened,
)

JUNK = [None, "1", b"1", [1.0], {}, object(), 1j, np.array([1.0]), True, np.True_, type, print]


def refusal(check, *arguments, **options):
    with pytest.raises(InputError) as caught:
        check(*arguments, **options)
    message = str(caught.value)
    assert "\n" not in message and len(message) < 250
    assert "a: " in message or "a[" in message
    return message


@pytest.mark.parametrize("value", [1, 0.5, np.float32(2), np.int64(3), Fraction(1, 2), np.array(4)])
def test_numbers_of_every_kind_are_numbers(value):
    found = checked_number(value, "a", above=0)
    assert type(found) is float and found == float(value)


@pytest.mark.parametrize("value", [*JUNK, np.nan, -np.inf, 10**400, -(10**400), "nan"])
def test_other_values_are_no_numbers(value):
    assert "expected a finite number" in refusal(checked_number, value, "a")


def test_bounds_of_numbers_are_part_of_the_message():
    assert checked_number(1, "a", least=1, most=1) == 1
    assert "above 0" in refusal(checked_number, 0, "a", above=0)
    assert "at least 1" in refusal(checked_number, 0.9, "a", least=1)
    assert "up to 2" in refusal(checked_number, 2.1, "a", most=2)
    for value in (11, -11):
        assert "±10" in refusal(checked_number, value, "a", largest=10)


@pytest.mark.parametrize("value", [*JUNK, 1.0, np.float64(1), np.nan, Fraction(1)])
def test_other_values_are_no_integers(value):
    assert "expected an integer" in refusal(checked_integer, value, "a")


def test_integers_are_within_their_bounds():
    for value in (3, np.int8(3), np.uint64(3), np.array(3)):
        found = checked_integer(value, "a", least=3, most=3)
        assert type(found) is int and found == 3
    for value in (2, 4, -(10**5000), 10**5000):
        assert "3…3" in refusal(checked_integer, value, "a", least=3, most=3)


def test_flags_texts_and_choices():
    assert checked_flag(np.True_, "a") is True and checked_text("é", "a") == "é"
    assert checked_choice("x", "a", ("x", "y")) == "x"
    for value in (1, None, "yes", [True]):
        refusal(checked_flag, value, "a")
    for value in (1, None, b"x", "\ud800"):
        refusal(checked_text, value, "a")
    for value in ("z", ["x"], None, np.array(["x"])):
        assert "x, y" in refusal(checked_choice, value, "a", ("x", "y"))


@pytest.mark.parametrize(
    "values",
    [
        *(junk for junk in JUNK if not isinstance(junk, list | np.ndarray)),
        ["a", "b", "c"],
        [1, 2, 3j],
        [1, None, 2],
        [[1], [1, 2], [3]],
        np.array([1, 2, 3], dtype=object),
        np.array(["2020", "2021", "2022"], dtype="M8[Y]"),
        [True, False, True],
        [10**400, 1, 2],
        [1, 2],
        [[1, 2, 3]],
        [1, np.inf, 3],
        [1, np.nan, 3],
    ],
)
def test_other_values_are_no_arrays(values):
    refusal(checked_array, values, "a", (3,))


def test_arrays_become_double_precision_and_name_the_bad_entry():
    found = checked_array([[1, 2, 3]], "a", ("N", 3))
    assert found.dtype == np.float64 and found.shape == (1, 3)
    assert checked_array([], "a", ("N",)).shape == (0,)
    assert "a[1, 0]" in refusal(checked_array, [[0, 1], [np.nan, 0]], "a", (2, 2))
    assert "(3,) or (N, 3)" in refusal(checked_array, [1], "a", (3,), ("N", 3))
    assert "±10" in refusal(checked_array, [1, -11], "a", (2,), largest=10)
    assert np.isnan(checked_array([np.nan], "a", (1,), finite=False)).all()


def test_indices_are_whole_numbers_within_the_count():
    for values in ([0, 2], (1,), np.array([2], dtype=np.uint8), []):
        found = checked_indices(values, "a", 3)
        assert found.dtype == np.int64 and found.tolist() == list(values)
    for values in ([0.5], [1.0], ["x"], [True], [[1]], 1, [None], [10**30]):
        refusal(checked_indices, values, "a", 3)
    for bad in (-1, 3, 2**62):
        assert f"a[1]: vertex {bad}" in refusal(checked_indices, [0, bad], "a", 3)
    assert "a[0]" in refusal(checked_indices, np.array([2**63], dtype=np.uint64), "a", 3)


def test_memory_that_no_machine_has_is_refused():
    check_memory(1e6, "a: 3 shapes")
    assert "a: 3 shapes" in refusal(check_memory, 1e18, "a: 3 shapes")


def test_memory_of_a_cgroup_bounds_results(monkeypatch):
    """The smaller of two limits holds; the word "max" is none."""
    text = "1000000000\n"
    monkeypatch.setattr(Path, "read_text", lambda path: text)
    check_memory(4.9e8, "a")
    assert "0.5 GB" in refusal(check_memory, 5.1e8, "a")
    text = "max\n"
    check_memory(5.1e8, "a")


VALUES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text() | st.binary(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner) | st.tuples(inner),
)


@given(VALUES)
def test_what_messages_echo_is_one_short_line(value):
    text = shortened(value)
    assert 0 < len(text) <= 60 and len(text.splitlines()) == 1
    text.encode()


def test_what_messages_echo_costs_nothing():
    nested = []
    for _ in range(100_000):
        nested = [nested]
    for value in (nested, "x" * 10**7, list(range(10**6)), 10**100_000, np.zeros((1000, 1000))):
        assert len(shortened(value)) <= 60
    while nested:  # Python frees nested lists by recursion
        nested = nested.pop()


def test_numbers_in_messages_have_an_exponent_only_where_it_is_shorter():
    shown = [rounded(x) for x in (1000.0, 12345.0, 999.6, 0.001234, 2.0, 1e9, -1500.0)]
    assert shown == ["1000", "12300", "1000", "0.00123", "2", "1e+09", "-1500"]


def test_bytes_of_names_are_told_as_bytes():
    assert shortened("a\udcff.ply") == r"'a\xff.ply'"
    assert shortened(["a\udc80"]) == r"['a\x80']"


@pytest.mark.parametrize("wrap", [lambda x: x, lambda x: [x, x], lambda x: (x, [1.0, 2.0])])
def test_masked_values_are_refused_and_masks_of_none_are_not(wrap):
    masked = np.ma.masked_array([1.0, 2.0], [False, True])
    with pytest.raises(InputError, match="targets: has masked values"):
        checked_array(wrap(masked), "targets")
    whole = checked_array(wrap(np.ma.masked_array([1.0, 2.0], [False, False])), "targets")
    assert np.isfinite(whole).all()


@pytest.mark.parametrize("path", ["a\0b", "\ud800", b"abc", None, 3, ["a"]])
def test_what_is_no_path_is_refused(path):
    with pytest.raises(InputError, match="model: expected the path of a file or directory"):
        checked_path(path, "model")
