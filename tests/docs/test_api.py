"""The API pages: every public name once, documented with the shapes of its arrays, and examples."""

from __future__ import annotations

import doctest

import numpy as np
import pytest
from numpy.typing import ArrayLike

import deformer
from pages import DOCS
from scripts import module_of
from shapes import sequence, small_model

PUBLIC_NAMES = module_of(DOCS / "public_names.py")


def test_public_names_have_a_page_an_example_and_shapes():
    assert PUBLIC_NAMES.faults() == []


def bare(points):
    pass


def shapeless(points: ArrayLike) -> ArrayLike:
    """The points.

    Args:
        points: some.
    """
    return points


def shaped(points: ArrayLike) -> ArrayLike:
    """The points (n, 3).

    Args:
        points: (n, 3).
    """
    return points


def test_what_is_undocumented_is_told():
    assert PUBLIC_NAMES.lacking("bare", bare) == ["bare: has no docstring"]
    assert len(PUBLIC_NAMES.lacking("shapeless", shapeless)) == 2  # the argument, and the result
    assert PUBLIC_NAMES.lacking("shaped", shaped) == []


def test_a_public_name_without_a_page_is_told(monkeypatch):
    monkeypatch.setattr(PUBLIC_NAMES, "API", PUBLIC_NAMES.API[1:])
    assert any("on no page of docs/api" in fault for fault in PUBLIC_NAMES.faults())


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("page", PUBLIC_NAMES.API, ids=lambda page: page.stem)
def test_examples_print_what_stands_there(page, tmp_path, monkeypatch):
    if "usd" in page.read_text(encoding="utf-8"):
        pytest.importorskip("pxr", reason="needs usd-core")
    monkeypatch.chdir(tmp_path)
    shapes = sequence()
    names = {
        "deformer": deformer,
        "np": np,
        "shapes": shapes,
        "model": small_model(),
        "mesh": shapes.mesh(0),
    }
    text = page.read_text(encoding="utf-8")
    examples = "\n".join(PUBLIC_NAMES.EXAMPLE.findall(text))
    test = doctest.DocTestParser().get_doctest(examples, names, page.name, str(page), 0)
    told: list[str] = []
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    runner = doctest.DocTestRunner(optionflags=flags)
    runner.run(test, out=told.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(told)
